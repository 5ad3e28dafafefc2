# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The training of a family (`rpo_core.control.family`): CMA-ES in stages, judged by drawn flights.

The folder holds `family.yaml`, `checkpoint.npz` after each generation, and at the end the
controller `<name>.yaml` and `history.csv`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from rpo.scoring.fitness import FitnessSettings
from rpo.training.algorithms import CmaSettings, Search
from rpo.training.config import Configuration, load_start, updated, written
from rpo.training.fitting import penalty_n2s, training_set, units_of
from rpo.training.run import Config, Found, SearchRun
from rpo.training.staged import StagedSettings, staged
from rpo_core.control.family import Family, Gene, Mission, family_of
from rpo_core.files.validation import InputError, shown
from rpo_core.judge.metrics import PENALTY
from rpo_core.judge.similarity import PAPER
from rpo_core.kernels.arrays import Floats

_JUDGED: FitnessSettings = updated(FitnessSettings(), written('family')['fitness'], 'fitness')

_DESCENT = CmaSettings(population=20, sigma=0.05, descents=1)


class GeneRun(SearchRun[Config, Found]):
    """A search of some numbers of a kind of controller, each in its range."""

    @property
    @abstractmethod
    def paper_genes(self) -> Sequence[Gene]:
        """What is searched in the paper's training."""

    @abstractmethod
    def of_values(self, values: list[float]) -> Found:
        """Return the controller of some values of the genes, without provenance."""

    @cached_property
    def units(self) -> tuple[float, float, float]:
        """Length, time and force, as multiples of those of the paper's training."""
        return units_of(self.starts)

    @cached_property
    def genes(self) -> tuple[Gene, ...]:
        """What is searched, in the units of the scenario."""
        return tuple(gene.fitted(self.units) for gene in self.paper_genes)

    def decode(self, genes: Floats) -> list[Found]:
        """Return the controllers of a generation."""
        return [self.make(row) for row in genes]

    def make(self, shares: Floats) -> Found:
        """Return the controller of a chromosome, without provenance."""
        pairs = zip(self.genes, shares.tolist(), strict=True)
        return self.of_values([gene.value(share) for gene, share in pairs])


@dataclass(frozen=True)
class FamilyConfig(Configuration):
    """The training of a family.

    start : controller of the family from which the search begins; empty: the family's own
    """

    schema, file = 'rpo/family_training/1', 'family.yaml'
    subject = 'family', '--family '

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

    @classmethod
    def of(cls, *subject: str, scenario: str = PAPER) -> FamilyConfig:
        """Return that of a family; of another scenario, without the paper's own terms."""
        (name,) = subject
        family = family_of(name)
        first, later, stages = family.effort
        most = first * len(family.genes())
        descent = replace(_DESCENT, evaluations=most, patience=max(_DESCENT.patience, most // 10))
        staged = StagedSettings(stages=stages, evaluations=later * len(family.genes()))
        drawn = replace(_JUDGED.drawn, campaigns=family.drawn)
        fitness = replace(_JUDGED, tests=family.tests, mass_kg=family.masses_kg, drawn=drawn)
        if scenario != PAPER:
            energy = penalty_n2s(training_set(scenario)) / PENALTY
            penalty = round(PENALTY * energy, 6)
            fitness = FitnessSettings('graded', penalty, margin=0.15, error_weight=3.0)
            descent = replace(descent, tolerance=descent.tolerance * energy)
        return cls(name, name, 1, scenario, '', fitness, descent, staged)


class FamilyTraining(GeneRun[FamilyConfig, Family]):
    """The training of a family."""

    config_type = FamilyConfig

    @property
    def family(self) -> type[Family]:
        """The kind of controller that is searched."""
        return family_of(self.config.family)

    @property
    def paper_genes(self) -> Sequence[Gene]:
        """What is searched in the paper's training."""
        return self.family.genes()

    def of_values(self, values: list[float]) -> Family:
        """Return the controller of some values of the genes, without provenance."""
        base = self.starts.base
        mission = Mission(self.units, base.max_force_n, base.dt_s)
        return self.family.of_values(self.config.name, values, mission)

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
        return staged(config.staged, config.cmaes, config.seed, shares)

    def found(self) -> Family:
        """Return the best so far, its provenance filled in: how many held-out draws it misses."""
        found = self.make(self.best_genes)
        scores = self.fitness.score([found])
        drawn, of = self.fitness.drawn, self.config.fitness.drawn.held_out
        missed = scores.failures[0, len(self.fitness.conditions.labels) :].tolist()
        counts: dict[str, Any] = {
            d.label: f'{n} of {of}' for d, n in zip(drawn, missed, strict=True)
        }
        return self.credited(found, 'cmaes in stages', scores, held_out_that_miss=counts)
