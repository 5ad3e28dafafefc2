# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A star tracker and a gyro: what the chaser measures of its attitude. Section `attitude_sensors`.

Both are functions of the true attitude and of (tick, stream, key); their streams are none of those
of `sensors`. Arithmetic is + - * / sqrt and comparisons, in the order written. Source of usual
sizes: Markley and Crassidis, "Fundamentals of Spacecraft Attitude Determination and Control", 2014,
4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import pi, radians, sqrt
from typing import Annotated, Any

from rpo_core.attitude.attitude_kernels import Attitude
from rpo_core.attitude.chaser import relative_to, times, turn, upright
from rpo_core.attitude.target import Quaternion
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, real, vector3, whole
from rpo_core.kernels.arithmetic import Vector, norm, sin_cos
from rpo_core.kernels.jit import as_table, inlined, kernel
from rpo_core.navigation.sensors import (
    MAX_LATENCY_TICKS,
    across,
    first_tick,
    intervals,
    key,
    three_normals,
)
from rpo_core.stage import Place, Section, Signal, Stage, register
from rpo_core.wire import interfaces

KEY, SLOTS, PERIOD, LATENCY, CROSS, ROLL, AXES = 0, 2, 3, 4, 5, 6, 7
GYRO, WALK, BIAS, LIGHT, COSINE, COUNT, OUTAGES = 16, 17, 18, 21, 24, 25, 26
"""Places in the table of `sense_attitude`. Key (2,); slots of the queue; of the star tracker period
and latency [ticks], sigma across its boresight and about it [rad], its axes (3, 3) in those of the
chaser, boresight first; of the gyro sigma and walk of a tick [rad/s], bias (3,) at tick 0; a
direction (3,) in LVLH that blinds, and the cosine of its half angle, 2 for none; how many numbers
the outages have; they, in ticks, first and end of each."""

MEASURED = 7
"""Numbers of a measurement: quaternion of the star tracker, 0, 0, 0, 0 for none; rate [rad/s]."""

DRIFT, WALKED, NOISE, QUEUE, QUEUED = 7, 10, 11, 20, 5
"""Places in its memory, after the measurement: the part (3,) of the bias that walked, the tick up
to which; the noise (9,) of this tick; then quaternions on their way, each with its tick."""

Noise = tuple[float, float, float, float, float, float, float, float, float]

START_STREAM, _STARS, _RATES, _WALKS = range(128, 132)


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
def along(s: Any, i: int, first: float, second: float, third: float) -> Vector:
    """Return a vector that has these parts along three axes, from place i of a table on."""
    return (
        first * s[i] + second * s[i + 3] + third * s[i + 6],
        first * s[i + 1] + second * s[i + 4] + third * s[i + 7],
        first * s[i + 2] + second * s[i + 5] + third * s[i + 8],
    )


@inlined
def _sees(tick: int, q: Quaternion, s: Any) -> bool:
    """Return whether the star tracker measures: its period, no outage [begin, end), no light."""
    found = tick % int(s[PERIOD]) == 0
    for i in range(OUTAGES, OUTAGES + int(s[COUNT]), 2):
        found = found and not s[i] <= tick < s[i + 1]
    x, y, z = turn((s[AXES], s[AXES + 1], s[AXES + 2]), q)
    return found and x * s[LIGHT] + y * s[LIGHT + 1] + z * s[LIGHT + 2] < s[COSINE]


@inlined
def attitude_noise(tick: int, k0: int, k1: int) -> Noise:
    """Return nine normals: of the star tracker, the gyro, the walk of its bias."""
    a, b, c = three_normals(tick, 0, _STARS, k0, k1)
    d, e, f = three_normals(tick, 0, _RATES, k0, k1)
    g, h, i = three_normals(tick, 0, _WALKS, k0, k1)
    return a, b, c, d, e, f, g, h, i


@kernel
def sense_attitude(tick: int, a: Attitude, s: Any, m: Any) -> None:
    """Fill the measurement (7,) that arrives at a tick; see `sensed_attitude`."""
    noise = attitude_noise(tick, int(s[KEY]), int(s[KEY + 1]))
    for i in range(9):
        m[NOISE + i] = noise[i]
    sensed_attitude(tick, a, s, m)


@kernel
def sensed_attitude(tick: int, a: Attitude, s: Any, m: Any) -> None:
    """Fill the measurement (7,) that arrives at a tick, with the noise that the memory has.

    a : true attitude; s : table, m : memory, see the names of their places
    """
    while s[WALK] > 0.0 and m[WALKED] < tick:
        m[WALKED] += 1.0
        steps = (m[NOISE + 6], m[NOISE + 7], m[NOISE + 8])
        if m[WALKED] < tick:
            steps = three_normals(int(m[WALKED]), 0, _WALKS, int(s[KEY]), int(s[KEY + 1]))
        for i in range(3):
            m[DRIFT + i] += s[WALK] * steps[i]
    for i in range(3):
        m[4 + i] = a[4 + i] + s[BIAS + i] + m[DRIFT + i] + s[GYRO] * m[NOISE + 3 + i]
    q = (a[0], a[1], a[2], a[3])
    slots = int(s[SLOTS])
    slot = QUEUE + QUEUED * (tick % slots)
    m[slot], m[slot + 1], m[slot + 2], m[slot + 3] = 0.0, 0.0, 0.0, 0.0
    m[slot + 4] = float(tick)
    if _sees(tick, q, s):
        n0, n1, n2 = s[ROLL] * m[NOISE], s[CROSS] * m[NOISE + 1], s[CROSS] * m[NOISE + 2]
        error = along(s, AXES, n0, n1, n2)
        m[slot], m[slot + 1], m[slot + 2], m[slot + 3] = turned_by(q, error)
    taken = tick - int(s[LATENCY])
    slot = QUEUE + QUEUED * (taken % slots)
    came = taken >= 0 and m[slot + 4] == taken
    for i in range(4):
        m[i] = m[slot + i] if came else 0.0


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


class AttitudeSensing:
    """Sensors and their memory, the tables of `sense_attitude`."""

    def __init__(self, settings: AttitudeSensors, scenario: Any) -> None:
        star, gyro, root = settings.star_tracker, settings.gyro, sqrt(scenario.dt_s)
        self._slots = star.latency_ticks + 1
        ticks = [first_tick(time, scenario) for pair in star.outages_s for time in pair]
        size = norm(*star.light)
        table = [
            *settings.noise_key,
            self._slots,
            star.period_ticks,
            star.latency_ticks,
            star.cross_noise_arcsec * ARCSEC,
            star.boresight_noise_arcsec * ARCSEC,
            *(part for axis in star.axes for part in axis),
            gyro.noise_rad_s0_5 / root,
            gyro.bias_walk_rad_s1_5 * root,
            *gyro.bias_rad_s,
            *(part / size for part in star.light),
            sin_cos(radians(star.light_deg))[1] if star.light_deg > 0.0 else 2.0,
            len(ticks),
            *ticks,
        ]
        self.table = as_table(table)
        self.reset()

    def reset(self) -> None:
        """Forget what is on its way."""
        self.memory = as_table([0.0] * QUEUE + [0.0, 0.0, 0.0, 0.0, -1.0] * self._slots)


class AttitudeSensorsStage(Stage):
    """From the true attitude to what arrives of the star tracker and the gyro."""

    name = 'attitude_sensors'
    inputs = (interfaces.CHASER_ATTITUDE,)
    outputs = (interfaces.ATTITUDE_MEASUREMENT,)

    def __init__(self, settings: AttitudeSensors, scenario: Any) -> None:
        self.memory_ticks = settings.star_tracker.latency_ticks
        self._sensing = AttitudeSensing(settings, scenario)

    def reset(self) -> None:
        """Forget what is on its way."""
        self._sensing.reset()

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the quaternion of the star tracker, zeros for none, and the rate [rad/s]."""
        s = self._sensing
        sense_attitude(tick, inputs[0], s.table, s.memory)
        return (tuple(map(float, s.memory[:MEASURED])),)

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
