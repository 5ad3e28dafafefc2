# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Which parameters of a fuzzy controller matter: each is changed alone, and all starts fly again.

A scale or a foot of a word changes by `STEP` of its range down and up; a rule takes the next lower
and the next higher word, together with the rules that its symmetry ties to it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import NamedTuple

import numpy as np

from rpo_core.control.controller import FuzzyController
from rpo_core.control.fuzzy import WORDS, RuleTable
from rpo_core.files.scenario import load_set
from rpo_core.files.validation import InputError
from rpo_core.judge.metrics import ENERGY
from rpo_judge.scoring.conditions import conditions_of
from rpo_judge.scoring.drawn import HELD_OUT, POSITION_AND_SPEED, DrawnFlights, DrawnSettings
from rpo_montecarlo.engine.cases import Case, DrawnCase, case_of_set
from rpo_montecarlo.engine.population import population_of
from rpo_montecarlo.engine.simulator import Simulator

STEP = 0.02
RUNS = 200
"""Drawn runs of the dispersed paper's test, judged by position and speed."""

_FEET = {
    'z_half_width': 'zero: half-width',
    'sp_left': 'small: near foot',
    'sp_centre': 'small: peak',
    'sp_right': 'small: far foot',
    'lp_left': 'large: foot',
}


class Outcome(NamedTuple):
    """What a controller does: mean J [N^2 s], smallest margin of a condition, runs that miss.

    missed : drawn runs that miss position or speed (`POSITION_AND_SPEED`)
    """

    energy_n2s: float
    margin: float
    missed: int


class Effect(NamedTuple):
    """A parameter, in words, its value, and what a step down and up leads to; None: no such step.

    part : position, velocity, force or rules
    """

    part: str
    parameter: str
    value: str
    down: Outcome | None
    up: Outcome | None

    def strength(self, base: Outcome) -> float:
        """Largest loss of a step: 1 for a percent of J, of margin, or of runs."""
        losses = [
            100.0 * (abs(o.energy_n2s / base.energy_n2s - 1.0) + abs(base.margin - o.margin))
            + 100.0 * abs(o.missed - base.missed) / RUNS
            for o in (self.down, self.up)
            if o is not None
        ]
        return max(losses, default=0.0)


def outcomes(controllers: list[FuzzyController], workers: int = 0) -> list[Outcome]:
    """Return what controllers do from the starts of the paper's training, and in drawn runs."""
    training = load_set('paper_training')
    conditions = conditions_of(training.base)
    settings = DrawnSettings(1.0, held_out=RUNS, judged={'paper_test': POSITION_AND_SPEED})
    flights = DrawnFlights('paper_test', settings)
    cases: list[Case | DrawnCase] = [case_of_set(training), flights.case(HELD_OUT)]
    columns = list(conditions.columns)
    with Simulator(cases, workers, controllers[0].system.samples) as simulator:
        starts, runs = simulator.fly(population_of(*controllers))
    margins = 1.0 - (starts[..., columns] / conditions.limits).max(axis=(1, 2))
    missed = (flights.values(runs) > flights.limits).any(axis=-1).sum(axis=-1)
    energies = starts[..., ENERGY].mean(axis=-1)
    triples = zip(energies.tolist(), margins.tolist(), missed.tolist(), strict=True)
    return [Outcome(*triple) for triple in triples]


def effects(controller: FuzzyController, workers: int = 0) -> tuple[Outcome, list[Effect]]:
    """Return what a controller does, and the effect of each parameter, the strongest first."""
    rows = list(_variants(controller))
    controllers = [controller, *(c for *_, pair in rows for c in pair if c is not None)]
    found = iter(outcomes(controllers, workers))
    base, result = next(found), []
    for part, parameter, value, pair in rows:
        down, up = (None if c is None else next(found) for c in pair)
        result.append(Effect(part, parameter, value, down, up))
    return base, sorted(result, key=lambda effect: -effect.strength(base))


Pair = tuple[FuzzyController | None, FuzzyController | None]


def _variants(c: FuzzyController) -> Iterator[tuple[str, str, str, Pair]]:
    """Yield part, parameter, value, and the controllers of a step down and up."""
    for part, name, unit in (
        ('position', 'position_scale_m', 'm'),
        ('velocity', 'velocity_scale_m_s', 'm/s'),
    ):
        value = getattr(c, name)
        down, up = (replace(c, **{name: value * (1.0 + s)}) for s in (-STEP, STEP))
        yield part, 'scale', f'{value:g} {unit}', (down, up)
    for part in ('position', 'velocity', 'force'):
        feet = getattr(c.system, part)
        for name, value in asdict(feet).items():
            pair = tuple(_with_foot(c, part, name, value + step) for step in (-STEP, STEP))
            yield part, _FEET[name], f'{value:g}', (pair[0], pair[1])
    codes = c.system.rules.codes
    for row, column in _rules(c.system.rules):
        pair = tuple(_with_rule(c, row, column, int(codes[row, column]) + s) for s in (-1, 1))
        words = f'at position {WORDS[column]}, velocity {WORDS[row]}, force'
        yield 'rules', words, WORDS[codes[row, column]], (pair[0], pair[1])


def _rules(table: RuleTable) -> list[tuple[int, int]]:
    """Return a cell (row, column) of each group of rules that change together."""
    symmetric, odd = table.is_transpose_symmetric, table.is_odd
    cells = []
    for row, column in np.ndindex(5, 5):
        mirrored = [(column, row)] if symmetric else []
        if odd:
            mirrored += [(4 - row, 4 - column), (4 - column, 4 - row)]
        if all((row, column) <= other for other in mirrored):
            cells.append((row, column))
    return [
        cell for cell in cells if not odd or (cell != (2, 2) and not (symmetric and sum(cell) == 4))
    ]


def _with_foot(c: FuzzyController, part: str, name: str, value: float) -> FuzzyController | None:
    try:
        feet = replace(getattr(c.system, part), **{name: round(value, 10)})
    except InputError:
        return None  # a foot stays between its neighbours
    return replace(c, system=replace(c.system, **{part: feet}))


def _with_rule(c: FuzzyController, row: int, column: int, code: int) -> FuzzyController | None:
    table = c.system.rules
    if not 0 <= code <= 4:
        return None
    codes = table.codes.copy()
    for i, j in {(row, column), (column, row) if table.is_transpose_symmetric else (row, column)}:
        codes[i, j] = code
        if table.is_odd:
            codes[4 - i, 4 - j] = 4 - code
    return replace(c, system=replace(c.system, rules=RuleTable.from_codes(codes)))
