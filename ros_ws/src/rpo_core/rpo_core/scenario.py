# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios: what flies, from where, for how long. The one source of dt."""

from __future__ import annotations

import datetime
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core import cw, files
from rpo_core.disturbance import NONE, Disturbance, Harmonic, paper
from rpo_core.kernels import CwStep
from rpo_core.validation import InputError, choice, mapping, real, shown, text, vector3

SCHEMA = 'rpo/scenario/1'
SET_SCHEMA = 'rpo/scenario_set/1'

NANOSECONDS = 1_000_000_000

DISTURBANCES = ('none', 'paper_offset', 'paper_phase')
"""Presets of the field `disturbance`."""

MAX_TICKS = 100_000_000
MAX_POSITION_M = 100_000.0
MAX_VELOCITY_M_S = 1_000.0

_COMMON = ('schema', 'name', 'description', 'orbit_radius_m', 'mass_kg', 'max_force_n', 'dt_s',
           'duration_s', 'initial_velocity_m_s', 'epoch', 'disturbance')


@dataclass(frozen=True)
class Scenario:
    """One flight: target orbit, chaser, times, start and disturbance.

    initial_position_m, initial_velocity_m_s : (3,) target LVLH
    epoch_ns : int, UTC nanoseconds since 1970 of tick 0
    """

    name: str
    orbit_radius_m: float
    mass_kg: float
    max_force_n: float
    dt_s: float
    duration_s: float
    initial_position_m: tuple[float, float, float]
    initial_velocity_m_s: tuple[float, float, float]
    epoch_ns: int
    disturbance: Disturbance = NONE
    description: str = field(default='', compare=False)

    def __post_init__(self) -> None:
        real('orbit_radius_m', self.orbit_radius_m, 'm', least=6.4e6, most=1e9)
        real('mass_kg', self.mass_kg, 'kg', above=0.0)
        real('max_force_n', self.max_force_n, 'N', above=0.0)
        real('dt_s', self.dt_s, 's', least=1e-6, most=1e3)
        real('duration_s', self.duration_s, 's', above=0.0)
        vector3('initial_position_m', self.initial_position_m, 'm', bound=MAX_POSITION_M)
        vector3('initial_velocity_m_s', self.initial_velocity_m_s, 'm/s', bound=MAX_VELOCITY_M_S)
        if abs(self.dt_s * NANOSECONDS - self.dt_ns) > 1e-3:
            raise InputError('`dt_s` must be a whole number of nanoseconds, the tick of a stamp; '
                             f'got {self.dt_s!r}')
        duration_ns = round(self.duration_s * NANOSECONDS)
        if duration_ns % self.dt_ns != 0 or duration_ns < self.dt_ns:
            raise InputError(f'`duration_s` must be a multiple of `dt_s` = {self.dt_s!r} s; '
                             f'got {self.duration_s!r}')
        if self.ticks > MAX_TICKS:
            raise InputError(f'`duration_s` must be at most {MAX_TICKS} ticks of `dt_s`; '
                             f'got {self.ticks}')

    @property
    def dt_ns(self) -> int:
        """Tick length [ns]."""
        return round(self.dt_s * NANOSECONDS)

    @property
    def ticks(self) -> int:
        """Number of steps N; states are numbered 0..N."""
        return round(self.duration_s * NANOSECONDS) // self.dt_ns

    @property
    def mean_motion_rad_s(self) -> float:
        """Mean motion of the target."""
        return cw.mean_motion(self.orbit_radius_m)

    @property
    def start(self) -> tuple[float, ...]:
        """Initial state (x, y, z, vx, vy, vz) [m, m/s], target LVLH."""
        return (*self.initial_position_m, *self.initial_velocity_m_s)

    @cached_property
    def step(self) -> CwStep:
        """Exact discretisation of the relative dynamics for one tick."""
        return cw.discretise(self.mean_motion_rad_s, self.mass_kg, self.dt_s)

    def time_s(self, tick: int) -> float:
        """Time since the start; one rounding, never a sum."""
        return tick * self.dt_ns / NANOSECONDS

    def stamp_ns(self, tick: int) -> int:
        """UTC nanoseconds since 1970 of a tick."""
        return self.epoch_ns + tick * self.dt_ns

    def tick_of(self, stamp_ns: int) -> int | None:
        """Return the tick of a stamp, None if it is not the stamp of any tick of this run."""
        tick, rest = divmod(stamp_ns - self.epoch_ns, self.dt_ns)
        return tick if rest == 0 and 0 <= tick <= self.ticks else None

    @property
    def times_s(self) -> NDArray[np.float64]:
        """Times (N + 1,) [s] of the states."""
        return np.array([self.time_s(tick) for tick in range(self.ticks + 1)])


@dataclass(frozen=True)
class ScenarioSet:
    """Scenarios that differ in their initial position: all combinations of one list per axis."""

    base: Scenario
    axis_positions_m: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.axis_positions_m:
            raise InputError('`initial_position_axis_m` must hold at least one position; got none')
        for i, position in enumerate(self.axis_positions_m):
            real(f'initial_position_axis_m[{i}]', position, 'm', least=-MAX_POSITION_M,
                 most=MAX_POSITION_M)

    @property
    def name(self) -> str:
        """Name of the set."""
        return self.base.name

    @property
    def initial_positions_m(self) -> NDArray[np.float64]:
        """Starts (len^3, 3) [m], target LVLH, z fastest."""
        return np.array(list(itertools.product(self.axis_positions_m, repeat=3)))

    def scenarios(self) -> list[Scenario]:
        """Return every member, named <set>_<index>."""
        return [replace(self.base, name=f'{self.name}_{index}',
                        initial_position_m=tuple(map(float, start)))
                for index, start in enumerate(self.initial_positions_m)]


def parse(document: Any) -> Scenario | ScenarioSet:
    """Return the scenario, or set, of a parsed YAML document; raises InputError."""
    schema = document.get('schema') if isinstance(document, Mapping) else None
    is_set = schema == SET_SCHEMA
    start = 'initial_position_axis_m' if is_set else 'initial_position_m'
    data = mapping('', document, [*(name for name in _COMMON if name != 'description'), start],
                   ['description'])
    if schema not in (SCHEMA, SET_SCHEMA):
        raise InputError(f'`schema` must be {SCHEMA} or {SET_SCHEMA}; got {shown(schema)}')
    radius = real('orbit_radius_m', data['orbit_radius_m'], 'm', least=6.4e6, most=1e9)
    position = ((0.0, 0.0, 0.0) if is_set else
                vector3('initial_position_m', data[start], 'm', bound=MAX_POSITION_M))
    base = Scenario(
        name=text('name', data['name']),
        description=text('description', data.get('description', ''), empty=True),
        orbit_radius_m=radius,
        mass_kg=real('mass_kg', data['mass_kg'], 'kg', above=0.0),
        max_force_n=real('max_force_n', data['max_force_n'], 'N', above=0.0),
        dt_s=real('dt_s', data['dt_s'], 's', least=1e-6, most=1e3),
        duration_s=real('duration_s', data['duration_s'], 's', above=0.0),
        initial_position_m=position,
        initial_velocity_m_s=vector3('initial_velocity_m_s', data['initial_velocity_m_s'], 'm/s',
                                     bound=MAX_VELOCITY_M_S),
        epoch_ns=_epoch_ns(data['epoch']),
        disturbance=_disturbance(data['disturbance'], cw.mean_motion(radius)),
    )
    if not is_set:
        return base
    positions = data[start]
    if not isinstance(positions, list):
        raise InputError(f'`{start}` must be a list of positions in m; got {shown(positions)}')
    return ScenarioSet(base, tuple(real(f'{start}[{i}]', value, 'm')
                                   for i, value in enumerate(positions)))


def _epoch_ns(value: Any) -> int:
    if isinstance(value, datetime.datetime):
        moment = value.replace(tzinfo=value.tzinfo or datetime.timezone.utc)
        since = moment - datetime.datetime(1970, 1, 1, tzinfo=datetime.timezone.utc)
        nanoseconds = (since // datetime.timedelta(microseconds=1)) * 1000
        if 0 < nanoseconds < 2**31 * NANOSECONDS:  # the range of a ROS stamp
            return nanoseconds
    raise InputError('`epoch` must be a UTC date and time between 1970 and 2038 like '
                     f'2026-01-01T00:00:00Z; got {shown(value)}')


def _disturbance(value: Any, mean_motion_rad_s: float) -> Disturbance:
    if isinstance(value, str):
        preset = choice('disturbance', value, DISTURBANCES)
        return NONE if preset == 'none' else paper(preset.split('_')[1], mean_motion_rad_s)
    data = mapping('disturbance', value, ['constant_n', 'harmonics'])
    if not isinstance(data['harmonics'], list):
        raise InputError('`disturbance.harmonics` must be a list; '
                         f'got {shown(data["harmonics"])}')
    return Disturbance(
        vector3('disturbance.constant_n', data['constant_n'], 'N', bound=1e6),
        tuple(_harmonic(i, term) for i, term in enumerate(data['harmonics'])),
    )


def _harmonic(index: int, value: Any) -> Harmonic:
    name = f'disturbance.harmonics[{index}]'
    data = mapping(name, value, ['axis', 'function', 'amplitude_n', 'angular_rate_rad_s'],
                   ['phase_rad'])
    try:
        return Harmonic(
            data['axis'], data['function'], real('amplitude_n', data['amplitude_n'], 'N'),
            real('angular_rate_rad_s', data['angular_rate_rad_s'], 'rad/s'),
            real('phase_rad', data.get('phase_rad', 0.0), 'rad'))
    except InputError as error:
        raise InputError(f'{name}: {error}') from None


def load(name: str | Path) -> Scenario | ScenarioSet:
    """Return the scenario or set of a shipped name or a path; raises InputError."""
    return files.load(files.find('scenario', str(name)), parse)


def load_scenario(name: str | Path) -> Scenario:
    """Return one scenario; a set is refused, since one run flies one start."""
    found = load(name)
    if isinstance(found, ScenarioSet):
        count = len(found.axis_positions_m) ** 3
        raise InputError(f'`scenario` must be a single flight; {name} is a set of {count}')
    return found


def load_set(name: str | Path) -> ScenarioSet:
    """Return a set of scenarios; a single one is refused."""
    found = load(name)
    if isinstance(found, Scenario):
        raise InputError(f'`scenario` must be a set ({SET_SCHEMA}); {name} is a single flight')
    return found
