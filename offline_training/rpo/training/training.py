# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The training of a fuzzy controller: its search and its folder.

Beside the files of every search (`rpo.training.run`) the folder holds `config.yaml`,
`history.csv`; for a front `front.csv` and a controller for each point; where held-out flights
decide, `finalists.csv`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rpo.analysis.judgement import PAPER, assess
from rpo.engine.population import Population
from rpo.scoring.drawn import HELD_OUT
from rpo.scoring.fitness import Scores
from rpo.training.algorithms import Search, cma_es, genetic, pareto
from rpo.training.config import TrainingConfig, load_start
from rpo.training.run import SearchRun, write_csv
from rpo.training.staged import Finalist, TableRace
from rpo_core.control.controller import FuzzyController, only_fuzzy
from rpo_core.kernels.arrays import Floats

FRONT, FINALISTS = 'front.csv', 'finalists.csv'


def search_of(config: Any) -> Search:
    """Return the search of a configuration of fuzzy systems, at its beginning."""
    starts = np.array([config.genes.encode(_start(name, config)) for name in config.start])
    starts = starts.reshape(-1, config.genes.size)
    if config.algorithm == 'cmaes':
        return cma_es(config.cmaes, config.seed, starts[0])
    if config.algorithm == 'race':
        return TableRace(config.race, config.cmaes, config.seed, config.genes, starts[0])
    drawn = config.seed, config.genes.size, starts
    if config.algorithm == 'nsga2':
        return pareto(config.ga, *drawn)
    then = config.cmaes if config.algorithm == 'ga-cmaes' else None
    return genetic(config.ga, *drawn, then)


def _start(name: str, config: Any) -> FuzzyController:
    """Return a start with the scales of the search where those are fixed or given."""
    start, space = only_fuzzy(load_start(name)), config.genes
    bounds = (space.position_scale_m, space.velocity_scale_m_s)
    given = config.start_scales or start.scales
    scales = [
        value if least < most else least
        for value, (least, most) in zip(given, bounds, strict=False)
    ]
    return replace(start, position_scale_m=scales[0], velocity_scale_m_s=scales[1])


class Training(SearchRun[TrainingConfig, FuzzyController]):
    """The training of a fuzzy controller."""

    config_type = TrainingConfig

    def make_search(self) -> Search:
        """Return the search of the configuration, at its beginning."""
        return search_of(self.config)

    def decode(self, genes: Floats) -> Population:
        """Return the controllers of a generation."""
        return self.config.genes.decode(genes)

    def objectives(self, scores: Scores) -> Floats:
        """Return the fitness (n, 1); for a front, with the penalised arrival time (n, 2)."""
        if self.config.algorithm != 'nsga2':
            return super().objectives(scores)
        penalty = scores.fitness - scores.energy
        return np.column_stack([scores.fitness, scores.arrival + penalty])

    def found(self) -> FuzzyController:
        """Return the best so far, its provenance filled in."""
        return self.controller(self.best_genes, self.config.name)

    def save_more(self, folder: Path) -> None:
        """Write `history.csv`; for a front, its controllers; the finalists."""
        super().save_more(folder)
        if self.config.algorithm == 'nsga2':
            self._save_front(folder)
        if self.history[-1]['stage'] == HELD_OUT and isinstance(self.search, TableRace):
            self._save_finalists(self.search.finalists, folder / FINALISTS)

    def _save_finalists(self, finalists: list[Finalist], path: Path) -> None:
        """Write the finalists: by the draws that they were trained with, and by those held out."""
        rows: list[Mapping[str, object]] = []
        for finalist, scores in zip(finalists, self.checkpoint.scores[-1], strict=True):
            fitness, energy, *missed, _ = scores.tolist()
            row = {
                'stage': finalist.stage,
                'training_fitness': finalist.fitness,
                'held_out_fitness': fitness,
                'energy_n2s': energy,
            }
            counts = zip(self.fitness.labels, map(int, missed), strict=True)
            rows.append(row | {f'held_out_misses_{name}': n for name, n in counts})
        write_csv(path, rows)

    def controller(self, genes: Floats, name: str) -> FuzzyController:
        """Return the controller of a chromosome, its provenance filled in."""
        config = self.config
        population = config.genes.decode(genes[None])
        scores = self.fitness.score(population)
        found = population.controller(0, name)
        more: dict[str, object] = {}
        if config.scenario == PAPER:
            more['targets'] = {target.what: target.reached for target in assess(found).targets()}
        return self.credited(found, config.algorithm, scores, **more)

    def _save_front(self, folder: Path) -> None:
        """Write the controllers without penalty that no other beats in both objectives."""
        genes, scores = np.concatenate(self.chromosomes), np.concatenate(self.checkpoint.scores)
        clean = np.flatnonzero(scores[:, 2:-1].sum(axis=1) == 0)
        order = clean[np.lexsort((scores[clean, -1], scores[clean, 1]))]
        columns = ('controller', 'mean_energy_n2s', 'mean_arrival_s')
        front: list[Mapping[str, object]] = []
        soonest = np.inf
        for index in order:
            if scores[index, -1] < soonest:
                soonest = scores[index, -1]
                name = f'{self.config.name}_{len(front):03d}'
                self.save(self.controller(genes[index], name), folder)
                row = name, float(scores[index, 1]), float(soonest)
                front.append(dict(zip(columns, row, strict=True)))
        write_csv(folder / FRONT, front, columns)
