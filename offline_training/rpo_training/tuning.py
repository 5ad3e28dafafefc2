# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Tuning a baseline: the fitness and the starts of the training, at most the paper's evaluations.

The search is CMA-ES on the graded fitness of the preset `best`: where no parameters meet all
conditions, the flat penalty does not show which way is better. The folder holds `tuning.yaml`,
`checkpoint.npz` after each generation, and at the end `<kind>.yaml`.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from rpo_core import files
from rpo_core.files.validation import MOST_PATH, choice, mapping, real, text, whole
from rpo_ctrl.baselines import Baseline, Model
from rpo_judge.evaluation.assessment import PAPER
from rpo_judge.scoring.fitness import Fitness, FitnessSettings
from rpo_montecarlo import processor
from rpo_training.algorithms import CmaSearch, CmaSettings, Search
from rpo_training.checkpoint import versions
from rpo_training.fitting import penalty_n2s, units_of
from rpo_training.genetic import GaSettings
from rpo_training.run import SearchRun
from rpo_training.tuning_spaces import TUNING_SPACES, TuningSpace

Floats = NDArray[np.float64]

BUDGET = GaSettings().population * (GaSettings().generations + 1)
"""Evaluations of the paper's genetic algorithm: 60 x 301."""

CONFIG = 'tuning.yaml'

SEARCHED = FitnessSettings(penalty='graded', margin=0.001, limit_cycle=20.0)
"""The fitness that is minimised; the file has the paper's flat fitness too."""


@dataclass(frozen=True)
class TuningConfig:
    """All that determines the outcome of a tuning.

    disturbance : weight [N^2 s] of how far the paper's test is missed, see `search.fitness`; 0, as
        in the training of the fuzzy controllers: without the test
    """

    kind: str
    seed: int = 1
    evaluations: int = BUDGET
    disturbance: float = 0.0
    sigma: float = 0.2
    scenario: str = PAPER

    def __post_init__(self) -> None:
        choice('kind', self.kind, TUNING_SPACES)
        whole('seed', self.seed, least=0, most=2**63 - 1)
        whole('evaluations', self.evaluations, least=20, most=BUDGET)
        real('disturbance', self.disturbance, 'N^2 s', least=0.0, most=1e6)
        text('scenario', self.scenario, most=MOST_PATH)

    @property
    def command(self) -> str:
        """The command that repeats it."""
        less = '' if self.evaluations == BUDGET else f' --evaluations {self.evaluations}'
        test = f' --disturbance {self.disturbance:g}' if self.disturbance else ''
        mission = '' if self.scenario == PAPER else f' --scenario {self.scenario}'
        return f'rpo tune {self.kind}{mission} --seed {self.seed}{less}{test}'

    @property
    def name(self) -> str:
        """Name of the baseline."""
        return f'{self.kind}_disturbed' if self.disturbance else self.kind


def parse(document: Any) -> TuningConfig:
    """Return the configuration of a parsed YAML document; raises InputError."""
    return TuningConfig(**mapping('', document, [f.name for f in fields(TuningConfig)]))


class Tuning(SearchRun[TuningConfig, Baseline]):
    """The tuning of a baseline."""

    config_file, kind, command = CONFIG, 'tuning', 'rpo tune'

    @classmethod
    def load(cls, path: Path) -> TuningConfig:
        """Return the configuration of a file; raises InputError."""
        return files.load(path, parse)

    @property
    def scenario(self) -> str:
        """The scenario or set that is tuned for."""
        return self.config.scenario

    def dumps(self) -> str:
        """Return the configuration as the text of its file."""
        return yaml.safe_dump(asdict(self.config), sort_keys=False)

    def inputs(self) -> list[str]:
        """Return the text of the scenario."""
        return [files.read_text(files.find('scenario', self.config.scenario))]

    def make_search(self) -> Search:
        """Return the search over the space, from the middle of each."""
        own = self.config
        settings = CmaSettings(population=20, sigma=own.sigma, evaluations=own.evaluations)
        return CmaSearch(settings, own.seed, np.full(len(self.space.parameters), 0.5))

    def make_fitness(self, workers: int, address: str) -> Fitness:
        """Return the graded fitness; a baseline's generation is too small for a cluster."""
        searched = replace(self.flat, penalty='graded', margin=SEARCHED.margin)
        if self.config.scenario == PAPER:
            searched = replace(SEARCHED, disturbance=self.config.disturbance)
        return Fitness(self.starts, searched, workers)

    @property
    def flat(self) -> FitnessSettings:
        """The flat penalty; of another scenario than the paper's, in its unit of energy."""
        if self.config.scenario == PAPER:
            return FitnessSettings()
        return FitnessSettings(penalty_n2s=penalty_n2s(self.starts))

    @property
    def space(self) -> TuningSpace:
        """The tuning space of the kind; of another scenario, in its units."""
        space = TUNING_SPACES[self.config.kind]
        return space if self.config.scenario == PAPER else space.scaled(units_of(self.starts))

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
        made = self.space.make(self.space.values(genes), self.model)
        most_n = self.starts.base.max_force_n
        return replace(made, name=self.config.name, max_force_n=most_n)

    def found(self) -> Baseline:
        """Return the best so far, its provenance filled in."""
        found = self.make(self.best_genes)
        judge = Fitness(self.starts, self.flat, 1)
        with judge.simulator:
            scores = judge.score([found])
        provenance = {
            'method': 'rpo tune',
            'command': self.config.command,
            'algorithm': 'cmaes',
            'seed': self.config.seed,
            'scenario': self.config.scenario,
            'evaluations': self.checkpoint.evaluations,
            'stopped': self.search.stopped,
            'searched_fitness_n2s': float(self.best[0]),
            'fitness_n2s': float(scores.fitness[0]),
            'mean_energy_n2s': float(scores.energy[0]),
            'starts_that_miss': self.misses(scores),
            'versions': versions(),
            'arithmetic': processor.in_use(),
        }
        return replace(found, description=self.space.description, provenance=provenance)
