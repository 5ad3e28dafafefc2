# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How good a controller is: its figures for Q1 to Q5, and its starts beside the least energy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.control.controller import FuzzyController
from rpo_core.files.scenario import load_scenario, load_set
from rpo_core.judge.metrics import (
    ARRIVAL_DISTANCE,
    ARRIVAL_SPEED,
    ENERGY,
    LATE_FORCE,
    LATE_POSITION,
    LATE_SPEED,
    SLEW,
)
from rpo_judge.evaluation.optimal import least_energy
from rpo_judge.evaluation.targets import Asked, asked_of
from rpo_judge.scoring import fitness
from rpo_montecarlo.engine.cases import case_of_flights, case_of_set
from rpo_montecarlo.engine.population import population_of
from rpo_montecarlo.engine.simulator import Simulator

Floats = NDArray[np.float64]

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
        shares = self.metrics[:, [ARRIVAL_SPEED, SLEW, ARRIVAL_DISTANCE]] / fitness.LIMITS
        return [fitness.CONDITIONS[i] for i in shares.argmax(axis=1)]

    @property
    def margin(self) -> float:
        """The smallest margin of a condition over all starts, as a share of its limit."""
        worst = self.metrics[:, [ARRIVAL_SPEED, SLEW, ARRIVAL_DISTANCE]].max(axis=0)
        return float(1.0 - (worst / fitness.LIMITS).max())

    @cached_property
    def asked(self) -> tuple[str, Asked]:
        """The shipped controller with these numbers, '' if none, and what is asked."""
        return asked_of(self.controller)

    def targets(self) -> list[Target]:
        """Return the figures of Q1 to Q5, each with what is asked of this controller."""
        _, asked = self.asked
        missed = int((fitness.failures(self.metrics[:, None, :]).sum(axis=1) > 0).sum())
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
