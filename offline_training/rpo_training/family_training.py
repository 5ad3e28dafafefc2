# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The training of a family (`rpo_ctrl.family`): CMA-ES in stages, judged by drawn flights.

The folder holds `family.yaml`, `checkpoint.npz` after each generation, and at the end the
controller `<name>.yaml` and `history.csv`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.files.validation import InputError, shown, text
from rpo_core.judge.metrics import PENALTY
from rpo_ctrl.family import Family, Gene, Mission, family_of
from rpo_judge.evaluation.assessment import PAPER
from rpo_judge.scoring.fitness import Fitness, FitnessSettings, Scores
from rpo_training.algorithms import CmaSettings, Search
from rpo_training.config import Configuration, load_start, updated, written
from rpo_training.fitting import penalty_n2s, training_set, units_of
from rpo_training.run import SearchRun
from rpo_training.staged import StagedSearch, StagedSettings

Floats = NDArray[np.float64]

_JUDGED: FitnessSettings = updated(FitnessSettings(), written('family')['fitness'], 'fitness')

_DESCENT = CmaSettings(population=20, sigma=0.05, descents=1)


@dataclass(frozen=True)
class FamilyConfig(Configuration):
    """The training of a family.

    start : controller of the family from which the search begins; empty: the family's own
    """

    schema, file = 'rpo/family_training/1', 'family.yaml'
    required = ('family',)

    family: str
    name: str
    seed: int = 1
    scenario: str = PAPER
    start: str = ''
    fitness: FitnessSettings = _JUDGED
    cmaes: CmaSettings = _DESCENT
    staged: StagedSettings = field(default_factory=StagedSettings)

    def __post_init__(self) -> None:
        family_of(self.family)
        self.check()
        if not isinstance(self.start, str):
            raise InputError(f'`start` must be a name or a path; got {shown(self.start)}')

    @property
    def starts(self) -> tuple[str, ...]:
        """Controllers from which the search begins."""
        return (self.start,) if self.start else ()

    def known(self) -> Iterator[tuple[str, Any]]:
        """Yield that of the family for the scenario."""
        scenario = '' if self.scenario == PAPER else f' --scenario {self.scenario}'
        yield f'--family {self.family}{scenario}', config_of(self.family, self.scenario)

    @classmethod
    def base(cls, data: Mapping[str, Any]) -> FamilyConfig:
        """Return the configuration of the family."""
        return config_of(text('family', data['family']))


def config_of(family: str, scenario: str = '') -> FamilyConfig:
    """Return the configuration of a family; of another scenario, without the paper's own terms."""
    kind = family_of(family)
    first, later, stages = kind.effort
    most = first * len(kind.genes())
    descent = replace(_DESCENT, evaluations=most, patience=max(_DESCENT.patience, most // 10))
    staged = StagedSettings(stages=stages, evaluations=later * len(kind.genes()))
    drawn = replace(_JUDGED.drawn, campaigns=kind.drawn)
    fitness = replace(_JUDGED, tests=kind.tests, mass_kg=kind.masses_kg, drawn=drawn)
    config = FamilyConfig(family, family, fitness=fitness, cmaes=descent, staged=staged)
    if scenario in ('', PAPER):
        return config
    starts = training_set(scenario)
    energy = penalty_n2s(starts) / PENALTY
    fitness = FitnessSettings('graded', round(PENALTY * energy, 6), margin=0.15, error_weight=3.0)
    cmaes = replace(config.cmaes, tolerance=config.cmaes.tolerance * energy)
    return replace(config, scenario=scenario, fitness=fitness, cmaes=cmaes)


class FamilyTraining(SearchRun[FamilyConfig, Family]):
    """The training of a family."""

    config_type = FamilyConfig

    @cached_property
    def family(self) -> type[Family]:
        """The kind of controller that is searched."""
        return family_of(self.config.family)

    @cached_property
    def mission(self) -> Mission:
        """What the family needs of the mission."""
        base = self.starts.base
        paper = self.config.scenario == PAPER
        units = (1.0, 1.0, 1.0) if paper else units_of(self.starts)
        return Mission(units, base.max_force_n, base.dt_s)

    @cached_property
    def genes(self) -> tuple[Gene, ...]:
        """What is searched."""
        return tuple(gene.fitted(self.mission.units) for gene in self.family.genes())

    def make_search(self) -> Search:
        """Return the search at its beginning."""
        config, values = self.config, tuple(gene.start for gene in self.genes)
        if config.start:
            start = load_start(config.start)
            if not isinstance(start, self.family):
                raise InputError(f'`start` must be of the family {config.family}; got {start.name}')
            values = start.values()
        pairs = zip(self.genes, values, strict=True)
        shares = np.array([gene.share(value) for gene, value in pairs])
        return StagedSearch(config.staged, config.cmaes, config.seed, shares)

    def make_fitness(self, workers: int, address: str) -> Fitness:
        """Return the fitness of the configuration; the flights of one controller fill a thread."""
        return Fitness(self.starts, self.config.fitness, workers)

    def decode(self, genes: Floats) -> list[Family]:
        """Return the controllers of a generation."""
        return [self.make(row) for row in genes]

    def make(self, shares: Floats) -> Family:
        """Return the controller of a chromosome, without provenance."""
        pairs = zip(self.genes, shares.tolist(), strict=True)
        values = [gene.value(share) for gene, share in pairs]
        return self.family.of_values(self.config.name, values, self.mission)

    def found(self) -> Family:
        """Return the best so far, its provenance filled in."""
        found = self.make(self.best_genes)
        scores = self.fitness.score([found])
        missed = self.missed_draws(scores)
        return self.credited(found, 'cmaes in stages', scores, held_out_that_miss=missed)

    def missed_draws(self, scores: Scores) -> dict[str, str]:
        """Return campaign -> how many of the held-out draws the controller misses."""
        count = len(self.fitness.conditions.labels)
        drawn = self.fitness.drawn
        missed = scores.failures[0, count:]
        of = self.config.fitness.drawn.held_out
        return {d.label: f'{int(n)} of {of}' for d, n in zip(drawn, missed, strict=True)}
