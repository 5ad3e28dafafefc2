# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Judge a controller by the requirements of a scenario, or of each member of a set."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import fmean
from typing import NamedTuple

from rpo_core.control.controller import AnyController
from rpo_core.files.scenario import Scenario, ScenarioSet
from rpo_core.files.validation import InputError
from rpo_core.judge.metrics import of_flight
from rpo_core.judge.verdicts import HOLDS, MISSED, NOT_JUDGED, Verdict, verdicts
from rpo_log.show.report import shown
from rpo_montecarlo.engine.flights import flights_of


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
    """Judgement of each requirement, and the mean J over all flights."""

    judgements: list[Judgement]
    mean_energy_n2s: float


HEADINGS = ('requirement', 'limit', 'worst', 'missed by', '')


def rows_of(judgements: Sequence[Judgement]) -> list[tuple[str, ...]]:
    """Return the rows of a table of judgements."""
    return [
        (
            j.worst.statement,
            f'≤ {shown(j.worst.limit, j.worst.unit)}',
            shown(j.worst.value, j.worst.unit),
            f'{j.missed} of {j.flights}',
            j.word,
        )
        for j in judgements
    ]


def trained_for(controller: AnyController) -> str:
    """Return the scenario that a controller was made for, by its provenance; '' if it says none."""
    name = controller.provenance.get('scenario', '')
    return name if isinstance(name, str) else ''


def judge(
    controller: AnyController,
    found: Scenario | ScenarioSet,
    report: Callable[[str, float, float], None],
) -> Judged:
    """Return how a controller keeps each requirement; `report` is told what is flown.

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
        Judgement(max(rows, key=_badness), sum(v.holds is False for v in rows), len(rows))
        for rows in zip(*columns, strict=True)
    ]
    return Judged(judgements, fmean(energies))


def _badness(verdict: Verdict) -> float:
    return -math.inf if verdict.holds is None else verdict.value - verdict.limit
