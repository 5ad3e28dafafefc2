# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios: what flies, from where, for how long. The one source of dt."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from math import hypot
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar

import numpy as np
import yaml
from numpy.typing import NDArray

from rpo_core import files
from rpo_core.files import codec
from rpo_core.files.validation import (
    Checked,
    Description,
    InputError,
    Name,
    choice,
    mapping,
    real,
    schema,
    shown,
    store,
    vector3,
)
from rpo_core.kernels.arithmetic import MAX_ANGLE_RAD, State, Vector
from rpo_core.scenario import requirements
from rpo_core.scenario.requirements import Requirements
from rpo_core.stage import Section, section_of, sections
from rpo_core.world import cw, starts
from rpo_core.world.cw import CwStep
from rpo_core.world.disturbance import MAX_FORCE_N, NONE, Disturbance, paper
from rpo_core.world.starts import MAX_POSITION_M, Starts
from rpo_core.world.zones import Zones, filled, without

Settings = TypeVar('Settings')

SCHEMA = 'rpo/scenario/1'
SET_SCHEMA = 'rpo/scenario_set/1'
SET_SECTIONS = ('guidance',)
"""Stages that the flights of a set may have."""

NANOSECONDS = 1_000_000_000

DISTURBANCES = ('none', 'paper_offset', 'paper_phase')
"""Presets of the field `disturbance`."""

MAX_TICKS = 10_000_000
MAX_VELOCITY_M_S = 1_000.0
AT_TARGET: Vector = (0.0, 0.0, 0.0)

_STAMP_END_NS = 2**31 * NANOSECONDS  # the seconds of a ROS stamp are an int32

_OPTIONAL = ('goal_position_m', 'body', 'zones', 'requirements', 'description')
_FIELDS = ('orbit_radius_m', 'mass_kg', 'max_force_n', 'dt_s', 'duration_s', 'initial_velocity_m_s')


class Goal(NamedTuple):
    """A goal away from the target.

    position_m : (3,) target LVLH
    force_n : (3,) that the controller's command gets on top, to rest there
    """

    position_m: Vector
    force_n: Vector


@dataclass(frozen=True, repr=False)
class Scenario(Checked):
    """One flight: target orbit, chaser, times, start and disturbance; frozen.

    `rpo.scenario(name, **changes)` returns one with fields changed.

    Parameters
    ----------
    name : str
        How files, logs and tables name it.
    orbit_radius_m : float
        Radius of the target's circular orbit.
    mass_kg, max_force_n : float
        Mass of the chaser; largest force of its thrusters on an axis.
    dt_s, duration_s : float
        Length of a tick, and of the flight: a whole number of ticks.
    initial_position_m, initial_velocity_m_s : tuple of 3 floats
        Start, target LVLH.
    epoch_ns : int
        UTC nanoseconds since 1970 of tick 0.
    disturbance : Disturbance
        Force from outside; none by default.
    sections : tuple
        Settings of stages that are not the identity (`rpo_core.stage.sections`).
    goal_position_m : tuple of 3 floats
        Where the chaser shall come to rest; in the axes of section `target`, where the scenario has
        it, as zones and requirements are, else in target LVLH.
    body : Body
        What the target orbits; the Earth by default.
    description : str
        What it is, in a sentence.
    zones : Zones, optional
        As the file states them; sections have taken theirs from there.
    requirements : Requirements, optional
        What flights are judged by; None: they are not judged.

    Raises
    ------
    InputError
        If a field is out of range, or sections do not fit each other.

    Examples
    --------
    >>> import rpo
    >>> scenario = rpo.scenario('paper_test')
    >>> scenario.mass_kg, scenario.ticks
    (10.0, 4000)
    """

    name: Name
    orbit_radius_m: float
    mass_kg: cw.Mass
    max_force_n: Annotated[float, partial(real, unit='N', above=0.0, most=MAX_FORCE_N)]
    dt_s: cw.TickLength
    duration_s: Annotated[float, partial(real, unit='s', above=0.0, most=1e9)]
    initial_position_m: Annotated[Vector, partial(vector3, unit='m', bound=MAX_POSITION_M)]
    initial_velocity_m_s: Annotated[Vector, partial(vector3, unit='m/s', bound=MAX_VELOCITY_M_S)]
    epoch_ns: int
    disturbance: Disturbance = NONE
    sections: tuple[Any, ...] = ()
    goal_position_m: Annotated[Vector, partial(vector3, unit='m', bound=MAX_POSITION_M)] = AT_TARGET
    body: cw.Body = cw.EARTH
    description: Description = field(default='', compare=False)
    zones: Zones | None = field(default=None, compare=False)  # neither changes a flight
    requirements: Requirements | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        store(self, orbit_radius_m=cw.orbit_radius(self.orbit_radius_m, self.body))
        self._check_sections()
        self._check_ticks()
        self._check_angles()

    def __repr__(self) -> str:
        names = ', '.join(section_of(settings).name for settings in self.sections)
        start = ', '.join(f'{r:g}' for r in self.initial_position_m)
        return (
            f'<Scenario {self.name}: {self.duration_s:g} s from [{start}] m, {self.mass_kg:g} kg'
            f'{"; " if names else ""}{names}>'
        )

    def _check_sections(self) -> None:
        """Put the sections in the order of the chain."""
        if not self.sections and self.requirements is None:
            return  # without importing the modules of all sections
        known = list(sections().values())  # of one place, in the order of registration
        found = {id(s): section_of(s) for s in self.sections}
        order = sorted(self.sections, key=lambda s: (found[id(s)].place, known.index(found[id(s)])))
        if len({type(settings) for settings in order}) < len(order):
            raise InputError('`sections` must hold settings of each kind once')
        store(self, sections=tuple(order))
        for settings in order:
            section = found[id(settings)]
            if section.needs is not None and self.named(section.needs[0]) is None:
                name, what = section.needs
                raise InputError(f'`{section.name}` must have {what}: `{name}` is missing')
            if section.check is not None:
                section.check(settings, self)
        if self.requirements is not None:
            self.requirements.check_scenario(self.thrusters, self.attitude)

    def _check_ticks(self) -> None:
        if abs(self.dt_s * NANOSECONDS - self.dt_ns) > 1e-3:
            raise InputError(
                '`dt_s` must be a whole number of nanoseconds, the tick of a stamp; '
                f'got {self.dt_s!r}'
            )
        duration_ns = round(self.duration_s * NANOSECONDS)
        if duration_ns % self.dt_ns != 0 or duration_ns < self.dt_ns:
            raise InputError(
                f'`duration_s` must be a multiple of `dt_s` = {self.dt_s!r} s; '
                f'got {self.duration_s!r}'
            )
        if self.ticks > MAX_TICKS:
            raise InputError(
                f'`duration_s` must be at most {MAX_TICKS} ticks of `dt_s`; got {self.ticks}'
            )
        if not 0 < self.epoch_ns <= self.stamp_ns(self.ticks) < _STAMP_END_NS:
            raise InputError(
                '`epoch` and the end of the flight must lie between 1970 and '
                '2038-01-19, the range of a ROS stamp; got '
                f'{self.epoch_ns / NANOSECONDS!r} s since 1970, and '
                f'`duration_s` = {self.duration_s!r}'
            )

    def _check_angles(self) -> None:
        for i, term in enumerate(self.disturbance.harmonics):
            angle = abs(term.angular_rate_rad_s) * self.duration_s + abs(term.phase_rad)
            if angle >= MAX_ANGLE_RAD:
                raise InputError(
                    f'`disturbance.harmonics[{i}]` must turn less than '
                    f'{MAX_ANGLE_RAD:g} rad in the flight; got {angle!r}'
                )

    def section(self, kind: type[Settings]) -> Settings | None:
        """Return the settings of a stage, None where it is the identity."""
        return next((found for found in self.sections if type(found) is kind), None)

    def named(self, section: str) -> Any:
        """Return the settings of the section of a name, None where the scenario has none."""
        return next((found for found in self.sections if section_of(found).name == section), None)

    @cached_property
    def dynamics(self) -> Any:
        """How chaser and target move; None: as Clohessy and Wiltshire say."""
        return self.named('dynamics')

    @cached_property
    def thrusters(self) -> Any:
        """Thrusters with a delay or a matrix; None: saturation alone."""
        return self.named('thrusters')

    @cached_property
    def target(self) -> Any:
        """How the target turns (`rpo_core.attitude`); None: its axes are those of target LVLH."""
        return self.named('target')

    @cached_property
    def attitude(self) -> Any:
        """How the chaser turns (`rpo_core.attitude`); None: its axes are those of target LVLH."""
        return self.named('attitude')

    def seen(self, states: NDArray[np.float64], first: int = 0) -> NDArray[np.float64]:
        """Return states (n, 6) of the ticks from `first` on in the axes of the target."""
        return states if self.target is None else self.target.seen(states, self, first)

    def equipped(self, *settings: Any) -> Scenario:
        """Return the scenario with these settings of stages, in place of any of their kind."""
        return replace(self, sections=self.sections_with(*settings))

    def sections_with(self, *settings: Any) -> tuple[Any, ...]:
        """Return its sections with these, in place of any of their kind."""
        kinds = {type(new) for new in settings}
        return (*(old for old in self.sections if type(old) not in kinds), *settings)

    @cached_property
    def dt_ns(self) -> int:
        """Tick length [ns]."""
        return round(self.dt_s * NANOSECONDS)

    @cached_property
    def ticks(self) -> int:
        """Number of steps N; states are numbered 0..N."""
        return round(self.duration_s * NANOSECONDS) // self.dt_ns

    @property
    def mean_motion_rad_s(self) -> float:
        """Mean motion of the target."""
        return cw.mean_motion(self.orbit_radius_m, self.body)

    @property
    def goal(self) -> Goal | None:
        """The goal, and the force that holds the chaser there; None: the target itself."""
        if not any(self.goal_position_m):
            return None
        position_m, n = self.goal_position_m, self.mean_motion_rad_s
        return Goal(position_m, cw.holding_force_n(position_m, n, self.mass_kg))

    @property
    def compensated(self) -> bool:
        """Whether the controller opposes the disturbance that its estimator finds."""
        return any(getattr(settings, 'compensate', False) for settings in self.sections)

    @property
    def goal_state(self) -> State:
        """State (6,) [m, m/s] at rest at the goal."""
        return (*self.goal_position_m, 0.0, 0.0, 0.0)

    def from_goal(self, state: Sequence[float]) -> State:
        """Return a state (6,) [m, m/s] relative to the goal."""
        (gx, gy, gz), (x, y, z, vx, vy, vz) = self.goal_position_m, state
        return x - gx, y - gy, z - gz, vx, vy, vz

    @property
    def start(self) -> State:
        """Initial state (x, y, z, vx, vy, vz) [m, m/s], target LVLH."""
        return (*self.initial_position_m, *self.initial_velocity_m_s)

    def starting_at(self, state: Sequence[float]) -> Scenario:
        """Return the scenario from another initial state (6,) [m, m/s]."""
        x, y, z, vx, vy, vz = state
        return replace(self, initial_position_m=(x, y, z), initial_velocity_m_s=(vx, vy, vz))

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

    @cached_property
    def times_s(self) -> NDArray[np.float64]:
        """Times (N + 1,) [s] of the states."""
        return np.array([self.time_s(tick) for tick in range(self.ticks + 1)])

    @cached_property
    def disturbances_n(self) -> NDArray[np.float64]:
        """Disturbance forces (N + 1, 3), target LVLH, at the times of the states; read-only."""
        found = self.disturbance.over(range(self.ticks + 1), self.dt_ns)
        found.setflags(write=False)
        return found


@dataclass(frozen=True)
class ScenarioSet:
    """Scenarios that differ in their initial position."""

    base: Scenario
    starts: Starts

    @property
    def name(self) -> str:
        """Name of the set."""
        return self.base.name

    @property
    def initial_positions_m(self) -> NDArray[np.float64]:
        """Starts (n, 3) [m], target LVLH."""
        return self.starts.positions_m

    @property
    def farthest(self) -> Scenario:
        """The member that begins farthest from the target."""
        x, y, z = max(self.initial_positions_m.tolist(), key=lambda r: hypot(*r))
        return replace(self.base, initial_position_m=(x, y, z))

    def scenarios(self) -> list[Scenario]:
        """Return every member, named <set>_<index>."""
        return [
            replace(self.base, name=f'{self.name}_{index}', initial_position_m=(x, y, z))
            for index, (x, y, z) in enumerate(self.initial_positions_m.tolist())
        ]


def bare(document: Any) -> Any:
    """Return a document without sections, zones and requirements; another one as it is."""
    core = ('schema', 'name', 'initial_position_m', *_FIELDS, 'epoch', 'disturbance', 'body')
    if not isinstance(document, Mapping) or document.get('schema') != SCHEMA:
        return document
    return {key: value for key, value in document.items() if key in core}


def parse(
    document: Any, known: Mapping[str, Section] | None = None, rehearsed: bool = False
) -> Scenario | ScenarioSet:
    """Return the scenario, or set, of a parsed YAML document; raises InputError.

    known : sections that it may have; None: all, whose modules are imported then
    rehearsed : whether somebody has made the trials of `Section.rehearse` before
    """
    is_set = schema(document, SCHEMA, SET_SCHEMA) == SET_SCHEMA
    start = starts.field_of(document) if is_set else 'initial_position_m'
    known = sections() if known is None else known
    known = {n: s for n, s in known.items() if not is_set or n in SET_SECTIONS}
    required = ['schema', 'name', *_FIELDS, start, 'epoch', 'disturbance']
    _refuse_ellipses(document)
    data = mapping('', document, required, [*known, *_OPTIONAL])
    about = codec.from_mapping(Zones, 'zones', data['zones']) if 'zones' in data else None
    base = Scenario(
        name=data['name'],
        description=data.get('description', ''),
        initial_position_m=(0.0, 0.0, 0.0) if is_set else data[start],
        epoch_ns=_epoch_ns(data['epoch']),
        sections=tuple(
            codec.from_mapping(section.settings, name, _filled(section, data[name], about))
            for name, section in known.items()
            if name in data
        ),
        zones=about,
        requirements=(
            requirements.parse(data['requirements'], about, attitude='attitude' in data)
            if 'requirements' in data
            else None
        ),
        goal_position_m=data.get('goal_position_m', AT_TARGET),
        body=cw.body_of('body', data.get('body', 'earth')),
        **{name: data[name] for name in _FIELDS},
    )
    base = replace(base, disturbance=_disturbance(data['disturbance'], base.mean_motion_rad_s))
    found = ScenarioSet(base, starts.parse(start, data[start])) if is_set else None
    farthest = base if found is None else found.farthest
    for settings in base.sections:
        rehearse = section_of(settings).rehearse
        if rehearse is not None and not rehearsed:
            rehearse(settings, farthest)
    return base if found is None else found


def to_document(scenario: Scenario) -> dict[str, Any]:
    """Return one scenario as the document that `parse` reads, its disturbance spelt out."""
    moment = datetime.datetime.fromtimestamp(
        scenario.epoch_ns // NANOSECONDS, datetime.timezone.utc
    )
    document: dict[str, Any] = {
        'schema': SCHEMA,
        'name': scenario.name,
        'description': scenario.description,
        **{name: getattr(scenario, name) for name in ('initial_position_m', *_FIELDS)},
        'epoch': moment + datetime.timedelta(microseconds=scenario.epoch_ns % NANOSECONDS // 1000),
        'disturbance': scenario.disturbance,
        **{section_of(settings).name: settings for settings in scenario.sections},
    }
    if scenario.goal is not None:
        document['goal_position_m'] = scenario.goal_position_m
    if scenario.body != cw.EARTH:
        document['body'] = cw.document_of(scenario.body)
    if scenario.requirements is not None:
        document['requirements'] = scenario.requirements.to_document()
    document = {key: codec.to_mapping(value) for key, value in document.items()}
    if scenario.zones is not None:
        document['zones'] = codec.to_mapping(scenario.zones)
        takers: dict[str, Any] = {section_of(s).name: s for s in scenario.sections}
        for name, taker in {**takers, 'requirements': requirements}.items():
            of_zones = getattr(taker, 'of_zones', None)
            if name in document and of_zones is not None:
                known = of_zones(document[name], scenario.zones)
                document[name] = without(document[name], known)
    return document


def _filled(section: Section, document: Any, zones: Zones | None) -> Any:
    """Return the mapping of a section with what it takes from section `zones`."""
    of_zones = getattr(section.settings, 'of_zones', None)
    if zones is None or of_zones is None:
        return document
    return filled(document, of_zones(document, zones))


def dumps(scenario: Scenario) -> str:
    """Return the YAML text of one scenario; it is read back to the same bits."""
    document = to_document(scenario)
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)


def text_for_logs(content: str, scenario: Scenario) -> str:
    """Return the text of its file, or a longer one that says also what is in files it names."""
    named = any(section_of(settings).names_files for settings in scenario.sections)
    return dumps(scenario) if named else content


def _refuse_ellipses(document: Any) -> None:
    if isinstance(document, Mapping) and 'eccentricity' in document:
        raise InputError(
            '`eccentricity` belongs into section `dynamics`, with `kind` linear_elliptic or '
            'two_body; without the section the orbit is a circle of radius `orbit_radius_m`'
        )


def _epoch_ns(value: Any) -> int:
    if not isinstance(value, datetime.datetime):
        raise InputError(
            f'`epoch` must be a UTC date and time like 2026-01-01T00:00:00Z; got {shown(value)}'
        )
    moment = value.replace(tzinfo=value.tzinfo or datetime.timezone.utc)
    since = moment - datetime.datetime(1970, 1, 1, tzinfo=datetime.timezone.utc)
    return (since // datetime.timedelta(microseconds=1)) * 1000


def _disturbance(value: Any, mean_motion_rad_s: float) -> Disturbance:
    if isinstance(value, str):
        preset = choice('disturbance', value, DISTURBANCES)
        return NONE if preset == 'none' else paper(preset.split('_')[1], mean_motion_rad_s)
    return codec.from_mapping(Disturbance, 'disturbance', value, needed=('constant_n', 'harmonics'))


def load(name: str | Path) -> Scenario | ScenarioSet:
    """Return the scenario or set of a shipped name or a path; raises InputError."""
    return files.load(files.find('scenario', str(name)), parse)


def load_scenario(name: str | Path) -> Scenario:
    """Return one scenario; a set is refused, since one run flies one start."""
    return single(load(name), name)


def single(found: Scenario | ScenarioSet, name: object) -> Scenario:
    """Return one scenario as it is; a set of that name is refused."""
    if isinstance(found, ScenarioSet):
        count = len(found.initial_positions_m)
        raise InputError(f'`scenario` must be a single flight; {name} is a set of {count}')
    return found


def load_set(name: str | Path) -> ScenarioSet:
    """Return a set of scenarios; a single one is refused."""
    found = load(name)
    if isinstance(found, Scenario):
        raise InputError(f'`scenario` must be a set ({SET_SCHEMA}); {name} is a single flight')
    return found
