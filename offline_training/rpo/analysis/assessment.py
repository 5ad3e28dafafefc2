# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How good a controller is: its figures for Q1 to Q5, and its starts beside the least energy.

A shipped controller has targets of its own, for what it was made for. It is recognised by its
numbers, not by what its file says of itself; any other controller has those of `ANY`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from rpo.analysis.optimal import least_energy
from rpo.analysis.proven import numbers_of
from rpo.engine.cases import case_of_flights, case_of_set
from rpo.engine.population import population_of
from rpo.engine.simulator import Simulator
from rpo.training.scoring import fitness
from rpo_core.control.controller import FuzzyController, load_controller
from rpo_core.judge.metrics import ENERGY, LATE_FORCE, LATE_POSITION, LATE_SPEED
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import load_scenario, load_set

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
    why : in words
    """

    energy_n2s: float | None
    margin: float
    questions: tuple[str, ...]
    why: str


_ALL = ('Q3', 'Q4', 'Q5')

ANY = Asked(3.7, 0.0, _ALL, "what is asked of a controller for the paper's training")
"""Q2's 3.7 N^2 s was set early; the least under all conditions is 2.43."""

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

HELD, MISSED, NOT_ASKED = 'held', 'MISSED', 'not asked'


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
        return NOT_ASKED if self.limit is None else HELD if self.holds else MISSED

    def cells(self, sign: str = '') -> tuple[str, ...]:
        """Return its row in a table; `sign` stands before a limit."""
        limit = '' if self.limit is None else f'{sign}{self.limit:.4g} {self.unit}'
        return self.name, self.what, limit, f'{self.reached:.4g} {self.unit}', self.word


@dataclass(frozen=True)
class Assessment:
    """The results of one controller.

    starts : (n, 3) initial positions [m]
    metrics : (n, columns), see `rpo_core.judge.metrics.UNITS`
    least : (n,) least energy possible [N^2 s]
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
        found = [Target('Q1', 'starts that miss a condition', '', 0, missed)]
        if asked.margin:
            what = 'largest value of a condition, as a share of its limit'
            found.append(Target('Q1', what, '', 1.0 - asked.margin, 1.0 - self.margin))
        found += [
            Target('Q2', 'mean J over the starts', 'N^2 s', asked.energy_n2s, self.mean_energy_n2s),
            *self._held(),
        ]
        rules = self.controller.system.rules
        unreadable = int(not rules.is_odd) + int(not rules.is_monotone)
        found.append(Target('Q5', 'rules that are not odd or not monotone', '', 0, unreadable))
        known = ('Q1', 'Q2', *asked.questions)
        return [t if t.name in known else t._replace(limit=None) for t in found]

    def _held(self) -> list[Target]:
        """Return the figures of Q3 and Q4."""
        found = []
        for row, (name, distance) in zip(self.tests, fitness.TESTS.items(), strict=True):
            place, speed = float(row[LATE_POSITION]), float(row[LATE_SPEED])
            limit, late = fitness.MAX_TEST_SPEED_M_S, 'last 200 s'
            found.append(Target('Q3', f'{name}: largest |position|, {late}', 'm', distance, place))
            found.append(Target('Q3', f'{name}: largest speed, {late}', 'm/s', limit, speed))
        what = 'undisturbed, 300-400 s: largest'
        force, speed = self.metrics[:, [LATE_FORCE, LATE_SPEED]].max(axis=0).tolist()
        return [
            *found,
            Target('Q4', f'{what} |force|', 'N', fitness.MAX_SETTLED_FORCE_N, force),
            Target('Q4', f'{what} speed', 'm/s', fitness.MAX_SETTLED_SPEED_M_S, speed),
        ]

    def verdict(self) -> str:
        """Return how many of the targets are held, whose they are, and what is not asked."""
        name, asked = self.asked
        figures = self.targets()
        targets = [target for target in figures if target.limit is not None]
        held, rest = sum(target.holds for target in targets), len(figures) - len(targets)
        whose = f'its own ({asked.why})' if name else f'those of any controller ({asked.why})'
        more = f'; nothing is asked of {rest} more figures' if rest else ''
        return f'{held} of {len(targets)} targets held: {whose}{more}'


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
    least = least_energy(training.base, cases[0].starts)
    return Assessment(controller, training.initial_positions_m, starts[0], least, tests[0])
