# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Tuning a baseline: the fitness and the starts of the training, at most the paper's evaluations.

A few numbers of each kind are tuned, within a range (`TUNING_SPACES`).

The search is CMA-ES on the graded fitness of the preset `best`: where no parameters meet all
conditions, the flat penalty does not show which way is better. The folder holds `tuning.yaml`,
`checkpoint.npz` after each generation, and at the end `<name>.yaml` and `history.csv`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are

from rpo_core.files.validation import choice, text, whole
from rpo_ctrl.baselines import Baseline, Lqr, Model, Mpc, Pd, PotentialField
from rpo_ctrl.family import Gene
from rpo_judge.evaluation.assessment import PAPER
from rpo_judge.scoring.fitness import Fitness, FitnessSettings
from rpo_kernels.arrays import Floats
from rpo_training.algorithms import CmaSearch, CmaSettings, Search
from rpo_training.config import Configuration, written
from rpo_training.fitting import penalty_n2s, units_of
from rpo_training.genetic import GaSettings
from rpo_training.run import SearchRun

BUDGET = GaSettings().population * (GaSettings().generations + 1)
"""Evaluations of the paper's genetic algorithm: 60 x 301."""

SEARCHED = FitnessSettings(penalty='graded', margin=0.001, limit_cycle=20.0)
"""The fitness that is minimised; the file has the paper's flat fitness too."""


PLANAR, VERTICAL = [0, 1, 3, 4], [2, 5]
"""States of the two decoupled parts of the relative motion."""


class TuningSpace(NamedTuple):
    """What is tuned of a kind of baseline."""

    genes: tuple[Gene, ...]
    description: str


def _gene(name: str, least: float, most: float, metres: int, seconds: int, newtons: int) -> Gene:
    """Return a number in a range, searched from its middle on a logarithmic scale.

    A weight is in the units of the cost, N^2.
    """
    middle = (least * most) ** 0.5
    return Gene(name, least, most, middle, metres, seconds, newtons, logarithmic=True)


def lqr_gains(model: Model, position_weight: float, velocity_weight: float) -> Floats:
    """Return K (3, 6) of the discrete linear quadratic regulator, f = -K x, R = 1 N^2.

    K = (R + B' P B)^-1 B' P A with P from the discrete algebraic Riccati equation (SciPy), solved
    for the planar and the vertical motion by themselves, so that they stay decoupled exactly.
    """
    a, b = model.matrices()
    gains = np.zeros((3, 6))
    for states, axes in ((PLANAR, [0, 1]), (VERTICAL, [2])):
        part_a, part_b = a[np.ix_(states, states)], b[np.ix_(states, axes)]
        half = len(states) // 2
        weights = np.diag([position_weight] * half + [velocity_weight] * half)
        r = np.eye(len(axes))
        p = solve_discrete_are(part_a, part_b, weights, r)
        gains[np.ix_(axes, states)] = np.linalg.solve(
            r + part_b.T @ p @ part_b, part_b.T @ p @ part_a
        )
    return gains


TUNING_SPACES: Mapping[str, TuningSpace] = {
    kind: TuningSpace(tuple(_gene(*gene) for gene in space['genes']), space['description'])
    for kind, space in written('tuning').items()
}
"""Kind -> tuning space, of `presets.yaml`; drift has nothing to tune."""


def baseline_of(kind: str, values: Mapping[str, Any], model: Model) -> Baseline:
    """Return the baseline of a kind with these numbers."""
    if kind == Pd.kind:
        return Pd(name=kind, **values)
    if kind == Lqr.kind:
        gains: Any = lqr_gains(model, **values)
        return Lqr(name=kind, model=model, gains=gains, **values)
    return {Mpc.kind: Mpc, PotentialField.kind: PotentialField}[kind](
        name=kind, model=model, **values
    )


@dataclass(frozen=True)
class TuningConfig(Configuration):
    """The tuning of a baseline."""

    schema, file = 'rpo/tuning/1', 'tuning.yaml'
    required = ('kind',)

    kind: str
    name: str
    seed: int = 1
    evaluations: int = BUDGET
    sigma: float = 0.2
    scenario: str = PAPER

    def __post_init__(self) -> None:
        choice('kind', self.kind, TUNING_SPACES)
        self.check()
        whole('evaluations', self.evaluations, least=20, most=BUDGET)

    def known(self) -> Iterator[tuple[str, Any]]:
        """Yield that of the kind for the scenario."""
        scenario = '' if self.scenario == PAPER else f' --scenario {self.scenario}'
        yield f'{self.kind}{scenario}', self.of(self.kind, self.scenario)

    @classmethod
    def of(cls, kind: str, scenario: str = '') -> TuningConfig:
        """Return the tuning of a kind for a scenario."""
        return cls(kind, kind, scenario=scenario or PAPER)

    @classmethod
    def base(cls, data: Mapping[str, Any]) -> TuningConfig:
        """Return the tuning of a kind."""
        return cls.of(text('kind', data['kind']))


class Tuning(SearchRun[TuningConfig, Baseline]):
    """The tuning of a baseline."""

    config_type = TuningConfig

    def make_search(self) -> Search:
        """Return the search over the space, from the middle of each."""
        own = self.config
        settings = CmaSettings(population=20, sigma=own.sigma, evaluations=own.evaluations)
        return CmaSearch(settings, own.seed, np.full(len(self.genes), 0.5))

    def make_fitness(self, workers: int, address: str) -> Fitness:
        """Return the graded fitness; a baseline's generation is too small for a cluster."""
        searched = replace(self.flat, penalty='graded', margin=SEARCHED.margin)
        paper = self.config.scenario == PAPER
        return Fitness(self.starts, SEARCHED if paper else searched, workers)

    @property
    def flat(self) -> FitnessSettings:
        """The flat penalty; of another scenario than the paper's, in its unit of energy."""
        if self.config.scenario == PAPER:
            return FitnessSettings()
        return FitnessSettings(penalty_n2s=penalty_n2s(self.starts))

    @property
    def space(self) -> TuningSpace:
        """The tuning space of the kind."""
        return TUNING_SPACES[self.config.kind]

    @cached_property
    def genes(self) -> tuple[Gene, ...]:
        """What is tuned; of another scenario than the paper's, in its units."""
        own = (1.0, 1.0, 1.0) if self.config.scenario == PAPER else units_of(self.starts)
        return tuple(gene.fitted(own) for gene in self.space.genes)

    @cached_property
    def model(self) -> Model:
        """The model of the plant for baselines."""
        base = self.starts.base
        return Model(base.orbit_radius_m, base.mass_kg, base.dt_s, base.body)

    @property
    def phase(self) -> str:
        """What is tuned."""
        return f'tuning {self.config.kind}'

    def decode(self, genes: Floats) -> list[Baseline]:
        """Return the baselines of a generation."""
        return [self.make(row) for row in genes]

    def make(self, genes: Floats) -> Baseline:
        """Return the baseline of a chromosome, without provenance."""
        pairs = zip(self.genes, genes.tolist(), strict=True)
        values = {gene.name: gene.value(share) for gene, share in pairs}
        made = baseline_of(self.config.kind, values, self.model)
        most_n = self.starts.base.max_force_n
        return replace(made, name=self.config.name, max_force_n=most_n)

    def found(self) -> Baseline:
        """Return the best so far, its provenance filled in."""
        found = self.make(self.best_genes)
        judge = Fitness(self.starts, self.flat, 1)
        with judge.simulator:
            scores = judge.score([found])
        made = replace(found, description=self.space.description)
        return self.credited(made, 'cmaes', scores, searched_fitness_n2s=float(self.best[0]))
