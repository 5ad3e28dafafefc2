# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A search: created, run, and, if it has a folder, saved after each generation, resumed.

The folder holds the configuration, `checkpoint.npz` after each generation, and at the end the
controller `<name>.yaml`. A search with the same objectives asks for the same chromosomes. So a run
is resumed from the scores of its generations, without flying again; the state of the search itself
is not saved. A digest of the chromosomes of each generation shows when they differ, as under
another version of a library.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from rpo.montecarlo.outputs import (
    alone,
    digest_of,
    make_folder,
    read_arrays,
    write_aside,
    write_text,
)
from rpo.scoring.fitness import Fitness, Scores
from rpo.training import processor
from rpo.training.algorithms import Search
from rpo.training.config import COMMAND, Configuration, start_file
from rpo.training.fitting import training_set
from rpo_core import files
from rpo_core.control import controller as controllers
from rpo_core.control.attitude import FuzzyAttitude
from rpo_core.control.baselines import Baseline
from rpo_core.control.controller import FuzzyController
from rpo_core.control.family import Family
from rpo_core.files.validation import InputError
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import ScenarioSet

CHECKPOINT, HISTORY = 'checkpoint.npz', 'history.csv'
SCHEMA = 'rpo/checkpoint/2'

LIBRARIES = ('rpo', 'numpy', 'numba', 'pymoo', 'cma')
"""The bits of a run depend on these."""


def versions() -> dict[str, str]:
    """Return the versions of `LIBRARIES`."""
    return {name: version(name) for name in LIBRARIES}


@dataclass
class Checkpoint:
    """The generations so far.

    config : text of the configuration
    inputs : texts of the files that it names
    scores : per generation (n, 3 + k): fitness, energy, failures of k conditions, arrival time
    digests : of the chromosomes of each
    """

    config: str
    inputs: Sequence[str] = ()
    scores: list[Floats] = field(default_factory=list)
    digests: list[str] = field(default_factory=list)

    def add(self, genes: Floats, scores: Scores) -> None:
        """Add a generation."""
        self.scores.append(
            np.column_stack([scores.fitness, scores.energy, scores.failures, scores.arrival])
        )
        self.digests.append(digest(genes))

    @property
    def evaluations(self) -> int:
        """Controllers evaluated so far."""
        return sum(map(len, self.scores))

    def save(self, path: Path) -> None:
        """Write the checkpoint."""
        arrays = {
            'schema': np.array(SCHEMA),
            'config': np.array(self.config),
            'inputs': np.array(digest_of(*self.inputs)),
            'versions': np.array([f'{k} {v}' for k, v in versions().items()]),
            'sizes': np.array([len(s) for s in self.scores]),
            'marks': np.concatenate(self.scores) if self.scores else np.empty((0, 3)),
            'digests': np.array(self.digests, dtype='U16'),
        }
        write_aside(path, lambda file: np.savez(file, allow_pickle=False, **arrays))

    @classmethod
    def load(cls, path: Path, config: str, inputs: Sequence[str] = ()) -> Checkpoint:
        """Return a checkpoint that was written under the configuration `config`.

        Raises
        ------
        InputError
            If it is missing, damaged, or of another version, configuration or other inputs.
        """
        if not path.exists():
            raise InputError(f'{path}: there is no checkpoint to resume from')
        data = read_arrays(path)
        if (found := str(data.get('schema'))) != SCHEMA:
            raise InputError(f'{path}: its schema must be {SCHEMA}; got {found}')
        try:
            theirs = dict(entry.split(' ', 1) for entry in data['versions'].tolist())
            written, bound = str(data['config']), str(data['inputs'])
            sizes, digests, rows = data['sizes'], data['digests'].tolist(), data['marks']
            scores = np.split(rows, np.cumsum(sizes)[:-1]) if len(sizes) else []
            fits = rows.ndim == 2 and rows.shape[1] >= 3 and rows.dtype == np.float64
            if not fits or [len(s) for s in scores] != sizes.tolist() or min(sizes, default=1) < 1:
                raise ValueError(f'{rows.shape} scores of {len(sizes)} generations')
            if len(sizes) != len(digests):
                raise ValueError('a generation has no digest')
        except (KeyError, ValueError, TypeError, AttributeError) as error:
            raise InputError(f'{path}: is damaged: {error}') from None
        if theirs != versions():
            changed = [
                f'{k} {theirs.get(k, "none")} (now {v})'
                for k, v in versions().items()
                if theirs.get(k) != v
            ]
            raise InputError(
                f'{path}: was written with {", ".join(changed)}; resuming requires the same '
                'versions'
            )
        if written != config:
            raise InputError(f'{path}: is of another configuration than {path.parent}/config.yaml')
        if bound != digest_of(*inputs):
            raise InputError(
                f'{path}: was written with another content of the scenario or of a start that '
                f'{path.parent}/config.yaml names'
            )
        return cls(config, inputs, scores, digests)


def digest(genes: Floats) -> str:
    """Return a short digest of chromosomes."""
    return hashlib.sha256(np.ascontiguousarray(genes).tobytes()).hexdigest()[:16]


Config = TypeVar('Config', bound=Configuration)
Found = TypeVar('Found', FuzzyController, Baseline, Family, FuzzyAttitude)
Self = TypeVar('Self', bound='SearchRun[Any, Any]')


class SearchRun(Generic[Config, Found]):
    """A search; `run` runs it to its end, in a folder from its checkpoint if there is one.

    config_type : class of the configuration
    unit, scored : of fitness and energy; what the provenance calls these, arrival, and misses
    workers : threads; 0, one per core
    """

    config_type: ClassVar[type[Configuration]]
    unit: ClassVar[str] = 'N²s'
    scored: ClassVar[tuple[str, ...]] = (
        'fitness_n2s', 'mean_energy_n2s', 'mean_arrival_s', 'starts_that_miss',
    )  # fmt: skip

    def __init__(self, config: Config, folder: Path | None, workers: int = 0) -> None:
        self.config: Config = config
        self.folder = folder
        self.search = self.make_search()
        self.fitness = self.make_fitness(workers)
        self.checkpoint = Checkpoint(self.config.dumps(), self.inputs())
        self.best = np.full(3, np.inf)
        self.best_genes: Floats = np.empty(0)
        self.chromosomes: list[Floats] = []
        self.history: list[dict[str, Any]] = []

    @cached_property
    def starts(self) -> ScenarioSet:
        """The set that is flown."""
        return training_set(self.config.scenario)

    def inputs(self) -> list[str]:
        """Return the texts of the scenario, of the starts, and of the campaigns."""
        paths = [files.find('scenario', self.config.scenario), *map(start_file, self.config.starts)]
        found = [files.read_text(path) for path in paths]
        return found + [text for flights in self.fitness.drawn for text in flights.texts]

    def make_search(self) -> Search:
        """Return the search at its beginning."""
        raise NotImplementedError

    def make_fitness(self, workers: int) -> Fitness:
        """Return the fitness that evaluates a generation: that of the configuration."""
        return Fitness(self.starts, self.config.fitness, workers)

    def _enter_stage(self) -> None:
        """Draw the flights of the stage."""
        number, genes = self.search.stage
        self.fitness.enter(number, self.decode(genes[None]) if len(genes) else None)

    def decode(self, genes: Floats) -> Any:
        """Return the controllers of a generation of chromosomes (n, genes)."""
        raise NotImplementedError

    def objectives(self, scores: Scores) -> Floats:
        """Return the objectives (n, objectives) of a generation."""
        return scores.fitness[:, None]

    def found(self) -> Found:
        """Return the best so far, its provenance filled in."""
        raise NotImplementedError

    def credited(self, found: Found, algorithm: str, scores: Scores, **more: object) -> Found:
        """Return a controller with its provenance filled in: how it was found, its scores, more."""
        values: list[Any] = [float(scores.fitness[0]), float(scores.energy[0])]
        labels = self.fitness.conditions.labels
        misses = dict(zip(labels, map(int, scores.failures[0]), strict=False))
        values += [float(scores.arrival[0]), misses]
        provenance = {
            'method': COMMAND,
            'command': self.config.command,
            'algorithm': algorithm,
            'seed': self.config.seed,
            'scenario': self.config.scenario,
            'generations': len(self.checkpoint.scores) - 1,
            'evaluations': self.checkpoint.evaluations,
            'stopped': self.search.stopped,
            **dict(zip(self.scored, values, strict=True)),
            'versions': versions(),
            'arithmetic': processor.in_use(),
        }
        if self.fitness.drawn:
            judged = {flights.label: flights.judged for flights in self.fitness.drawn}
            provenance['drawn_flights_judged_by'] = judged
        return replace(found, provenance=provenance | more)

    @property
    def flown(self) -> str:
        """What every candidate flies."""
        return f'{len(self.starts.initial_positions_m)} starts'

    @classmethod
    def begin(cls: type[Self], config: Any, folder: Path | None, workers: int = 0) -> Self:
        """Return the same run of a folder, or a new one; raises InputError."""
        if folder is None:
            return cls(config, None, workers)
        path = folder / cls.config_type.file
        if not path.is_file() or files.read_text(path) != config.dumps():
            return cls.create(config, folder, workers)
        begun = (folder / CHECKPOINT).exists()
        return cls.resume(folder, workers) if begun else cls(config, folder, workers)

    @classmethod
    def create(cls: type[Self], config: Any, folder: Path, workers: int = 0) -> Self:
        """Return a new run; raises InputError if its folder holds another."""
        if (folder / cls.config_type.file).exists():
            raise InputError(
                f'{folder}: holds a run already; resume it with `{COMMAND} --resume {folder}`, or '
                ' name another folder with `-o`'
            )
        new = cls(config, folder, workers)
        make_folder(folder)
        write_text(folder / cls.config_type.file, new.checkpoint.config)
        return new

    @classmethod
    def resume(cls: type[Self], folder: Path, workers: int = 0) -> Self:
        """Return the run of a folder, at its checkpoint.

        Raises
        ------
        InputError
            If folder or checkpoint are unusable, or the search asks for other chromosomes.
        """
        config: Any = cls.config_type.load(folder / cls.config_type.file)
        again = cls(config, folder, workers)
        own = again.checkpoint
        saved = Checkpoint.load(folder / CHECKPOINT, own.config, own.inputs)
        for number, (rows, before) in enumerate(zip(saved.scores, saved.digests, strict=True)):
            genes = again.search.ask()
            if digest(genes) != before:
                raise InputError(
                    f'{folder / CHECKPOINT}: generation {number} does not repeat: the run began '
                    f'with other arithmetic than this process, {processor.named()}; resume it in '
                    'a process like that one'
                )
            failures = rows[:, 2:-1].astype(np.int64)
            again._enter(genes, Scores(rows[:, 0], rows[:, 1], failures, rows[:, -1]))
        return again

    def _enter(self, genes: Floats, scores: Scores) -> None:
        """Take in a generation: checkpoint, best (of equals the first), history, search."""
        self.checkpoint.add(genes, scores)
        self.chromosomes.append(genes)
        rows, stage = self.checkpoint.scores[-1], self.search.stage.number
        index = int(rows[:, 0].argmin())
        anew = not self.history or self.history[-1]['stage'] != stage  # it has another fitness
        if anew or rows[index, 0] < self.best[0]:
            self.best, self.best_genes = rows[index], genes[index].copy()
        best, energy, *misses, arrival = self.best.tolist()
        missed = zip(self.fitness.labels, map(int, misses), strict=True)
        self.history.append(
            {
                'generation': len(self.history),
                'evaluations': self.checkpoint.evaluations,
                'best_fitness': best,
                'mean_fitness': float(rows[:, 0].mean()),
                'fitness_spread': float(rows[:, 0].std()),
                'best_energy_n2s': energy,
                **{f'best_misses_{name}': n for name, n in missed},
                'best_arrival_s': arrival,
                'stage': stage,
            }
        )
        self.search.tell(self.objectives(scores))

    def run(self, report: Callable[[], object] = lambda: None) -> Found:
        """Run the search to its end; save after each generation, then report; return the best.

        Warns if the arithmetic of this process is not pinned (`rpo.training.processor`).

        Raises
        ------
        InputError
            If another process runs it, or a file cannot be written.
        """
        processor.warn_unless_pinned()
        with self.fitness.simulator, ExitStack() as locks:
            if self.folder is not None:
                path = self.folder / self.config_type.file
                locks.enter_context(alone(path, 'goes on with this run'))
            while not self.search.stopped:
                self._enter_stage()
                genes = self.search.ask()
                scores = self.fitness.score(self.decode(genes))
                self._enter(genes, scores)
                if self.folder is not None:
                    self.checkpoint.save(self.folder / CHECKPOINT)
                report()
            self._enter_stage()
            best = self.found()
            if self.folder is not None:
                self.save(best, self.folder)
                self.save_more(self.folder)
        return best

    def save(self, controller: Found, folder: Path) -> None:
        """Write a controller into a folder."""
        write_text(folder / f'{controller.name}.yaml', self.dumps(controller))

    def dumps(self, controller: Any) -> str:
        """Return the YAML text of a controller."""
        return controllers.dumps(controller)

    def save_more(self, folder: Path) -> None:
        """Write what a folder holds beside the best: `history.csv`, a row for each generation."""
        write_csv(folder / HISTORY, self.history)


def write_csv(
    path: Path, rows: Sequence[Mapping[str, object]], columns: Sequence[str] = ()
) -> None:
    """Write rows, with headings."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns or list(rows[0]), lineterminator='\n')
    writer.writeheader()
    writer.writerows(rows)
    write_text(path, text.getvalue())
