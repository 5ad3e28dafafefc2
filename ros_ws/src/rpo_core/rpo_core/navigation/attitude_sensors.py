# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A star tracker and a gyro: what the chaser measures of its attitude. Section `attitude_sensors`.

Both are functions of the true attitude and of (tick, key). Source of usual sizes: Markley and
Crassidis, "Fundamentals of Spacecraft Attitude Determination and Control", 2014, 4.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import pi, radians, sqrt
from typing import Annotated, Any

from rpo_core.files.codec import unless_default
from rpo_core.files.validation import Checked, InputError, real, vector3, whole
from rpo_core.kernels.arithmetic import Vector, norm, sin_cos
from rpo_core.kernels.jit import as_table
from rpo_core.navigation.attitude_sensor_kernels import MEASURED, QUEUE, sense_attitude
from rpo_core.navigation.navigation_errors import key
from rpo_core.navigation.sensor_kernels import across
from rpo_core.navigation.sensors import MAX_LATENCY_TICKS, first_tick, intervals
from rpo_core.stage import Place, Section, Signal, Stage, register
from rpo_core.wire import interfaces

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
    """Sensors and their memory, tables of `attitude_sensor_kernels.sense_attitude`."""

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
