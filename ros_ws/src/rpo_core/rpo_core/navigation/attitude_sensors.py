# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A star tracker and a gyro: what the chaser measures of its attitude. Section `attitude_sensors`.

Both are functions of the true attitude and of (tick, stream, key); their streams are none of those
of `sensors`. Arithmetic is + - * / sqrt and comparisons, in the order written. Source of usual
sizes: Markley and Crassidis, "Fundamentals of Spacecraft Attitude Determination and Control", 2014,
4.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from math import pi, radians, sqrt
from typing import Annotated, Any

from rpo_core.attitude.chaser import relative_to, times, turn, upright
from rpo_core.attitude.target import Quaternion
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, real, vector3, whole
from rpo_core.kernels.arithmetic import Vector, norm, sin_cos
from rpo_core.kernels.jit import inlined, step_kernel
from rpo_core.navigation.sensors import (
    MAX_LATENCY_TICKS,
    across,
    first_tick,
    intervals,
    is_due,
    key,
    three_normals,
)
from rpo_core.stage import KernelStage, Place, Section, Signal, register
from rpo_core.wire import interfaces

START_STREAM, STARS, RATES, WALKS = range(128, 132)


@dataclass(slots=True)
class AttitudeSuite:
    """Settings of the kernel `sense_attitude`.

    period, latency : of the star tracker [ticks]
    cross, roll : its sigma across its boresight and about it [rad]
    axes : its axes in those of the chaser, boresight first
    light : direction in LVLH that blinds it; cosine : of the half angle, 2 for none
    outages : (n, 2) ticks, first and end of each
    gyro, walk : sigma of its noise and of the walk of its bias, of a tick [rad/s]
    bias : at tick 0 [rad/s]
    """

    key: tuple[int, int]
    period: int
    latency: int
    cross: float
    roll: float
    axes: Annotated[list[list[float]], 3, 3]
    light: Vector
    cosine: float
    outages: list[list[int]]
    gyro: float
    walk: float
    bias: Vector


@dataclass(slots=True)
class StarMeasurement:
    """An attitude; tick : at which it was taken, -1: there is none."""

    tick: int = -1
    attitude: Annotated[list[float], 4] = field(default_factory=lambda: [0.0] * 4)


@dataclass(slots=True)
class AttitudeSuiteMemory:
    """Memory of the kernel `sense_attitude`.

    drift : the part of the gyro's bias that walked [rad/s]; walked : the tick up to which
    line : attitudes on their way, that of tick k at place k % len(line)
    """

    line: list[StarMeasurement]
    drift: Annotated[list[float], 3] = field(default_factory=lambda: [0.0] * 3)
    walked: int = 0


@inlined
def turned_by(q: Quaternion, e: Vector) -> Quaternion:
    """Return an attitude turned by twice the vector part (3,) of a quaternion; w >= 0."""
    x, y, z = 0.5 * e[0], 0.5 * e[1], 0.5 * e[2]
    rest = 1.0 - (x * x + y * y + z * z)
    return upright(times(q, (x, y, z, sqrt(rest) if rest > 0.0 else 0.0)))


@inlined
def angles_between(truth: Any, estimate: Any) -> Vector:
    """Return the angles (3,) [rad] from estimated to true axes: twice a vector part."""
    p = (estimate[0], estimate[1], estimate[2], estimate[3])
    x, y, z, w = relative_to(p, (truth[0], truth[1], truth[2], truth[3]))
    sign = 2.0 if w >= 0.0 else -2.0
    return sign * x, sign * y, sign * z


@inlined
def along(axes: Any, first: float, second: float, third: float) -> Vector:
    """Return a vector that has these parts along three axes (3, 3)."""
    a, b, c = axes[0], axes[1], axes[2]
    return (
        first * a[0] + second * b[0] + third * c[0],
        first * a[1] + second * b[1] + third * c[1],
        first * a[2] + second * b[2] + third * c[2],
    )


@inlined
def _sees(tick: int, q: Quaternion, p: Any) -> bool:
    """Return whether the star tracker measures: its period, no outage [begin, end), no light."""
    if not is_due(tick, p):
        return False
    x, y, z = turn((p.axes[0][0], p.axes[0][1], p.axes[0][2]), q)
    return bool(x * p.light[0] + y * p.light[1] + z * p.light[2] < p.cosine)


@step_kernel
def sense_attitude(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """Measure at a tick: the rate at once, the attitude when it arrives.

        rate = w_k + b_0 + d_k + sigma n,   d_(k+1) = d_k + walk n'

    u : true attitude, quaternion and rate (7,) [rad/s]
    y : quaternion (4,) of the star tracker, 0, 0, 0, 0 for none; rate (3,) of the gyro [rad/s]
    """
    while p.walk > 0.0 and m.walked < tick:
        m.walked += 1
        n = three_normals(m.walked, 0, WALKS, p.key[0], p.key[1])
        for i in range(3):
            m.drift[i] += p.walk * n[i]
    n = three_normals(tick, 0, RATES, p.key[0], p.key[1])
    for i in range(3):
        y[4 + i] = u[4 + i] + p.bias[i] + m.drift[i] + p.gyro * n[i]
    q = (u[0], u[1], u[2], u[3])
    slots = len(m.line)
    taken = m.line[tick % slots]
    taken.tick = -1
    if _sees(tick, q, p):
        n = three_normals(tick, 0, STARS, p.key[0], p.key[1])
        error = along(p.axes, p.roll * n[0], p.cross * n[1], p.cross * n[2])
        measured = turned_by(q, error)
        taken.tick = tick
        for i in range(4):
            taken.attitude[i] = measured[i]
    due = tick - p.latency
    arrived = m.line[due % slots]
    for i in range(4):
        y[i] = arrived.attitude[i] if due >= 0 and arrived.tick == due else 0.0


ARCSEC = pi / 648000.0
"""One second of arc [rad]."""

_noise = partial(real, unit='arcsec', above=0.0, most=36000.0)
_direction = partial(vector3, unit='', bound=1e3)
_least = partial(real, least=0.0, most=1.0)
_rate = partial(vector3, unit='rad/s', bound=1.0)


@dataclass(frozen=True, kw_only=True)
class StarTracker(Checked):
    """A star tracker. Its noise is white.

    cross_noise_arcsec, boresight_noise_arcsec : sigma of each axis across its boresight, and of the
        angle about it
    boresight : (3,) in the chaser's axes
    period_ticks, latency_ticks : between measurements; from a measurement to its arrival
    outages_s : intervals [begin, end) of flight time without measurements
    light, light_deg : (3,) direction in target LVLH, as of the Earth, [-1, 0, 0]; it is blinded
        where its boresight is nearer to that than the angle; 0: never
    """

    cross_noise_arcsec: Annotated[float, _noise] = 10.0
    boresight_noise_arcsec: Annotated[float, _noise] = 60.0
    boresight: Annotated[Vector, _direction] = (0.0, 0.0, 1.0)
    period_ticks: Annotated[int, partial(whole, least=1, most=1_000_000)] = 1
    latency_ticks: Annotated[int, partial(whole, least=0, most=MAX_LATENCY_TICKS)] = 0
    outages_s: Annotated[tuple[tuple[float, float], ...], intervals] = ()
    light: Annotated[Vector, _direction] = unless_default((-1.0, 0.0, 0.0))
    light_deg: Annotated[float, partial(real, unit='deg', least=0.0, below=180.0)] = unless_default(
        0.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ('boresight', 'light'):
            if norm(*getattr(self, name)) < 1e-6:
                raise InputError(f'`{name}` must have a direction; got {getattr(self, name)!r}')

    @property
    def axes(self) -> tuple[Vector, ...]:
        """Its axes (3, 3) in those of the chaser, boresight first."""
        size = norm(*self.boresight)
        x, y, z = (part / size for part in self.boresight)
        return (x, y, z), *across(x, y, z)


@dataclass(frozen=True, kw_only=True)
class Gyro(Checked):
    """A gyro of three axes: the rate against inertial space, with noise and a bias that walks.

    noise_rad_s0_5 : root of the density of the white noise, the angle's random walk
    bias_rad_s : (3,) at tick 0, the chaser's axes; bias_walk_rad_s1_5 : per root of a second
    """

    noise_rad_s0_5: Annotated[float, partial(_least, unit='rad/s^0.5')] = 1e-5
    bias_rad_s: Annotated[Vector, _rate] = (0.0, 0.0, 0.0)
    bias_walk_rad_s1_5: Annotated[float, partial(_least, unit='rad/s^1.5')] = 1e-8


@dataclass(frozen=True, kw_only=True)
class AttitudeSensors(Checked):
    """What the chaser measures of its attitude.

    noise_key : two words of 32 bits, the key of Philox4x32-10, for both and for the start of the
        estimator
    """

    star_tracker: StarTracker = StarTracker()
    gyro: Gyro = Gyro()
    noise_key: Annotated[tuple[int, int], key] = (0, 0)


def suite_of(settings: AttitudeSensors, scenario: Any) -> AttitudeSuite:
    """Return the sensors of a scenario as the kernel reads them."""
    star, gyro, root = settings.star_tracker, settings.gyro, sqrt(scenario.dt_s)
    x, y, z = star.light
    size = norm(x, y, z)
    return AttitudeSuite(
        key=settings.noise_key,
        period=star.period_ticks,
        latency=star.latency_ticks,
        cross=star.cross_noise_arcsec * ARCSEC,
        roll=star.boresight_noise_arcsec * ARCSEC,
        axes=[list(axis) for axis in star.axes],
        light=(x / size, y / size, z / size),
        cosine=sin_cos(radians(star.light_deg))[1] if star.light_deg > 0.0 else 2.0,
        outages=[[first_tick(time, scenario) for time in pair] for pair in star.outages_s],
        gyro=gyro.noise_rad_s0_5 / root,
        walk=gyro.bias_walk_rad_s1_5 * root,
        bias=gyro.bias_rad_s,
    )


class AttitudeSensorsStage(KernelStage):
    """From the true attitude to what arrives of the star tracker and the gyro."""

    name = 'attitude_sensors'
    inputs = (interfaces.CHASER_ATTITUDE,)
    outputs = (interfaces.ATTITUDE_MEASUREMENT,)
    kernel = sense_attitude

    def __init__(self, settings: AttitudeSensors, scenario: Any) -> None:
        self.memory_ticks = settings.star_tracker.latency_ticks
        line = [StarMeasurement() for _ in range(self.memory_ticks + 1)]
        super().__init__(suite_of(settings, scenario), AttitudeSuiteMemory(line))

    def passes_on(self) -> tuple[int | Signal, ...]:
        """Return that the true attitude is measured."""
        return (0,)


register(
    Section(
        'attitude_sensors',
        AttitudeSensors,
        Place.ATTITUDE_SENSOR,
        AttitudeSensorsStage,
        needs=('attitude', 'an attitude to measure'),
    )
)
