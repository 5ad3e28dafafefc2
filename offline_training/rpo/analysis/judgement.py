# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Judge a controller: by Q1 to Q5, by the requirements of scenarios, and by campaigns.

A shipped controller has targets of its own for Q1 to Q5. It is recognised by its numbers, not by
what its file says of itself; any other controller has those of `ANY`. No training draws from the
campaigns: their draws have a seed of their own, and `rpo campaign FILE --controller NAME --seed
SEED` repeats each.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from statistics import fmean
from typing import NamedTuple

from rpo.analysis.optimal import least_energy
from rpo.engine.cases import case_of_flights, case_of_set
from rpo.engine.population import population_of
from rpo.engine.search import Simulator
from rpo.montecarlo.config import load
from rpo.montecarlo.execution import kept_of
from rpo.montecarlo.judging import MOTION, motion, sentence
from rpo.montecarlo.statistics import Rate, rate
from rpo.proof.proven import numbers_of
from rpo.scoring import fitness
from rpo_core.chain.flight import flights_of
from rpo_core.control.controller import AnyController, FuzzyController, load_controller
from rpo_core.files.validation import InputError
from rpo_core.judge.metrics import ENERGY, LATE_FORCE, LATE_POSITION, LATE_SPEED, of_flight
from rpo_core.judge.verdicts import (
    HOLDS,
    MISSED,
    NOT_JUDGED,
    UNBOUNDED,
    Verdict,
    number,
    unbounded,
    verdicts,
)
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario, ScenarioSet, load_scenario, load_set

QUESTIONS = (
    "Q1: every start meets all conditions. Q2: little energy. Q3: the paper's test, held. "
    'Q4: no limit cycle. Q5: rules that a person can read.'
)
"""What the targets are for, where they are shown."""


@dataclass(frozen=True)
class Asked:
    """What is asked of a controller; every start must meet all conditions in any case.

    energy_n2s : Q2, largest mean J over the starts; None: nothing is asked
    margin : Q1, least share of its limit that every condition keeps free
    questions : of Q3, Q4, Q5, those that are asked
    why : in words, of a shipped controller
    """

    energy_n2s: float | None
    margin: float
    questions: tuple[str, ...]
    why: str


_ALL = ('Q3', 'Q4', 'Q5')

ANY = Asked(3.7, 0.0, _ALL, '')
"""Q2's 3.7 N²s was set early; the least under all conditions is 2.43."""

SHIPPED = {
    'allround': Asked(
        4.0, 0.03, _ALL, 'a margin of 3 % to every condition, and the energy that it shipped with'
    ),
    'paper_ga': Asked(None, 0.0, (), "the paper's search, asked for the conditions of the paper"),
}
"""Shipped controller -> what is asked of it. An energy that a controller shipped with was set after
its training: it keeps a later one from being worse."""


def asked_of(controller: FuzzyController) -> tuple[str, Asked]:
    """Return the shipped controller that has these numbers, '' if none, and what is asked."""
    digest = numbers_of(controller)
    for name, asked in SHIPPED.items():
        shipped = load_controller(name)
        if isinstance(shipped, FuzzyController) and numbers_of(shipped) == digest:
            return name, asked
    return '', ANY


PAPER = 'paper_training'
"""The set that the targets are about."""

NOT_ASKED = 'not asked'


class Target(NamedTuple):
    """A figure, the smaller the better, and its limit; None: nothing is asked of it."""

    name: str
    what: str
    unit: str
    limit: float | None
    reached: float

    @property
    def holds(self) -> bool:
        """Whether the target is reached, or nothing is asked."""
        return self.limit is None or self.reached <= self.limit

    @property
    def word(self) -> str:
        """The verdict as it is shown."""
        return NOT_ASKED if self.limit is None else HOLDS if self.holds else MISSED

    def cells(self, sign: str = '') -> tuple[str, ...]:
        """Return its row in a table; `sign` stands before a limit."""
        limit = '' if self.limit is None else f'{sign}{self.limit:.4g} {self.unit}'
        return self.name, self.what, limit, f'{self.reached:.4g} {self.unit}', self.word


@dataclass(frozen=True)
class Assessment:
    """The results of one controller.

    starts : (n, 3) initial positions [m]
    metrics : (n, columns), see `rpo_core.judge.metrics.UNITS`
    least : (n,) least energy possible [N²s]
    tests : (2, columns) metrics of the paper's test, offset and phase reading
    """

    controller: FuzzyController
    starts: Floats
    metrics: Floats
    least: Floats
    tests: Floats

    @property
    def mean_energy_n2s(self) -> float:
        """Mean J over the starts."""
        return float(fitness.mean(self.metrics[:, ENERGY]))

    @property
    def binding(self) -> list[str]:
        """The condition nearest to its limit, per start."""
        return [fitness.CONDITIONS[i] for i in fitness.shares(self.metrics).argmax(axis=1)]

    @property
    def margin(self) -> float:
        """The smallest margin of a condition over all starts, as a share of its limit."""
        return float(1.0 - fitness.shares(self.metrics).max())

    @cached_property
    def asked(self) -> tuple[str, Asked]:
        """The shipped controller with these numbers, '' if none, and what is asked."""
        return asked_of(self.controller)

    def targets(self) -> list[Target]:
        """Return the figures of Q1 to Q5, each with what is asked of this controller."""
        _, asked = self.asked
        missed = int((fitness.shares(self.metrics) > 1.0).any(axis=1).sum())
        targets = [Target('Q1', 'starts that miss a condition', '', 0, missed)]
        if asked.margin:
            what = 'largest value of a condition, as a share of its limit'
            targets.append(Target('Q1', what, '', 1.0 - asked.margin, 1.0 - self.margin))
        targets += [
            Target('Q2', 'mean J over the starts', 'N²s', asked.energy_n2s, self.mean_energy_n2s),
            *self._held(),
        ]
        rules = self.controller.system.rules
        unreadable = int(not rules.is_odd) + int(not rules.is_monotone)
        targets.append(Target('Q5', 'rules that are not odd or not monotone', '', 0, unreadable))
        questions = ('Q1', 'Q2', *asked.questions)
        return [t if t.name in questions else t._replace(limit=None) for t in targets]

    def _held(self) -> list[Target]:
        """Return the figures of Q3 and Q4."""
        rows = []
        for row, (name, distance) in zip(self.tests, fitness.TESTS.items(), strict=True):
            place, speed = float(row[LATE_POSITION]), float(row[LATE_SPEED])
            limit, late = fitness.MAX_TEST_SPEED_M_S, 'last 200 s'
            rows.append(Target('Q3', f'{name}: largest |position|, {late}', 'm', distance, place))
            rows.append(Target('Q3', f'{name}: largest speed, {late}', 'm/s', limit, speed))
        what = 'undisturbed, 300-400 s: largest'
        force, speed = self.metrics[:, [LATE_FORCE, LATE_SPEED]].max(axis=0).tolist()
        return [
            *rows,
            Target('Q4', f'{what} |force|', 'N', fitness.MAX_SETTLED_FORCE_N, force),
            Target('Q4', f'{what} speed', 'm/s', fitness.MAX_SETTLED_SPEED_M_S, speed),
        ]

    def verdict(self) -> str:
        """Return how many of the targets are held, whose they are, and what is not asked."""
        name, asked = self.asked
        figures = self.targets()
        targets = [target for target in figures if target.limit is not None]
        held, rest = sum(target.holds for target in targets), len(figures) - len(targets)
        whose = f', set for {name}: {asked.why}' if name else ''
        more = f'; nothing is asked of {rest} more figures' if rest else ''
        return f'{held} of {len(targets)} targets of {PAPER} hold{whose}{more}'


def assess(controller: FuzzyController, workers: int = 0) -> Assessment:
    """Fly a controller through the training set, on to 400 s, and through the paper's tests."""
    training = load_set(PAPER)
    cases = [
        case_of_set(
            training,
            horizon_s=fitness.SETTLED_UNTIL_S,
            late_s=fitness.SETTLED_UNTIL_S - fitness.SETTLED_FROM_S,
        ),
        case_of_flights([load_scenario(name) for name in fitness.TESTS], fitness.TEST_WINDOW_S),
    ]
    with Simulator(cases, workers, controller.system.samples) as simulator:
        starts, tests = simulator.fly(population_of(controller))
    least_n2s = least_energy(training.base, cases[0].starts)
    return Assessment(controller, training.initial_positions_m, starts[0], least_n2s, tests[0])


class Judgement(NamedTuple):
    """A requirement over all flights.

    worst : verdict whose value is largest beside its limit
    missed, flights : flights that miss it, and all
    """

    worst: Verdict
    missed: int
    flights: int

    @property
    def word(self) -> str:
        """The verdict over all flights."""
        if self.missed:
            return MISSED
        return NOT_JUDGED if self.worst.holds is None else HOLDS


class Judged(NamedTuple):
    """Judgement of each requirement, the mean J over all flights, and what is not judged."""

    judgements: list[Judgement]
    mean_energy_n2s: float
    unbounded: list[str]


HEADINGS = ('requirement', 'limit', 'worst', 'missed by', '')


def rows_of(judged: Judged) -> list[tuple[str, ...]]:
    """Return the rows of a table of judgements."""
    rows: list[tuple[str, ...]] = [
        (
            j.worst.statement,
            f'≤ {number(j.worst.limit, j.worst.unit)}',
            number(j.worst.value, j.worst.unit),
            f'{j.missed} of {j.flights}',
            j.word,
        )
        for j in judged.judgements
    ]
    return rows + [(name, 'none', '–', '–', UNBOUNDED) for name in judged.unbounded]


def trained_for(controller: AnyController) -> str:
    """Return the scenario that a controller was made for, by its provenance; '' if it says none."""
    name = controller.provenance.get('scenario', '')
    return name if isinstance(name, str) else ''


def judge(
    controller: AnyController,
    scenarios: Scenario | ScenarioSet,
    report: Callable[[str, float, float], None],
) -> Judged:
    """Return how a controller keeps each requirement; `report` gets what is flown.

    Raises InputError if the scenario has no requirements.
    """
    base = scenarios.base if isinstance(scenarios, ScenarioSet) else scenarios
    count = len(scenarios.initial_positions_m) if isinstance(scenarios, ScenarioSet) else 1
    if base.requirements is None:
        raise InputError(
            f'scenario {scenarios.name} has no requirements to judge by: add the section '
            '`requirements` (docs/file_formats.md)'
        )
    columns: list[list[Verdict]] = []
    energies: list[float] = []
    for done, flight in enumerate(flights_of(controller, scenarios)):
        report(f'{controller.name}: flights of {scenarios.name}', done, count)
        columns.append(verdicts(flight))
        energies.append(of_flight(flight).energy_n2s)
    judgements = [
        Judgement(
            max(rows, key=lambda v: -math.inf if v.holds is None else v.value - v.limit),
            sum(v.holds is False for v in rows),
            len(rows),
        )
        for rows in zip(*columns, strict=True)
    ]
    return Judged(judgements, fmean(energies), unbounded(base))


SEED = 2026
"""Beyond the seeds of the shipped campaigns and of trainings."""


ALL = 'all limits'


class Demand(NamedTuple):
    """What is asked of the default controller in a campaign.

    runs : flown; share : of them, at least, that shall keep the limits
    motion : ask only for the limits on position and speed
    """

    runs: int
    share: float
    motion: bool = False


DEMANDS = {
    'paper_test': Demand(10_000, 0.999, motion=True),
    'random_starts': Demand(20_000, 1.0),
    'random_moving_starts': Demand(20_000, 0.9995),
}
"""Campaign -> what is asked. Of the dispersed test, nothing is asked of force and slew."""


class Outcome(NamedTuple):
    """What came of a campaign.

    campaign : its name
    success : named by what is judged; judged : the same in full
    least : share that shall succeed, None: nothing is asked
    """

    campaign: str
    success: Rate
    judged: str
    least: float | None

    @property
    def missed(self) -> int:
        """Runs that miss a limit."""
        return self.success.runs - self.success.kept

    @property
    def holds(self) -> bool:
        """Whether enough runs succeed."""
        return self.least is None or self.success.kept >= self.least * self.success.runs


def everywhere(
    controller: AnyController,
    seed: int = SEED,
    workers: int = 0,
    report: Callable[[str, float, float], None] = lambda *_: None,
) -> list[Outcome]:
    """Return what comes of the campaigns of `DEMANDS`; `report` gets what is flown.

    Where less is asked than the campaign judges, a second outcome is that of all its limits.
    """
    outcomes = []
    for name, (runs, share, only) in DEMANDS.items():
        loaded = load(name, runs=runs, seed=seed, controller='handmade')
        campaign, limits = replace(loaded, controller=controller), list(loaded.config.success)
        judged: list[tuple[str, list[str], float | None]] = [(ALL, limits, share)]
        if only:
            judged = [(MOTION, motion(limits), share), (ALL, limits, None)]
        show = partial(report, f'{controller.name}: {name}')
        kept = kept_of(campaign, [names for _, names, _ in judged], workers, show)
        for (what, names, min_share), count in zip(judged, kept, strict=True):
            words = sentence(campaign.judging(names))
            outcomes.append(Outcome(name, rate(what, count, runs), words, min_share))
    return outcomes
