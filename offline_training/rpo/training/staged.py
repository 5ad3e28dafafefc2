# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Searches in stages: one after the other, CMA-ES anew, and the race of rule tables.

Where the fitness draws flights, a stage draws them anew, and the best so far is judged by them. At
the end, draws that are held out decide (`rpo.scoring.drawn`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Annotated

import numpy as np

from rpo.scoring.drawn import HELD_OUT, UNDRAWN
from rpo.training.algorithms import CmaSettings, Part, Script, Search, Stage
from rpo.training.genes import GeneSpace
from rpo_core.files.validation import Checked, flag, real, whole
from rpo_core.kernels.arrays import Floats


@dataclass(frozen=True)
class StagedSettings(Checked):
    """Options of the stages.

    restarts : descents from the start, without drawn flights, with the settings of CMA-ES
    stages : with drawn flights, from the best of these
    sigma, evaluations : of each stage
    """

    PLACE = 'staged.'

    restarts: Annotated[int, partial(whole, least=1, most=1000)] = 1
    stages: Annotated[int, partial(whole, least=1, most=1000)] = 3
    sigma: Annotated[float, partial(real, above=0.0, most=1.0)] = 0.015
    evaluations: Annotated[int, partial(whole, least=1)] = 1500


def staged(own: StagedSettings, descent: CmaSettings, seed: int, start: Floats) -> Search:
    """Return CMA-ES from the start, more than once; then in stages, each from the best so far.

    The first descents are cheap, and far: they fly no draws. A stage draws hard flights for the
    best so far. Draws that are held out decide among the bests of the stages.
    """

    def course(search: Search) -> Script:
        finalists = []
        yield from search.enter(UNDRAWN, 'start', start[None])
        for number in range(1, own.restarts + 1):
            search.phase = f'descent {number}'
            yield from search.descend(descent, start, number)
        later = replace(descent, sigma=own.sigma, evaluations=own.evaluations)
        for number in range(1, own.stages + 1):
            yield from search.enter(number, f'stage {number}', search.best.genes[None])
            yield from search.descend(later, search.best.genes, own.restarts + number)
            finalists.append(np.array(search.best.genes))
        yield from search.enter(HELD_OUT, 'held-out flights', np.unique(finalists, axis=0))
        return f'{own.stages} stages'

    most = own.restarts * descent.evaluations + own.stages * own.evaluations
    return Search(seed, start, most, course, size=descent.population)


@dataclass(frozen=True)
class RaceSettings(Checked):
    """Options of the race; the descents over all genes have `CmaSettings`.

    rounds : at most
    entrants : tables in a round that get a descent over feet and scales
    population, sigma, evaluations : of each such descent
    last : evaluations of the descent over all genes after the last round; 0: as those before
    gain : the race ends after a round that gains less [N²s]
    scan : scales between the bounds that are tried first with the start, each with each; 0: none
    stages : whether each round draws its flights anew, and held-out flights decide at the end
    """

    PLACE = 'race.'

    rounds: Annotated[int, partial(whole, least=1)] = 3
    entrants: Annotated[int, partial(whole, least=1)] = 8
    population: Annotated[int, partial(whole, least=4)] = 14
    sigma: Annotated[float, partial(real, above=0.0, most=1.0)] = 0.05
    evaluations: int = 2000
    last: Annotated[int, partial(whole, least=0)] = 0
    gain: Annotated[float, partial(real, unit='N²s', least=0.0)] = 0.01
    scan: Annotated[int, partial(whole, least=0, most=100)] = 0
    stages: Annotated[bool, flag] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        whole('race.evaluations', self.evaluations, least=self.population)


@dataclass(frozen=True)
class Finalist:
    """The best of a descent: its chromosome, and its fitness by the draws of its stage."""

    stage: int
    fitness: float
    genes: Floats


class TableRace(Search):
    """A race of rule tables: the discrete genes by enumeration, the continuous ones by CMA-ES.

    There are only fifty odd, monotone tables. A search that moves between them by rounding a gene
    rarely finds the feet that suit the new table. A round therefore runs CMA-ES over all genes from
    the best controller so far; then, for each of the tables that do best with its feet, a short
    CMA-ES over feet and scales. The race ends after a round that gains too little. Where the
    fitness draws flights anew (`stages`), each round is a stage; at the end the best of every
    descent of the last two stages are judged by the draws that are held out.

    finalists : of the last two stages; the last generation asks for these
    """

    def __init__(
        self,
        own: RaceSettings,
        descent: CmaSettings,
        seed: int,
        space: GeneSpace,
        start: Floats,
    ) -> None:
        self.settings, self.descent, self.space = own, descent, space
        self._tables, self._streams = space.rule_tables(), 0
        self.finalists: list[Finalist] = []
        each = len(self._tables) + own.entrants * own.evaluations + descent.evaluations
        most = (own.last or descent.evaluations) + own.rounds * each + own.scan**2
        super().__init__(seed, start, most, TableRace._run)

    def _run(self) -> Script:
        own = self.settings
        self.stage, reason = Stage(0, self.best.genes), f'{own.rounds} rounds'
        if own.scan and self.space.free_scales:
            self.phase = 'scales'
            yield self._scales()
        for number in range(1, own.rounds + 1):
            yield from self._draw(number)
            before = self.best.value
            self.phase = f'round {number}, descent'
            yield from self._run_descent(self.descent, self.best.genes)
            yield from self._enter_tables(number)
            if before - self.best.value < own.gain:
                reason = f'round {number} gained less than {own.gain:g} N²s'
                break
        else:
            yield from self._draw(own.rounds + 1)
            self.phase = 'last descent'
            last = replace(self.descent, evaluations=own.last or self.descent.evaluations)
            yield from self._run_descent(last, self.best.genes)
        if own.stages:
            recent = [f for f in self.finalists if f.stage >= self.stage.number - 1]
            self.finalists = list({f.genes.tobytes(): f for f in recent}.values())
            entries = np.array([finalist.genes for finalist in self.finalists])
            yield from self.enter(HELD_OUT, 'held-out flights', entries)
        return reason

    def _draw(self, number: int) -> Part:
        """Begin a stage, where there are stages."""
        if self.settings.stages:
            yield from self.enter(number, f'stage {number}', self.best.genes[None])

    def _scales(self) -> Floats:
        """Return the start, and the start with other scales."""
        shares = (np.arange(self.settings.scan) + 0.5) / self.settings.scan
        scales = np.array(list(product(shares, repeat=self.space.free_scales)))
        entries = np.repeat(self.best.genes[None], len(scales) + 1, axis=0)
        entries[1:, : self.space.free_scales] = scales**2  # closer where the scales are small
        return entries

    def _enter_tables(self, number: int) -> Part:
        own, rules, best = self.settings, self.space.rule_genes, self.best.genes
        self.phase = f'round {number}, tables'
        entries = np.repeat(best[None], len(self._tables), axis=0)
        entries[:, rules] = self._tables
        values = yield entries
        settings = replace(
            self.descent,
            population=own.population,
            sigma=own.sigma,
            evaluations=own.evaluations,
            descents=1,
        )
        for place, index in enumerate(np.argsort(values[:, 0], kind='stable')[: own.entrants], 1):
            self.phase = f'round {number}, table {place} of {own.entrants}'
            table = self._tables[index]

            def with_table(genes: Floats, table: Floats = table) -> Floats:
                return np.hstack([genes, np.repeat(table[None], len(genes), axis=0)])

            yield from self._run_descent(settings, best[: rules.start], with_table)

    def _run_descent(
        self,
        settings: CmaSettings,
        start: Floats,
        complete: Callable[[Floats], Floats] = np.array,
    ) -> Part:
        self._streams += 1
        best, _ = yield from self.descend(settings, start, self._streams, complete)
        if self.settings.stages:
            genes = complete(best.genes[None])[0]
            self.finalists.append(Finalist(self.stage.number, float(best.value), genes))
