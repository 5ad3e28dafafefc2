# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is to be proven: a controller, a scenario, a box of starts, and what may differ."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import Annotated, Any

import numpy as np
import yaml

from rpo.proof import enclosure
from rpo.proof.tube import Motion
from rpo_core import files
from rpo_core.control import controller as controllers
from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.files import codec
from rpo_core.files.validation import Checked, InputError, flag, mapping, real, schema, shown, text
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario import scenario
from rpo_core.scenario.scenario import Scenario, ScenarioSet
from rpo_core.stage import section_of
from rpo_core.world import cw
from rpo_core.world.disturbance import Harmonic

SCHEMA = 'rpo/proof/1'

HOLD = 'hold_error_per_axis_m'

HOLD_ERROR_M = 0.5
"""What a scenario without requirements must hold, from its end on: the paper's claim."""

GROUPS: dict[str, tuple[int, ...]] = {'vertical': (2, 5), 'planar': (0, 1, 3, 4)}
"""States that move together, in the order of a state: x and y are coupled, z is alone."""

PER_AXIS: dict[str, tuple[int, ...]] = {'z': (2, 5), 'y': (1, 4), 'x': (0, 3)}
"""The same, in a proof per axis; see `per_axis`."""

EVER_N = 4e-12
"""Share of the disturbance by which its sinusoids may be rounded, and are widened (`_forces`)."""

MOST_CELLS = 10_000_000
"""First cells of a group, or strips of an axis."""

_share = partial(real, least=0.0, below=0.5)
_Six = tuple[float, float, float, float, float, float]


def _six(name: str, value: Any, least: float = -1e6) -> _Six:
    if not isinstance(value, (list, tuple)) or len(value) != 6:
        raise InputError(f'`{name}` must be 6 numbers; got {shown(value)}')
    x, y, z, vx, vy, vz = (real(name, number, most=1e6, least=least) for number in value)
    return x, y, z, vx, vy, vz


def _names(name: str, value: Any) -> tuple[str, ...]:
    if not isinstance(value, (list, tuple)):
        raise InputError(f'`{name}` must be a list of requirements; got {shown(value)}')
    return tuple(text(name, one) for one in value)


@dataclass(frozen=True)
class Settings(Checked):
    """What of a scenario may differ, and how finely the proof begins.

    centre, half : (6,) of the box of starts [m, m/s]
    mass_share : the mass differs by so much
    disturbance_share : harmonics of the scenario's disturbance have any phase and any amplitude up
        to so many times, its constant any size up to so many times
    any_n : a disturbance that changes at every tick, of any axis
    axes_apart : each axis has cells of its own, in the unknown constants too; see `per_axis`
    cell_m, cell_m_s : half-width of the first cells; of strips, in a proof per axis
    claims : requirements that the proof is about; none given: all that the scenario has
    coarseness : of the table of the surface, see `enclosure.table_of`
    """

    centre: Annotated[_Six, _six]
    half: Annotated[_Six, partial(_six, least=0.0)]
    mass_share: Annotated[float, _share] = 0.0
    disturbance_share: Annotated[float, partial(real, least=0.0, most=10.0)] = 0.0
    any_n: Annotated[float, partial(real, unit='N', least=0.0, most=1.0)] = 0.0
    coarseness: Annotated[float, partial(real, least=1.0, most=16.0)] = 1.0
    axes_apart: Annotated[bool, flag] = False
    cell_m: Annotated[float, partial(real, unit='m', above=0.0, most=1e3)] = 1.0
    cell_m_s: Annotated[float, partial(real, unit='m/s', above=0.0, most=10.0)] = 0.0125
    claims: Annotated[tuple[str, ...], _names] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        sizes = 3 * [self.cell_m] + 3 * [self.cell_m_s]
        counts = [max(1.0, half / size) for half, size in zip(self.half, sizes, strict=True)]
        groups = (PER_AXIS if self.axes_apart else GROUPS).values()
        cells = max(math.prod(counts[i] for i in chosen) for chosen in groups)
        if not cells <= MOST_CELLS:
            raise InputError(
                f'`half` must be of at most {MOST_CELLS} cells of `cell_m` and `cell_m_s`; '
                f'it is of {cells:.3g}'
            )


@dataclass(frozen=True)
class Problem:
    """A proof to be made."""

    controller: FuzzyController
    scenario: Scenario
    settings: Settings

    @classmethod
    def of(cls, controller: AnyController, flight: Scenario, settings: Settings) -> Problem:
        """Return the problem; raises InputError where the theory does not know something."""
        if not isinstance(controller, FuzzyController):
            raise InputError(
                f'`controller` must be fuzzy to be proven: only its surface can be enclosed; '
                f'{controller.name} is of kind {controller.kind}'
            )
        for section in flight.sections:
            raise InputError(
                f'scenario {flight.name} has a stage that the proof does not know: '
                f'`{section_of(section).name}`'
            )
        if flight.goal is not None:
            raise InputError(
                f'scenario {flight.name} has a goal away from the target, which the proof does not '
                'know: `goal_position_m`'
            )
        made = cls(controller, flight, settings)
        for key in settings.claims:
            if key not in made.all_limits:
                keys = ', '.join(made.all_limits)
                raise InputError(f'`claim` must be one of {keys}; got {key!r}')
        return made

    @cached_property
    def all_limits(self) -> dict[str, float]:
        """Requirement -> limit: those of the scenario, and to hold the error at its end."""
        required = self.scenario.requirements
        limits = {} if required is None else dict(required.limits)
        limits.setdefault(HOLD, HOLD_ERROR_M)
        return limits

    @property
    def limits(self) -> dict[str, float]:
        """Requirement -> limit, of what the proof is about."""
        asked = self.settings.claims
        return {k: v for k, v in self.all_limits.items() if not asked or k in asked}

    @property
    def hold_error_m(self) -> float:
        """The limit of the error per axis that is to be held for ever."""
        return self.all_limits[HOLD]

    @property
    def odd(self) -> bool:
        """Whether half of the box is enough: what starts at -s is the negative of what starts at s.

        Not in a proof per axis: x and y would have to change their signs together.
        """
        still = self.scenario.disturbance.is_zero or self.settings.disturbance_share > 0.0
        centred = not any(self.settings.centre)
        alone = not self.settings.axes_apart
        return alone and self.controller.system.rules.is_odd and still and centred

    @property
    def groups(self) -> dict[str, tuple[int, ...]]:
        """States that move together, in the order in which they are proven."""
        return PER_AXIS if self.settings.axes_apart else GROUPS

    @property
    def needs_invariant_set(self) -> bool:
        """Whether tubes must enter an invariant set: only an `any_n` disturbs."""
        return self.undisturbed and not self.settings.axes_apart

    @property
    def undisturbed(self) -> bool:
        """Whether only an `any_n` disturbs."""
        return self.scenario.disturbance.is_zero

    @cached_property
    def hold_tick(self) -> int:
        """The tick from which the chaser must hold: the required time, else the end."""
        required = self.scenario.requirements
        if required is None or required.hold_from_s is None:
            return self.scenario.ticks
        return round(required.hold_from_s / self.scenario.dt_s)

    @cached_property
    def table(self) -> enclosure.Table:
        """The enclosure of the control surface, made by this process."""
        flight, required = self.scenario, self.scenario.requirements
        slew_n_s = None if required is None else required.slew_per_axis_n_s
        coarseness = self.settings.coarseness
        return _table(self.controller, flight.max_force_n, coarseness, slew_n_s, flight.mass_kg)

    @property
    def strongest_n(self) -> float:
        """A bound of the disturbance on any axis at any time, without `any_n` [N]."""
        disturbance, share = self.scenario.disturbance, self.settings.disturbance_share or 1.0
        sums = [abs(constant) for constant in disturbance.constant_n]
        for h in disturbance.harmonics:
            sums['xyz'.index(h.axis)] += abs(h.amplitude_n)
        return share * max(sums) * (1.0 + 1e-12)

    def motion(self, group: str, ticks: int) -> Motion:
        """Return what moves the sets of a group of states, for so many ticks."""
        chosen = list(self.groups[group])
        axes = [i for i in chosen if i < 3]
        a, b = cw.matrices(self.scenario.step)
        a = np.ascontiguousarray(a[np.ix_(chosen, chosen)])
        b = np.ascontiguousarray(b[np.ix_(chosen, axes)])
        any_n = self.settings.any_n + EVER_N * self.strongest_n
        forces, alone = self._forces(axes, ticks), np.zeros((ticks, len(chosen)))
        share = self.inverse_mass_share
        return Motion(a, b, self.scenario.dt_s, *forces, share, any_n, alone, alone)

    @property
    def inverse_mass_share(self) -> float:
        """Share by which 1/m may differ from 1 / nominal mass, on either side."""
        share = self.settings.mass_share
        return share / (1.0 - share)

    def waves(self, axis: int) -> list[float | Harmonic]:
        """Return the parts of an axis's disturbance whose constants are unknown."""
        disturbance = self.scenario.disturbance
        if self.settings.disturbance_share == 0.0:
            return []
        parts: list[float | Harmonic] = [disturbance.constant_n[axis]]
        parts = parts if parts[0] else []
        return [*parts, *(h for h in disturbance.harmonics if 'xyz'.index(h.axis) == axis)]

    def _forces(self, axes: Sequence[int], ticks: int) -> tuple[Floats, Floats]:
        """Return known forces (N, p) and those of each unknown constant (N, q, p) [N]."""
        times = np.array([self.scenario.time_s(k) for k in range(ticks)])
        disturbance, share = self.scenario.disturbance, self.settings.disturbance_share
        extra = [np.zeros((ticks, len(axes)))] if self.inverse_mass_share > 0.0 else []
        if share == 0.0:
            constant = disturbance.over(range(ticks), self.scenario.dt_ns)[:, axes]
            return np.ascontiguousarray(constant), _stacked(extra, ticks, len(axes))
        stacked = []
        for place, axis in enumerate(axes):
            columns: list[Floats] = []
            for wave in self.waves(axis):
                if isinstance(wave, Harmonic):
                    size = share * abs(wave.amplitude_n)
                    angle = wave.angular_rate_rad_s * times
                    columns += [size * np.cos(angle), size * np.sin(angle)]
                else:
                    columns.append(np.full(ticks, share * abs(wave)))
            for values in columns:
                column = np.zeros((ticks, len(axes)))
                column[:, place] = values * (1.0 + 1e-12)
                stacked.append(column)
        return np.zeros((ticks, len(axes))), _stacked([*stacked, *extra], ticks, len(axes))

    @cached_property
    def texts(self) -> tuple[str, str, str]:
        """Controller, scenario and settings as files."""
        settings = yaml.safe_dump(
            {'schema': SCHEMA, **codec.to_mapping(self.settings)}, sort_keys=False
        )
        return controllers.dumps(self.controller), scenario.dumps(self.scenario), settings

    @classmethod
    def of_texts(cls, texts: Sequence[str]) -> Problem:
        """Return the problem of the texts of its files; raises InputError."""
        controller, found, settings = texts
        parsed = files.loads(found, scenario.parse, 'scenario')
        if isinstance(parsed, ScenarioSet):
            raise InputError('`scenario` of a proof must be a single flight; it is a set')
        made = files.loads(settings, _parse_settings, 'proof')
        return cls.of(files.loads(controller, controllers.parse, 'controller'), parsed, made)


def _parse_settings(document: Any) -> Settings:
    schema(document, SCHEMA)
    known = list(Settings.__dataclass_fields__)
    chosen = mapping('', document, ['schema', *known])
    return Settings(**{name: chosen[name] for name in known})


@lru_cache(maxsize=4)
def _table(
    controller: FuzzyController,
    limit_n: float,
    coarseness: float,
    slew_n_s: float | None,
    mass_kg: float,
) -> enclosure.Table:
    table = enclosure.table_of(controller, limit_n, coarseness)
    return table if slew_n_s is None else enclosure.divided(controller, table, slew_n_s, mass_kg)


def _stacked(columns: list[Floats], ticks: int, p: int) -> Floats:
    """Return forces (N, q, p) of columns (N, p)."""
    if not columns:
        return np.zeros((ticks, 0, p))
    return np.ascontiguousarray(np.stack(columns, axis=1))


def number(value: float) -> str:
    """Return a number with all of its digits."""
    return repr(value).removesuffix('.0')


def title_of(problem: Problem) -> str:
    """Return the controller, the scenario, and the box of starts."""
    sides = zip(problem.settings.centre, problem.settings.half, strict=True)
    box = ', '.join(f'{number(centre)} ± {number(half)}' for centre, half in sides)
    return f'{problem.controller.name}, {problem.scenario.name}, from ({box}) m, m/s'


def range_of(problem: Problem) -> str:
    """Return what may differ beside the start, and until when a flight is judged."""
    settings, flight = problem.settings, problem.scenario
    mass = f'mass {number(flight.mass_kg)} kg'
    if settings.mass_share > 0.0:
        mass += f', and more or less by a share of {number(settings.mass_share)}'
    if settings.disturbance_share > 0.0:
        share = number(settings.disturbance_share)
        disturbed = f'disturbance at any phase, up to {share} times as it is'
    else:
        disturbed = 'no disturbance' if problem.undisturbed else 'disturbance as it is'
    if settings.any_n > 0.0:
        disturbed += f', and any other of {number(settings.any_n)} N per axis at every tick'
    return f'{mass}; {disturbed}; {number(flight.duration_s)} s'
