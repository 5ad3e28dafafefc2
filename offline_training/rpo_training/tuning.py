# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Tuning a rival: the fitness and the starts of the training, at most the paper's evaluations.

The search is CMA-ES on the graded fitness, as the preset `best` judges fuzzy controllers: where no
parameters meet all conditions, the flat penalty would not say which way is better. The folder holds
`tuning.yaml`, `checkpoint.npz` after each generation, and at the end `<kind>.yaml`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from rpo_core import controller as controllers
from rpo_core import files
from rpo_core.rivals import Model, Rival
from rpo_core.scenario import load_set
from rpo_core.validation import InputError, choice, mapping, real, whole
from rpo_training.designs import DESIGNS
from rpo_training.fitness import CONDITIONS, Fitness, FitnessSettings, Scores
from rpo_training.genetic import GaSettings
from rpo_training.ledger import Ledger, digest, versions, write_aside
from rpo_training.rival_batch import RivalSimulator
from rpo_training.search import CmaSearch, CmaSettings
from rpo_training.training import Progress

Floats = NDArray[np.float64]

BUDGET = GaSettings().population * (GaSettings().generations + 1)
"""Evaluations of the paper's genetic algorithm: 60 x 301."""

SCENARIO = 'paper_training'
CONFIG, CHECKPOINT = 'tuning.yaml', 'checkpoint.npz'

SEARCHED = FitnessSettings(penalty='graded', margin=0.001, limit_cycle=20.0)
"""What is minimised; the file also says the paper's flat fitness."""

_GOES_ON = 'rpo tune --resume'


@dataclass(frozen=True)
class TuningConfig:
    """All that decides the outcome of a tuning.

    disturbance : weight [N^2 s] of how far the paper's test is missed, see `rpo_training.fitness`;
        0, as the fuzzy controllers were trained: the test is not flown
    """

    kind: str
    seed: int = 1
    evaluations: int = BUDGET
    disturbance: float = 0.0
    sigma: float = 0.2

    def __post_init__(self) -> None:
        choice('kind', self.kind, DESIGNS)
        whole('seed', self.seed, least=0, most=2**63 - 1)
        whole('evaluations', self.evaluations, least=20, most=BUDGET)
        real('disturbance', self.disturbance, 'N^2 s', least=0.0, most=1e6)

    @property
    def command(self) -> str:
        """The command that repeats it."""
        less = '' if self.evaluations == BUDGET else f' --evaluations {self.evaluations}'
        test = f' --disturbance {self.disturbance:g}' if self.disturbance else ''
        return f'rpo tune {self.kind} --seed {self.seed}{less}{test}'

    @property
    def name(self) -> str:
        """Name of the rival."""
        return f'{self.kind}_disturbed' if self.disturbance else self.kind


def parse(document: Any) -> TuningConfig:
    """Return the configuration of a parsed YAML document; raises InputError."""
    return TuningConfig(**mapping('', document, [f.name for f in fields(TuningConfig)]))


class Tuning:
    """One tuning in its folder; `run` flies it to its end, or on from its checkpoint."""

    def __init__(self, config: TuningConfig, folder: Path, workers: int = 0) -> None:
        self.config, self.folder, self.design = config, folder, DESIGNS[config.kind]
        start = np.full(len(self.design.knobs), 0.5)
        settings = CmaSettings(population=20, sigma=config.sigma, evaluations=config.evaluations)
        self.search = CmaSearch(settings, config.seed, start)
        scenarios = load_set(SCENARIO)
        base = scenarios.base
        self.model = Model(base.orbit_radius_m, base.mass_kg, base.dt_s)
        searched = replace(SEARCHED, disturbance=config.disturbance)
        self.fitness = Fitness(scenarios, searched, workers, RivalSimulator)
        self.ledger = Ledger(yaml.safe_dump(asdict(config), sort_keys=False))
        self.best, self.best_genes = np.full(6, np.inf), start
        self._flown, self._began = 0, time.monotonic()

    @classmethod
    def create(cls, config: TuningConfig, folder: Path, workers: int = 0) -> Tuning:
        """Return a new tuning; its folder must not hold another."""
        if (folder / CONFIG).exists():
            raise InputError(
                f'{folder}: holds a tuning already; `{_GOES_ON} {folder}` goes on with it'
            )
        tuning = cls(config, folder, workers)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f'{folder}: cannot be made: {error.strerror or error}') from None
        write_aside(folder / CONFIG, lambda file: file.write(tuning.ledger.config.encode()))
        return tuning

    @classmethod
    def resume(cls, folder: Path, workers: int = 0) -> Tuning:
        """Return the tuning of a folder, where its checkpoint left it; raises InputError."""
        tuning = cls(files.load(folder / CONFIG, parse), folder, workers)
        saved = Ledger.load(folder / CHECKPOINT, tuning.ledger.config)
        for number, (marks, was) in enumerate(zip(saved.marks, saved.digests, strict=True)):
            genes = tuning.search.ask()
            if digest(genes) != was:
                raise InputError(
                    f'{folder / CHECKPOINT}: generation {number} does not repeat on this machine; '
                    'it must be resumed where it began'
                )
            failures = marks[:, 2:5].astype(np.int64)
            tuning._enter(genes, Scores(marks[:, 0], marks[:, 1], failures, marks[:, 5]))
        return tuning

    def _enter(self, genes: Floats, scores: Scores) -> None:
        """Tell the search, enter the ledger, keep the best; the first of equals stays."""
        self.ledger.add(genes, scores)
        marks = self.ledger.marks[-1]
        index = int(marks[:, 0].argmin())
        if marks[index, 0] < self.best[0]:
            self.best, self.best_genes = marks[index], genes[index].copy()
        self.search.tell(marks[:, :1])

    def run(self, report: Callable[[Progress], None] = lambda _: None) -> Rival:
        """Fly to the end of the search; save after each generation; return the best rival."""
        self._began = time.monotonic()
        with self.fitness.simulator:
            while not self.search.stopped:
                genes = self.search.ask()
                scores = self.fitness.score([self.make(row) for row in genes])
                self._flown += len(genes)
                self._enter(genes, scores)
                self.ledger.save(self.folder / CHECKPOINT)
                report(self.progress())
        best = self.rival()
        path = self.folder / f'{best.name}.yaml'
        write_aside(path, lambda file: file.write(controllers.dumps(best).encode()))
        return best

    def make(self, genes: Floats) -> Rival:
        """Return the rival of a chromosome, without provenance."""
        made = self.design.make(self.design.values(genes), self.model)
        return replace(made, name=self.config.name)

    def progress(self) -> Progress:
        """Return where the tuning stands; there must be a generation."""
        fitness = self.ledger.marks[-1][:, 0]
        best, energy, *failures, arrival = self.best.tolist()
        return Progress(
            f'tuning {self.config.kind}',
            len(self.ledger.marks) - 1,
            self.search.left,
            self.ledger.evaluations,
            best,
            energy,
            (int(failures[0]), int(failures[1]), int(failures[2])),
            arrival,
            float(fitness.mean()),
            float(fitness.std()),
            self._flown,
            time.monotonic() - self._began,
        )

    def rival(self) -> Rival:
        """Return the best so far, its provenance filled in."""
        found = self.make(self.best_genes)
        judge = Fitness(load_set(SCENARIO), FitnessSettings(), 1, RivalSimulator)
        with judge.simulator:
            scores = judge.score([found])
        provenance = {
            'method': 'rpo tune',
            'command': self.config.command,
            'algorithm': 'cmaes',
            'seed': self.config.seed,
            'scenario': SCENARIO,
            'evaluations': self.ledger.evaluations,
            'stopped': self.search.stopped,
            'searched_fitness_n2s': float(self.best[0]),
            'fitness_n2s': float(scores.fitness[0]),
            'mean_energy_n2s': float(scores.energy[0]),
            'starts_that_miss': dict(zip(CONDITIONS, map(int, scores.failures[0]), strict=True)),
            'versions': versions(),
        }
        return replace(found, description=self.design.description, provenance=provenance)
