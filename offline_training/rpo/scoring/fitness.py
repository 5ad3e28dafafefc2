# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Fitness of a controller: the paper's, and optional terms.

The paper's: the mean over the starts of J = integral of f.f dt plus 100 for each condition not
met. The conditions are what the scenario requires (`conditions`). Graded: 10 just beyond the
limit, rising to 100 far from it, which shows a search which way is better. Optional terms, weighted
by how far a limit is exceeded:

- `limit_cycle`: force and speed of the undisturbed flight from 300 s to 400 s;
- `tests`: all that the paper's test requires, in both readings;
- `robustness`: position and speed in the last 200 s of `corner_flights`;
- `drawn`: runs of campaigns, judged by their limits (`rpo.scoring.drawn`);
- `damping`, `falls`: what the force does on a grid of errors (`driving`, `falls`).

`mass_kg` and `between` add the penalties, not the energy, of further flights.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo.engine.cases import Case, case_of_flights, case_of_set
from rpo.engine.lanes import infer_many, make_scratch
from rpo.engine.population import Population
from rpo.engine.search import Candidates, Simulator
from rpo.scoring.conditions import AT_LIMIT, LABELS, PAPER, conditions_of
from rpo.scoring.drawn import HELD_OUT, SHARE_BELOW_1, UNDRAWN, WEIGHT, DrawnFlights, DrawnSettings
from rpo_core.control.controller import Controller
from rpo_core.control.fuzzy import DEFAULT_SAMPLES
from rpo_core.files.validation import Checked, choice, real, whole
from rpo_core.judge.metrics import (
    ARRIVAL_DISTANCE,
    ARRIVAL_SPEED,
    ARRIVAL_TIME,
    CLAIM_POSITION_M,
    CLAIM_VELOCITY_M_S,
    CLAIM_WINDOW_S,
    ENERGY,
    LATE_FORCE,
    LATE_POSITION,
    LATE_SPEED,
    PENALTY,
    SLEW,
)
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario, ScenarioSet, load_scenario

POSITION_M, VELOCITY_M_S = 5.0, 0.04
"""The start is off by so much on every axis, and moves on in that direction."""

CORNER_MASS_SHARES = (-0.09, 0.09)
AMPLITUDE_SHARE = 0.5
PHASES_RAD = tuple(quarter * math.pi / 2 for quarter in range(4))


def corner_flights(mass_share: float) -> list[Scenario]:
    """Return the corner flights of a chaser with 1 + `mass_share` times the nominal mass."""
    nominal = load_scenario('paper_test')
    base = replace(nominal, mass_kg=nominal.mass_kg * (1.0 + mass_share))
    found = []
    for signs in product((-1.0, 1.0), repeat=3):
        position = (r + s * POSITION_M for r, s in zip(base.start[:3], signs, strict=True))
        velocity = (v + s * VELOCITY_M_S for v, s in zip(base.start[3:], signs, strict=True))
        start = base.starting_at((*position, *velocity))
        found += [
            replace(start, disturbance=base.disturbance.varied(AMPLITUDE_SHARE, phase_rad=phase))
            for phase in PHASES_RAD
        ]
    return found


def corner_cases() -> list[Case]:
    """Return the corner flights, a case for each mass."""
    return [case_of_flights(corner_flights(share), CLAIM_WINDOW_S) for share in CORNER_MASS_SHARES]


CONDITIONS = tuple(LABELS.values())
"""The paper's two, and the project's own, arrival."""

LIMITS = np.array([PAPER.limits[name] for name in LABELS])
_COLUMNS = [ARRIVAL_SPEED, SLEW, ARRIVAL_DISTANCE]

SETTLED_FROM_S, SETTLED_UNTIL_S = 300.0, 400.0
MAX_SETTLED_FORCE_N, MAX_SETTLED_SPEED_M_S = 2e-3, 1e-3
"""Q4: beyond this, the undisturbed flight has a limit cycle."""

FASTER = 0.1
"""Share of the mean speed of the longest way, at which `between` starts."""

TESTS = {'paper_test': 0.1, 'paper_test_phase': 0.2}
MAX_TEST_SPEED_M_S = 3e-3
TEST_WINDOW_S = 200.0
"""Q3: the paper's test and the largest |position| [m] over its last 200 s, per reading."""

_SOME = 4  # candidates that fly together after the better half


@dataclass(frozen=True)
class FitnessSettings(Checked):
    """Settings of the fitness.

    penalty : 'flat', the paper's, or 'graded'
    penalty_n2s : of a condition that is not met
    error_weight : penalty of an error of position or of a late arrival, as a multiple; above 1, it
        costs more not to fly than to fly badly
    margin : share by which every limit is made stricter, in [0, 1)
    limit_cycle, robustness, tests : weight [N²s] of the optional terms, 0 = off
    mass_kg : further masses whose penalties count
    between : random planar loops, and as many vertical ones, whose penalties count; 0 = off; for
        attitude, slews
    damping : weight [N²s] of the mean force that drives, as a share of full output
    falls : weight [N²s] of the largest falls along both errors, as a share of full output
    drawn : the runs of campaigns
    """

    PLACE = 'fitness.'

    penalty: Annotated[str, partial(choice, known=('flat', 'graded'))] = 'flat'
    penalty_n2s: Annotated[float, partial(real, unit='N²s', above=0.0)] = PENALTY
    error_weight: Annotated[float, partial(real, above=0.0)] = 1.0
    margin: Annotated[float, SHARE_BELOW_1] = 0.0
    limit_cycle: Annotated[float, WEIGHT] = 0.0
    robustness: Annotated[float, WEIGHT] = 0.0
    tests: Annotated[float, WEIGHT] = 0.0
    mass_kg: tuple[float, ...] = ()
    between: Annotated[int, partial(whole, least=0, most=40)] = 0
    damping: Annotated[float, WEIGHT] = 0.0
    falls: Annotated[float, WEIGHT] = 0.0
    drawn: DrawnSettings = field(default_factory=DrawnSettings)

    def __post_init__(self) -> None:
        super().__post_init__()
        for i, mass in enumerate(self.mass_kg):
            real(f'fitness.mass_kg[{i}]', mass, 'kg', above=0.0)


class Scores(NamedTuple):
    """A population's scores.

    fitness : (n,) the minimised number [N²s]
    energy : (n,) mean J over the starts [N²s]
    failures : (n, k) starts that miss each of the conditions, then drawn flights of each campaign
        that miss a limit
    arrival : (n,) mean time [s] after which every axis stays within 0.5 m, or what is required
    """

    fitness: Floats
    energy: Floats
    failures: NDArray[np.int64]
    arrival: Floats


def shares(rows: Floats) -> Floats:
    """Return the values of `CONDITIONS` (..., 3) of metrics (..., columns), over their limits."""
    return np.asarray(rows[..., _COLUMNS] / LIMITS)


def mean(values: Floats) -> Floats:
    """Return the mean over the last axis, correctly rounded: independent of the order."""
    rows = values.reshape(-1, values.shape[-1])
    return np.array([math.fsum(row) / len(row) for row in rows.tolist()]).reshape(values.shape[:-1])


def excess(values: Floats, limits: float | Floats) -> Floats:
    """Return how far values lie beyond their limits, in [0, 1): 1 - (limit / value)^(1/4).

    The fourth root still separates 100 times the limit from 200 times; it is two square roots, and
    every processor rounds these alike.
    """
    return 1.0 - np.sqrt(np.sqrt(limits / np.maximum(values, limits)))


class Term(NamedTuple):
    """A term of the fitness; cost : (n,) of the rows (n, flights, columns) of its cases."""

    weight: float
    cases: list[Case]
    cost: Callable[[Floats], Floats]


def _between(case: Case, count: int) -> Case:
    """Return a case of `count` random planar loops, each with as many vertical ones.

    They start in the box of the starts of another case, as fast as `FASTER` of the largest distance
    in the time of the flight, to either side. What is tuned to a few starts fails beside them.
    """
    rng, base = np.random.default_rng(count), case.base
    positions = case.starts[:, :3]
    least, most = positions.min(axis=0), positions.max(axis=0)
    far_m = np.abs(positions - np.array(base.goal_position_m)).max()
    speed = FASTER * far_m / base.duration_s
    places = least + rng.random((count, 3)) * (most - least)
    velocities = base.initial_velocity_m_s + speed * (2.0 * rng.random((count, 3)) - 1.0)
    loops = np.hstack([places, velocities])
    starts = np.repeat(loops, count, axis=0)
    starts[:, [2, 5]] = np.tile(loops[:, [2, 5]], (count, 1))
    return replace(case, starts=starts, disturbance=np.zeros(len(starts), np.int64))


def members_of(candidates: Candidates, some: Iterable[int] | None = None) -> Sequence[Controller]:
    """Return candidates as controllers; all of them if `some` are not given."""
    if not isinstance(candidates, Population):
        return candidates if some is None else [candidates[i] for i in some]
    indices = range(len(candidates.scales)) if some is None else some
    return [candidates.controller(index, 'candidate') for index in indices]


class Fitness:
    """Computes the fitness of populations on a scenario set; holds their simulator."""

    def __init__(self, scenarios: ScenarioSet, settings: FitnessSettings, workers: int = 0) -> None:
        self.settings, self.conditions = settings, conditions_of(scenarios.base)
        self._terms = list(self._terms_of(scenarios))
        self._fixed = list({id(case): case for term in self._terms for case in term.cases}.values())
        self.stage: int | None = None
        names = settings.drawn.campaigns if settings.drawn.weight else ()
        self.drawn = [DrawnFlights(name, settings.drawn) for name in names]
        self.simulator = Simulator(self._fixed, workers)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the columns of `Scores.failures`."""
        return (*self.conditions.labels, *(flights.label for flights in self.drawn))

    def enter(self, stage: int, best: Candidates | None = None) -> None:
        """Draw the flights of a stage; `best` says which of them are hard."""
        if stage == self.stage or not self.drawn:
            return
        self.stage = stage
        best_of_all = members_of(best) if best is not None and self.settings.drawn.pool else ()
        for flights in self.drawn if stage != UNDRAWN else ():
            flights.enter(stage)
            if stage != HELD_OUT:
                hardest_for = None
                if best_of_all:
                    hardest_for = flights.fly(best_of_all, self.simulator.each)
                flights.choose(hardest_for)

    def _terms_of(self, scenarios: ScenarioSet) -> Iterator[Term]:
        """Yield the terms, the training's first."""
        own, conditions, late = self.settings, self.conditions, SETTLED_UNTIL_S - SETTLED_FROM_S
        make = partial(case_of_set, scenarios, arrival_m=conditions.arrival_m)
        judged = partial(
            make,
            late_s=conditions.late_s if conditions.late else late,
            together=conditions.together,
        )
        cycling = make(horizon_s=SETTLED_UNTIL_S, late_s=late)
        alone = not own.limit_cycle or conditions.late or conditions.together
        others = [judged(mass_kg=mass) for mass in own.mass_kg]
        if own.between:
            others.append(_between(judged(), own.between))
        for case in (judged() if alone else cycling, *others):
            yield Term(1.0, [case], lambda rows: mean(self._penalties(conditions.values(rows))))
        if own.limit_cycle:
            settled = {LATE_SPEED: MAX_SETTLED_SPEED_M_S, LATE_FORCE: MAX_SETTLED_FORCE_N}
            yield Term(
                own.limit_cycle, [cycling], lambda rows: self._beyond(rows.max(axis=1), settled)
            )
        if own.tests:
            tests = [load_scenario(name) for name in TESTS]
            required = [conditions_of(test) for test in tests]  # of the same columns
            limits = np.array([each.limits for each in required])

            def missed(rows: Floats) -> Floats:
                found = self._missed(required[0].values(rows), limits, own.margin)
                return np.asarray(found.sum(axis=(-2, -1)))

            yield Term(own.tests, [case_of_flights(tests, required[0].late_s)], missed)
        if own.robustness:
            claim = {LATE_POSITION: CLAIM_POSITION_M, LATE_SPEED: CLAIM_VELOCITY_M_S}
            yield Term(own.robustness, corner_cases(), lambda rows: mean(self._beyond(rows, claim)))

    def score(self, population: Candidates) -> Scores:
        """Return the scores of a population."""
        settings = self.settings
        if self.drawn and self.stage is None:
            self.enter(0)
        outcomes = self.simulator.fly(population)
        training = outcomes[0]
        fitness = energy = mean(training[..., ENERGY])
        rows_of = dict(zip(map(id, self._fixed), outcomes, strict=True))
        for term in self._terms:
            rows = np.hstack([rows_of[id(case)] for case in term.cases])
            fitness = fitness + term.weight * term.cost(rows)
        if isinstance(population, Population):
            fitness = with_surface(fitness, settings, population)
        missed = (self.conditions.values(training) > self.conditions.limits).sum(axis=-2)
        if self.drawn:
            fitness, flights = self._with_drawn(population, fitness)
            missed = np.hstack([missed, flights])
        return Scores(fitness, energy, missed, mean(training[..., ARRIVAL_TIME]))

    def _with_drawn(
        self, population: Candidates, fitness: Floats
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Return the fitness (n,) with the drawn flights; how many miss (n, campaigns).

        A search that looks at ranks needs the better half. So the half that is best without the
        term flies first; then those that this term, never negative, can still let into the better
        half. The rest get the term and the misses of flights that all miss by far.
        """
        if self.stage == UNDRAWN:
            return fitness, np.zeros((len(fitness), len(self.drawn)), np.int64)
        order, half = np.argsort(fitness, kind='stable'), -(-len(fitness) // 2)
        if self.stage == HELD_OUT:
            half = len(fitness)
        worst = self.settings.drawn.weight * sum(len(d.judged) for d in self.drawn)
        total = fitness + worst
        missed = np.array([[d.count for d in self.drawn]] * len(fitness))
        for first in (0, *range(half, len(fitness), _SOME)):
            some = order[first : first + _SOME if first else half]
            if first:
                some = some[fitness[some] < np.sort(total)[half - 1]]
            if len(some):
                members = members_of(population, some)
                total[some], missed[some] = self._fly_drawn(members, fitness[some])
        return total, missed

    def _fly_drawn(
        self, members: Sequence[Controller], fitness: Floats
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Return the fitness with the penalties, and how many miss."""
        missed, own = [], self.settings.drawn
        for drawn in self.drawn:
            values, limits = drawn.fly(members, self.simulator.each)
            over = self._missed(values, limits, own.margin).sum(axis=-1)
            share = over.shape[-1] / drawn.count  # held-out runs: as dear as those of a pool
            fitness = fitness + own.weight * share * mean(over)
            missed.append((values > limits).any(axis=-1).sum(axis=-1))
        return fitness, np.column_stack(missed)

    def _penalties(self, values: Floats) -> Floats:
        """Return the penalty (n, starts) of what is judged (n, starts, conditions)."""
        missed = self._missed(values, self.conditions.limits, self.settings.margin)
        total = np.zeros(values.shape[:-1])
        for index, name in enumerate(self.conditions.labels):
            is_error = 'error' in name or 'arrival' in name
            weight = self.settings.error_weight if is_error else 1.0
            total = total + weight * missed[..., index]
        return self.settings.penalty_n2s * total

    def _missed(self, values: Floats, limits: Floats, margin: float) -> Floats:
        """Return the shares of the penalty of values (..., k) at limits less a margin."""
        limits = limits * (1.0 - margin)
        missed = (values > limits).astype(np.float64)
        if self.settings.penalty == 'graded':
            missed *= AT_LIMIT + (1.0 - AT_LIMIT) * excess(values, limits)
        return missed

    def _beyond(self, rows: Floats, limits: Mapping[int, float]) -> Floats:
        """Return how far values of rows (..., columns) lie beyond limits of columns, in all."""
        keep, total = 1.0 - self.settings.margin, np.zeros(rows.shape[:-1])
        for column, limit in limits.items():
            total = total + excess(rows[..., column], keep * limit)
        return total


def with_surface(fitness: Floats, settings: FitnessSettings, population: Population) -> Floats:
    """Return the fitness (n,) with the terms `damping` and `falls`."""
    for weight, term in ((settings.damping, driving), (settings.falls, falls)):
        if weight:
            fitness = fitness + weight * term(population)
    return fitness


POSITIONS, VELOCITIES = 41, 20
GRID, ALLOWED = 81, 0.05
"""Of the grid: position errors from -1 to 1, velocity errors from 0.05 to 1."""


def driving(population: Population, samples: int = DEFAULT_SAMPLES) -> Floats:
    """Return the mean (n,) over the grid of the force that drives, as a share of full output.

    The energy H = m v^2 / 2 + integral of |F(s, 0)| ds falls along a flight where
    v (F(e, v) - F(e, 0)) <= 0: the force of a velocity opposes it. The velocity error is -v over
    its scale, so the force must not be less for a larger velocity error.

    Negative velocity errors need no grid of their own where the rules are odd; other rules are
    checked with their mirror.
    """
    found = []
    for sign in (1.0, -1.0):
        errors = (
            sign * np.linspace(-1.0, 1.0, POSITIONS),
            sign * np.linspace(0.0, 1.0, VELOCITIES + 1),
        )
        tables = (sign * table for table in _surfaces(population, *errors, samples))
        found.append([np.maximum(table[:, :1] - table[:, 1:], 0.0).mean() for table in tables])
    return np.max(found, axis=0)


def falls(population: Population, samples: int = DEFAULT_SAMPLES) -> Floats:
    """Return the largest falls (n,) of the output along both errors, beyond `ALLOWED`, added up.

    What `rpo explain --certify` proves of a surface, looked at on a grid.
    """
    errors, found = np.linspace(-1.0, 1.0, GRID), np.zeros(len(population.scales))
    for index, table in enumerate(_surfaces(population, errors, errors, samples)):
        for axis in (0, 1):
            fall = (np.maximum.accumulate(table, axis) - table).max()
            found[index] += max(fall - ALLOWED, 0.0)
    return found


def _surfaces(
    population: Population, positions: Floats, velocities: Floats, samples: int
) -> Iterator[Floats]:
    """Yield the output (positions, velocities) of each member over a grid of errors."""
    grid = np.stack(np.meshgrid(positions, velocities, indexing='ij')).reshape(2, -1)
    scratch, outputs = make_scratch(), np.empty(grid.shape[1])
    for index in range(len(population.scales)):
        infer_many(grid, population.law(index, samples), scratch, outputs)
        yield outputs.reshape(len(positions), -1)
