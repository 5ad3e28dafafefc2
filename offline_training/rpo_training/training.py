# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A training run: search, simulator and run folder together.

The run folder holds `config.yaml`, `checkpoint.npz` after each generation, and at the end
`history.csv` and the controller `<name>.yaml`; of a front, one file for each point and `front.csv`.
"""

from __future__ import annotations

import csv
import io
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rpo_core import controller as controllers
from rpo_core.controller import FuzzyController, load_fuzzy
from rpo_core.scenario import load_set
from rpo_core.validation import InputError
from rpo_training import config as configs
from rpo_training.assessment import assess
from rpo_training.config import TrainingConfig
from rpo_training.evaluation import Simulator
from rpo_training.fitness import CONDITIONS, Fitness, Scores
from rpo_training.ledger import Ledger, digest, versions, write_aside
from rpo_training.race import TableRace
from rpo_training.remote import ClusterSimulator
from rpo_training.search import CmaSearch, GaSearch, InTurn, ParetoSearch, Search

Floats = NDArray[np.float64]

CONFIG, CHECKPOINT, HISTORY, FRONT = 'config.yaml', 'checkpoint.npz', 'history.csv', 'front.csv'

_COLUMNS = (
    'generation',
    'evaluations',
    'best_fitness',
    'mean_fitness',
    'fitness_spread',
    'best_energy_n2s',
    *(f'best_misses_{c}' for c in CONDITIONS),
    'best_arrival_s',
)


@dataclass(frozen=True)
class Progress:
    """Where a run stands after a generation.

    mean, spread : mean and standard deviation of the generation's fitness [N^2 s]
    failures : starts that miss each of the conditions, for the best so far
    flown : controllers flown by this process; seconds : time it took, flying and all
    """

    phase: str
    generation: int
    left: int
    evaluations: int
    best: float
    energy: float
    failures: tuple[int, int, int]
    arrival_s: float
    mean: float
    spread: float
    flown: int
    seconds: float


def make_search(config: TrainingConfig) -> Search:
    """Return the search of a configuration, at its beginning."""
    starts = np.array([config.genes.encode(_start(name, config)) for name in config.start])
    starts = starts.reshape(-1, config.genes.size)
    cma = partial(CmaSearch, config.cmaes, config.seed)
    if config.algorithm == 'cmaes':
        return cma(starts[0])
    if config.algorithm == 'race':
        return TableRace(config.race, config.cmaes, config.seed, config.genes, starts[0])
    if config.algorithm == 'nsga2':
        return ParetoSearch(config.ga, config.seed, config.genes.size, starts)
    ga = GaSearch(config.ga, config.seed, config.genes.size, starts)
    return ga if config.algorithm == 'ga' else InTurn(ga, cma)


def _start(name: str, config: TrainingConfig) -> FuzzyController:
    """Return a start with the scales of the search where those are fixed."""
    start, space = load_fuzzy(name), config.genes
    scales = []
    for value, (least, most) in zip(
        start.scales, (space.position_scale_m, space.velocity_scale_m_s), strict=False
    ):
        scales.append(value if least < most else least)
    return replace(start, position_scale_m=scales[0], velocity_scale_m_s=scales[1])


class Training:
    """One run in its folder; `run` flies it to its end, or on from its checkpoint.

    workers : threads, or processes of a local cluster; 0, one per core
    address : of a cluster: '', on threads; 'local'; that of a scheduler, tcp://host:port
    """

    def __init__(
        self, config: TrainingConfig, folder: Path, workers: int = 0, address: str = ''
    ) -> None:
        self.config, self.folder = config, folder
        self.search = make_search(config)
        make = partial(ClusterSimulator, address=address) if address else Simulator
        self.fitness = Fitness(load_set(config.scenario), config.fitness, workers, make)
        self.ledger = Ledger(configs.dumps(config))
        self.best = np.full(6, np.inf)
        self.best_genes: Floats = np.empty(0)
        self._genes: list[Floats] = []
        self._flown, self._began = 0, time.monotonic()

    @classmethod
    def create(
        cls, config: TrainingConfig, folder: Path, workers: int = 0, address: str = ''
    ) -> Training:
        """Return a new run; its folder must not hold another."""
        if (folder / CONFIG).exists():
            raise InputError(f'{folder}: holds a run already; resume it, or name another folder')
        training = cls(config, folder, workers, address)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f'{folder}: cannot be made: {error.strerror or error}') from None
        write_aside(folder / CONFIG, lambda file: file.write(training.ledger.config.encode()))
        return training

    @classmethod
    def resume(cls, folder: Path, workers: int = 0, address: str = '') -> Training:
        """Return the run of a folder, where its checkpoint left it.

        Raises
        ------
        InputError
            If folder or checkpoint are unusable, or the search no longer asks what it asked.
        """
        training = cls(configs.load(folder / CONFIG), folder, workers, address)
        saved = Ledger.load(folder / CHECKPOINT, training.ledger.config)
        for number, (marks, was) in enumerate(zip(saved.marks, saved.digests, strict=True)):
            genes = training.search.ask()
            if digest(genes) != was:
                raise InputError(
                    f'{folder / CHECKPOINT}: generation {number} does not repeat on '
                    'this machine; it must be resumed where it began'
                )
            training._enter(
                genes, Scores(marks[:, 0], marks[:, 1], marks[:, 2:5].astype(np.int64), marks[:, 5])
            )
        return training

    def _enter(self, genes: Floats, scores: Scores) -> None:
        """Tell the search, enter the ledger, keep the best; the first of equals stays."""
        self.ledger.add(genes, scores)
        marks = self.ledger.marks[-1]
        index = int(marks[:, 0].argmin())
        if marks[index, 0] < self.best[0]:
            self.best, self.best_genes = marks[index], genes[index].copy()
        values = marks[:, :1]
        if self.config.algorithm == 'nsga2':
            penalty = scores.fitness - scores.energy
            values = np.column_stack([scores.fitness, scores.arrival + penalty])
            self._genes.append(genes)
        self.search.tell(values)

    def run(self, report: Callable[[Progress], None] = lambda _: None) -> FuzzyController:
        """Fly to the end of the search; save after each generation; return the best controller."""
        self._began = time.monotonic()
        with self.fitness.simulator:
            while not self.search.stopped:
                genes = self.search.ask()
                scores = self.fitness.score(self.config.genes.decode(genes))
                self._flown += len(genes)
                self._enter(genes, scores)
                self.ledger.save(self.folder / CHECKPOINT)
                report(self.progress())
            self.save_history()
            best = self.controller(self.best_genes, self.config.name)
            self._save(best)
            if self.config.algorithm == 'nsga2':
                self._save_front()
        return best

    def progress(self) -> Progress:
        """Return where the run stands; there must be a generation."""
        fitness = self.ledger.marks[-1][:, 0]
        fitness_best, energy, *failures, arrival = self.best.tolist()
        return Progress(
            self.search.phase,
            len(self.ledger.marks) - 1,
            self.search.left,
            self.ledger.evaluations,
            fitness_best,
            energy,
            (int(failures[0]), int(failures[1]), int(failures[2])),
            arrival,
            float(fitness.mean()),
            float(fitness.std()),
            self._flown,
            time.monotonic() - self._began,
        )

    def save_history(self) -> None:
        """Write `history.csv`, a row for each generation."""
        text = io.StringIO()
        rows = csv.writer(text, lineterminator='\n')
        rows.writerow(_COLUMNS)
        best, evaluations = np.full(6, np.inf), 0
        for number, marks in enumerate(self.ledger.marks):
            evaluations += len(marks)
            first = marks[int(marks[:, 0].argmin())]
            best = first if first[0] < best[0] else best
            rows.writerow(
                [
                    number,
                    evaluations,
                    repr(float(best[0])),
                    float(marks[:, 0].mean()),
                    float(marks[:, 0].std()),
                    float(best[1]),
                    *best[2:5].astype(int),
                    float(best[5]),
                ]
            )
        write_aside(self.folder / HISTORY, lambda file: file.write(text.getvalue().encode()))

    def controller(self, genes: Floats, name: str) -> FuzzyController:
        """Return the controller of a chromosome, its provenance filled in."""
        config = self.config
        population = config.genes.decode(genes[None])
        scores = self.fitness.score(population)
        provenance: dict[str, object] = {
            'method': 'rpo train',
            'command': configs.command(config),
            'algorithm': config.algorithm,
            'seed': config.seed,
            'scenario': config.scenario,
            'generations': len(self.ledger.marks) - 1,
            'evaluations': self.ledger.evaluations,
            'stopped': self.search.stopped,
            'fitness_n2s': float(scores.fitness[0]),
            'mean_energy_n2s': float(scores.energy[0]),
            'mean_arrival_s': float(scores.arrival[0]),
            'starts_that_miss': dict(zip(CONDITIONS, map(int, scores.failures[0]), strict=True)),
            'versions': versions(),
        }
        found = population.controller(0, name)
        provenance['targets'] = {mark.what: mark.reached for mark in assess(found).marks()}
        return replace(found, provenance=provenance)

    def _save(self, controller: FuzzyController) -> None:
        path = self.folder / f'{controller.name}.yaml'
        write_aside(path, lambda file: file.write(controllers.dumps(controller).encode()))

    def _save_front(self) -> None:
        """Write the penalty-free controllers of which none is better in both objectives."""
        genes, marks = np.concatenate(self._genes), np.concatenate(self.ledger.marks)
        clean = np.flatnonzero(marks[:, 2:5].sum(axis=1) == 0)
        order = clean[np.lexsort((marks[clean, 5], marks[clean, 1]))]
        text = io.StringIO()
        rows = csv.writer(text, lineterminator='\n')
        rows.writerow(['controller', 'mean_energy_n2s', 'mean_arrival_s'])
        soonest, count = np.inf, 0
        for index in order:
            if marks[index, 5] < soonest:
                soonest = marks[index, 5]
                name = f'{self.config.name}_{count:03d}'
                self._save(self.controller(genes[index], name))
                rows.writerow([name, float(marks[index, 1]), float(soonest)])
                count += 1
        write_aside(self.folder / FRONT, lambda file: file.write(text.getvalue().encode()))
