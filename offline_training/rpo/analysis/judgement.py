# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Judge a controller by the requirements of scenarios, and by campaigns that no training drew.

The draws of the campaigns have a seed of their own; `rpo campaign FILE --controller NAME --seed
SEED` repeats each.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from statistics import fmean
from typing import NamedTuple

from rpo.engine.flights import flights_of
from rpo.montecarlo.config import find, load
from rpo.montecarlo.execution import kept_of
from rpo.montecarlo.judging import MOTION, motion, sentence
from rpo.montecarlo.statistics import Rate, rate
from rpo_core.control.controller import AnyController
from rpo_core.files.validation import InputError
from rpo_core.judge.metrics import of_flight
from rpo_core.judge.verdicts import (
    HOLDS,
    MISSED,
    NOT_JUDGED,
    UNBOUNDED,
    Verdict,
    unbounded,
    verdicts,
)
from rpo_core.scenario.scenario import Scenario, ScenarioSet
from rpo_log.show.report import shown


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
            f'≤ {shown(j.worst.limit, j.worst.unit)}',
            shown(j.worst.value, j.worst.unit),
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
    found: Scenario | ScenarioSet,
    report: Callable[[str, float, float], None],
) -> Judged:
    """Return how a controller keeps each requirement; `report` gets what is flown.

    Raises InputError if the scenario has no requirements.
    """
    base = found.base if isinstance(found, ScenarioSet) else found
    count = len(found.initial_positions_m) if isinstance(found, ScenarioSet) else 1
    if base.requirements is None:
        raise InputError(
            f'scenario {found.name} has no requirements to judge by: add the section '
            '`requirements` (docs/file_formats.md)'
        )
    columns: list[list[Verdict]] = []
    energies: list[float] = []
    for number, flight in enumerate(flights_of(controller, found)):
        report(f'{controller.name}: flights of {found.name}', number, count)
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
    found = []
    for name, (runs, share, only) in DEMANDS.items():
        loaded = load(find(name), runs=runs, seed=seed, controller='handmade')
        campaign, limits = replace(loaded, controller=controller), list(loaded.config.success)
        judged: list[tuple[str, list[str], float | None]] = [(ALL, limits, share)]
        if only:
            judged = [(MOTION, motion(limits), share), (ALL, limits, None)]
        show = partial(report, f'{controller.name}: {name}')
        kept = kept_of(campaign, [names for _, names, _ in judged], workers, show)
        for (what, names, least), count in zip(judged, kept, strict=True):
            words = sentence(campaign.judging(names))
            found.append(Outcome(name, rate(what, count, runs), words, least))
    return found
