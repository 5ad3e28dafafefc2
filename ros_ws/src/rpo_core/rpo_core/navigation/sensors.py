# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Sensors: what the chaser measures of the target, and when. Section `sensors`.

Each measurement is a function of the true state and of (tick, key). Sources of usual sizes: Fehse,
"Automated Rendezvous and Docking of Spacecraft", 2003, 7.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import pi, sqrt
from typing import Annotated, Any

import numpy as np

from rpo_core.attitude.attitude_kernels import to_lvlh
from rpo_core.attitude.target import Target, motion_of
from rpo_core.files.codec import unless_default
from rpo_core.files.validation import (
    Checked,
    InputError,
    choice,
    flag,
    real,
    shown,
    store,
    vector3,
    whole,
)
from rpo_core.kernels.arithmetic import Vector, sin_cos
from rpo_core.kernels.jit import as_table
from rpo_core.navigation.navigation_errors import MAX_POSITION_ERROR_M, MAX_VELOCITY_ERROR_M_S, key
from rpo_core.navigation.sensor_kernels import (
    COLUMNS,
    MEASURED,
    NOISE,
    UNITS,
    describe,
    port_at,
    sense,
)
from rpo_core.stage import Place, Section, Signal, Stage, register
from rpo_core.wire import interfaces
from rpo_core.world.zones import Zones

MAX_SENSORS = 4
MAX_LATENCY_TICKS = 100
MAX_OUTAGES = 100
POSITION, RANGE_BEARING, BEARING = 'relative_position', 'range_bearing', 'bearing'
KINDS = (POSITION, RANGE_BEARING, BEARING)
CENTRE, PORT = 'centre', 'port'

NOISES = (
    'noise_floor_m',
    'noise_share',
    'bearing_noise_rad',
    'velocity_floor_m_s',
    'velocity_share_1_s',
)
"""Fields of a sensor that scale its noise."""

MEASUREMENTS = ('measurement', *(f'measurement_{i}' for i in range(2, MAX_SENSORS + 1)))
"""Signals, one of each sensor."""

for _name in MEASUREMENTS:
    interfaces.add(
        interfaces.Interface(
            _name,
            interfaces.STATE_TYPE,
            'what a sensor measured, with its covariance; -1 as the first one: nothing',
            covariance=True,
            also=interfaces.CHASER_FRAME,
        ),
        before=interfaces.NAVIGATION_STATE,
    )


def intervals(name: str, value: Any) -> tuple[tuple[float, float], ...]:
    """Return intervals [begin, end) of flight time [s]; raises InputError."""
    if not isinstance(value, (list, tuple)) or len(value) > MAX_OUTAGES:
        raise InputError(
            f'`{name}` must be a list of at most {MAX_OUTAGES} intervals [begin, end] in s; '
            f'got {shown(value)}'
        )
    found = []
    for i, pair in enumerate(value):
        if not isinstance(pair, (list, tuple)) or len(pair) != 2:
            raise InputError(f'`{name}[{i}]` must be [begin, end] in s; got {shown(pair)}')
        begin = real(f'{name}[{i}][0]', pair[0], 's', least=0.0)
        found.append((begin, real(f'{name}[{i}][1]', pair[1], 's', above=begin)))
    return tuple(found)


_metres = partial(real, unit='m', least=0.0, most=MAX_POSITION_ERROR_M)
_share = partial(real, least=0.0, most=1.0)
_speed = partial(real, unit='m/s', least=0.0, most=MAX_VELOCITY_ERROR_M_S)
_vector = partial(vector3, unit='m', bound=MAX_POSITION_ERROR_M)
_velocity = partial(vector3, unit='m/s', bound=MAX_VELOCITY_ERROR_M_S)
_direction = partial(vector3, unit='', bound=1e6)


@dataclass(frozen=True)
class Sensor(Checked):
    """One sensor. Noise is white; its sigma is the larger one of a floor and a share of the range.

    kind : `relative_position` (each axis alike), `range_bearing` (a lidar, a camera that knows the
        size of the target) or `bearing` (a camera that does not)
    noise_floor_m, noise_share : sigma of each axis, or along the line of sight
    bearing_noise_rad : sigma across the line of sight; `noise_floor_m` is the floor of that too
    velocity_floor_m_s, velocity_share_1_s : sigma of velocity, by range; both 0: not measured
    bias_m : (3,) added to the position; bias_walk_m_s0_5 : per root of a second, each axis
    velocity_bias_m_s : (3,) added to the velocity, where that is measured
    scale_error : share by which distances are too long
    period_ticks, latency_ticks : between measurements; from a measurement to its arrival
    dropout_share : probability that a measurement does not come
    boresight : (3,) axis of the field of view, from the chaser, target LVLH
    body_fixed : whether boresight, bias and measurement are in the axes of the chaser, which turn
    looks_at : the target's `centre`, or the `port`, as the target's attitude puts it: the chaser
        is measured from there
    field_of_view_rad : half angle about the boresight; pi: there is no limit
    outages_s : intervals [begin, end) of flight time without measurements
    outlier_share : probability of an outlier; outlier_size_m : sigma of it, each axis
    """

    kind: Annotated[str, partial(choice, known=KINDS)]
    noise_floor_m: Annotated[float, _metres] = 0.01
    noise_share: Annotated[float, _share] = 0.0
    bearing_noise_rad: Annotated[float, _share] = 0.0
    velocity_floor_m_s: Annotated[float, _speed] = 0.0
    velocity_share_1_s: Annotated[float, _share] = 0.0
    bias_m: Annotated[Vector, _vector] = (0.0, 0.0, 0.0)
    bias_walk_m_s0_5: Annotated[float, _metres] = 0.0
    scale_error: Annotated[float, partial(real, above=-1.0, most=1.0)] = 0.0
    period_ticks: Annotated[int, partial(whole, least=1, most=1_000_000)] = 1
    latency_ticks: Annotated[int, partial(whole, least=0, most=MAX_LATENCY_TICKS)] = 0
    dropout_share: Annotated[float, partial(real, least=0.0, below=1.0)] = 0.0
    boresight: Annotated[Vector, _direction] = (0.0, 1.0, 0.0)
    field_of_view_rad: Annotated[float, partial(real, unit='rad', above=0.0, most=pi)] = pi
    outages_s: Annotated[tuple[tuple[float, float], ...], intervals] = ()
    outlier_share: Annotated[float, partial(real, least=0.0, below=1.0)] = 0.0
    outlier_size_m: Annotated[float, _metres] = 0.0
    velocity_bias_m_s: Annotated[Vector, _velocity] = unless_default((0.0, 0.0, 0.0))
    body_fixed: Annotated[bool, flag] = unless_default(False)
    looks_at: Annotated[str, partial(choice, known=(CENTRE, PORT))] = unless_default(CENTRE)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.noise_floor_m <= 0.0:
            raise InputError('`noise_floor_m` must be > 0 m: a covariance must be positive; got 0')
        if self.kind == POSITION and self.bearing_noise_rad > 0.0:
            raise InputError('`bearing_noise_rad` must be 0 for a sensor of relative_position')
        if self.kind == BEARING and self.bearing_noise_rad == 0.0:
            raise InputError('`bearing_noise_rad` must be > 0 rad for a sensor of bearing; got 0')
        if self.kind == BEARING and self.noise_share > 0.0:
            raise InputError('`noise_share` must be 0 for a sensor of bearing: it has no range')
        if self.velocity_share_1_s > 0.0 and self.velocity_floor_m_s == 0.0:
            raise InputError('`velocity_floor_m_s` must be > 0 m/s where velocity is measured')
        if self.kind != POSITION and self.velocity_floor_m_s > 0.0:
            raise InputError('`velocity_floor_m_s` must be 0 but for a sensor of relative_position')
        if any(self.velocity_bias_m_s) and self.velocity_floor_m_s == 0.0:
            raise InputError('`velocity_bias_m_s` must be 0 where velocity is not measured')
        if self.kind == POSITION and self.body_fixed:
            raise InputError('`body_fixed` must be false for a sensor of relative_position')
        if self.kind == POSITION and self.looks_at != CENTRE:
            raise InputError('`looks_at` must be centre for a sensor of relative_position')
        if not any(self.boresight):
            raise InputError('`boresight` must have a direction; got [0, 0, 0]')

    def row(self, dt_s: float) -> list[float]:
        """Return the sensor as the kernels read it."""
        x, y, z = self.boresight
        size = sqrt(x * x + y * y + z * z)
        limited = self.field_of_view_rad < pi
        return [
            self.noise_floor_m,
            self.noise_share,
            self.noise_share if self.kind == POSITION else self.bearing_noise_rad,
            self.velocity_floor_m_s,
            self.velocity_share_1_s,
            float(self.kind != BEARING),
            float(self.velocity_floor_m_s > 0.0),
            *self.bias_m,
            self.bias_walk_m_s0_5 * sqrt(dt_s),
            1.0 + self.scale_error,
            float(self.period_ticks),
            float(self.latency_ticks),
            self.dropout_share * 2**32,
            self.outlier_share * 2**32,
            self.outlier_size_m,
            sin_cos(self.field_of_view_rad)[1] if limited else -2.0,
            x / size,
            y / size,
            z / size,
            *self.velocity_bias_m_s,
            float(self.body_fixed),
            float(self.looks_at == PORT),
        ]


@dataclass(frozen=True)
class Sensors(Checked):
    """The sensors of a chaser.

    noise_key : two words of 32 bits, the key of Philox4x32-10, for all of them and for the start of
        the estimator
    port_m : (3,) in the target's axes, where a sensor looks at it; as in section `zones`, unless it
        differs
    """

    units: tuple[Sensor, ...]
    noise_key: Annotated[tuple[int, int], key] = (0, 0)
    port_m: Annotated[Vector, partial(vector3, unit='m', bound=1e4)] = unless_default(
        (0.0, 0.0, 0.0)
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= len(self.units) <= MAX_SENSORS:
            raise InputError(f'`units` must be 1 to {MAX_SENSORS} sensors; got {len(self.units)}')
        store(self, units=tuple(self.units))
        if self.look and not any(self.port_m):
            raise InputError('`looks_at` port needs `port_m`, or that of section `zones`')

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the signals, one of each sensor."""
        return MEASUREMENTS[: len(self.units)]

    @property
    def own_axes(self) -> tuple[str, ...]:
        """Names of the signals whose numbers are in the chaser's axes."""
        pairs = zip(self.signals, self.units, strict=True)
        return tuple(name for name, unit in pairs if unit.body_fixed)

    @property
    def turn(self) -> bool:
        """Whether one of them turns with the chaser."""
        return any(unit.body_fixed for unit in self.units)

    @property
    def look(self) -> bool:
        """Whether one of them looks at the port."""
        return any(unit.looks_at == PORT for unit in self.units)

    @staticmethod
    def of_zones(document: Any, zones: Zones) -> dict[str, Any]:
        """Return the fields that are as the zones of the scenario, unless the section has them."""
        units = document.get('units') if isinstance(document, Mapping) else None
        known = [u for u in units or () if isinstance(u, Mapping) and u.get('looks_at') == PORT]
        return {'port_m': list(zones.port_m)} if known else {}


STILL = Target(kind='fixed')
"""In place of a target without attitude: its axes are those of target LVLH."""


class PortSeen:
    """Where the port is, tick by tick, target LVLH.

    known : by the attitude that the chaser takes the target to have; else by the true one
    """

    def __init__(self, settings: Sensors, scenario: Any, *, known: bool = False) -> None:
        target = scenario.target or STILL
        self._port = settings.port_m
        motion = motion_of(target.known if known else target, scenario)
        self._motion = motion if settings.look else None

    def put(self, tick: int, table: Any, at: int) -> None:
        """Put the port (3,) [m] into a table, from a place on; nothing where no sensor looks."""
        if self._motion is not None:
            port = to_lvlh(self._port, self._motion.frame(tick))
            table[at], table[at + 1], table[at + 2] = port


class Sensing:
    """Sensors and their memory, tables of `rpo_core.navigation.sensor_kernels.sense`."""

    def __init__(self, settings: Sensors, scenario: Any) -> None:
        units = settings.units
        self.rows = [unit.row(scenario.dt_s) for unit in units]
        self._slots = max(unit.latency_ticks for unit in units) + 1
        most = 2 * max(len(unit.outages_s) for unit in units)
        table: list[float] = [len(units), self._slots, most, *settings.noise_key]
        for row in self.rows:
            table += row
        for unit in units:
            ticks = [first_tick(time, scenario) for pair in unit.outages_s for time in pair]
            table += [*ticks, *[0] * (most - len(ticks))]
        self.table = as_table(table)
        self.reset()

    def reset(self) -> None:
        """Forget what is on its way."""
        count = len(self.rows)
        walks, queues = [0.0, 0.0, 0.0, -1.0], [-1.0] * (MEASURED + 1) * self._slots
        numbers = [0.0] * MEASURED * count + walks * count + queues * count
        self.memory = as_table(numbers + [0.0] * (NOISE * count + 3))


def first_tick(time_s: float, scenario: Any) -> int:
    """Return the first tick at a time or after it."""
    return min(-(-round(time_s * 1e9) // scenario.dt_ns), 2**31)


class SensorsStage(Stage):
    """From the true state to the measurements that arrive."""

    name = 'sensors'
    inputs: tuple[str, ...] = (interfaces.RELATIVE_STATE,)

    def __init__(self, settings: Sensors, scenario: Any) -> None:
        self.outputs = settings.signals
        if settings.turn:
            self.inputs = (interfaces.RELATIVE_STATE, interfaces.CHASER_ATTITUDE)
        self.memory_ticks = max(unit.latency_ticks for unit in settings.units)
        self._sensing = Sensing(settings, scenario)
        self._port, self._place = PortSeen(settings, scenario), port_at(self._sensing.table)
        self._message = as_table(np.zeros(24))

    def reset(self) -> None:
        """Forget what is on its way."""
        self._sensing.reset()

    def step(self, tick: int, *inputs: Any) -> tuple[Signal, ...]:
        """Return the measurement (24,) of each sensor; see `sensor_kernels.describe`."""
        s, attitude = self._sensing, inputs[1] if len(inputs) > 1 else interfaces.ALIGNED
        self._port.put(tick, s.memory, self._place)
        sense(tick, inputs[0], attitude[:4], s.table, s.memory)
        found = []
        for i in range(len(s.rows)):
            sensor = s.table[UNITS + COLUMNS * i : UNITS + COLUMNS * (i + 1)]
            describe(sensor, s.memory[MEASURED * i : MEASURED * (i + 1)], self._message)
            found.append(tuple(map(float, self._message)))
        return tuple(found)

    def passes_on(self) -> tuple[int | Signal, ...]:
        """Return that each measurement is the true state."""
        return (0,) * len(self.outputs)


def _check(settings: Sensors, scenario: Any) -> None:
    """Raise InputError if a sensor never measures in a flight of the scenario."""
    for i, unit in enumerate(settings.units):
        place = f'`sensors.units[{i}]`'
        if unit.body_fixed and scenario.attitude is None:
            raise InputError(f'{place}: `body_fixed` needs section `attitude`; it is missing')
        if unit.latency_ticks > scenario.ticks:
            raise InputError(
                f'{place}: `latency_ticks` must be at most {scenario.ticks}, the length of the '
                f'flight; got {unit.latency_ticks}'
            )
        last = scenario.ticks - unit.latency_ticks
        end = 0
        for begin, until in sorted(unit.outages_s):
            if -(-first_tick(begin, scenario) // unit.period_ticks) * unit.period_ticks > end:
                break
            end = max(end, first_tick(until, scenario))
            end = -(-end // unit.period_ticks) * unit.period_ticks
        if end > last:
            raise InputError(f'{place}: `outages_s` must leave time to measure; they leave none')


register(Section('sensors', Sensors, Place.SENSOR, SensorsStage, _check, of_zones=Sensors.of_zones))
