# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Tuning a baseline: the fitness and the starts of the training, at most the paper's evaluations.

A few numbers of each kind are tuned, within a range (`TUNING_SPACES`).

The search is CMA-ES on the graded fitness of the preset `best`: where no parameters meet all
conditions, the flat penalty, by which the result is judged, does not show which way is better. The
folder holds `tuning.yaml`, `checkpoint.npz` after each generation, and at the end `<name>.yaml` and
`history.csv`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import solve_discrete_are

from rpo.scoring.fitness import Fitness, FitnessSettings
from rpo.training.algorithms import CmaSettings, Search, cma_es
from rpo.training.config import Configuration, written
from rpo.training.family_training import GeneRun
from rpo.training.fitting import penalty_n2s
from rpo.training.genetic import GaSettings
from rpo_core.control.baselines import Baseline, Lqr, Model, Mpc, Pd, PotentialField
from rpo_core.control.family import Gene
from rpo_core.files.validation import choice, whole
from rpo_core.judge.similarity import PAPER
from rpo_core.kernels.arrays import Floats

BUDGET = GaSettings().population * (GaSettings().generations + 1)
"""Evaluations of the paper's genetic algorithm: 60 x 301."""

PLANAR, VERTICAL = [0, 1, 3, 4], [2, 5]
"""States of the two decoupled parts of the relative motion."""


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


TUNING_SPACES: Mapping[str, Any] = written('tuning')
"""Kind -> its description, and what is tuned of it; drift has nothing to tune."""


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
    subject = 'kind', ''

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

    @classmethod
    def of(cls, *subject: str, scenario: str = PAPER) -> TuningConfig:
        """Return the tuning of a kind for a scenario."""
        (kind,) = subject
        return cls(kind, kind, scenario=scenario)


class Tuning(GeneRun[TuningConfig, Baseline]):
    """The tuning of a baseline."""

    config_type = TuningConfig

    def make_search(self) -> Search:
        """Return the search over the space, from the middle of each."""
        own = self.config
        settings = CmaSettings(population=20, sigma=own.sigma, evaluations=own.evaluations)
        start = np.full(len(self.genes), 0.5)
        return cma_es(settings, own.seed, start, f'tuning {own.kind}')

    def make_fitness(self, workers: int) -> Fitness:
        """Return the graded fitness."""
        cycle = 20.0 if self.config.scenario == PAPER else 0.0
        searched = replace(self.flat, penalty='graded', margin=0.001, limit_cycle=cycle)
        return Fitness(self.starts, searched, workers)

    @property
    def flat(self) -> FitnessSettings:
        """The flat penalty, in the scenario's unit of energy."""
        return FitnessSettings(penalty_n2s=penalty_n2s(self.starts))

    @property
    def paper_genes(self) -> Sequence[Gene]:
        """What is tuned in the paper's training, from its middle on a logarithmic scale."""
        return [
            Gene(name, least, most, (least * most) ** 0.5, metre, second, newton, True)
            for name, least, most, metre, second, newton in TUNING_SPACES[self.config.kind]['genes']
        ]

    @cached_property
    def model(self) -> Model:
        """The model of the plant for baselines."""
        base = self.starts.base
        return Model(base.orbit_radius_m, base.mass_kg, base.dt_s, base.body)

    def of_values(self, values: list[float]) -> Baseline:
        """Return the baseline of some values of the genes, without provenance."""
        names = (gene.name for gene in self.genes)
        made = baseline_of(self.config.kind, dict(zip(names, values, strict=True)), self.model)
        most_n = self.starts.base.max_force_n
        return replace(made, name=self.config.name, max_force_n=most_n)

    def found(self) -> Baseline:
        """Return the best so far, its provenance filled in."""
        found = self.make(self.best_genes)
        judge = Fitness(self.starts, self.flat, 1)
        with judge.simulator:
            scores = judge.score([found])
        made = replace(found, description=TUNING_SPACES[self.config.kind]['description'])
        return self.credited(made, 'cmaes', scores, searched_fitness_n2s=float(self.best[0]))
