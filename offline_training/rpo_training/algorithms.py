# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Searches by ask and tell: genetic algorithm, CMA-ES, one after the other, NSGA-II.

A search depends on its settings, its seed and the objectives it gets, on nothing else: with the
same objectives it asks for the same chromosomes again. That is how a run is resumed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.core.evaluator import Evaluator
from pymoo.core.problem import Problem
from pymoo.core.termination import NoTermination
from pymoo.problems.static import StaticProblem

from rpo_core.files.validation import real, whole
from rpo_kernels.arrays import Floats
from rpo_training.genetic import GaSettings, PaperGa, first_generation, generator


class Stage(NamedTuple):
    """A part of a search with a fitness of its own.

    number : of the draws; genes : the best chromosome when it began
    """

    number: int
    genes: Floats


class Search(Protocol):
    """A search by ask and tell.

    stopped : why it has ended; empty until then
    """

    stopped: str

    @property
    def phase(self) -> str:
        """Name of the search that runs."""

    @property
    def left(self) -> int:
        """Generations left, at most."""

    def ask(self) -> Floats:
        """Return chromosomes (n, size) in [0, 1] to be evaluated."""

    def tell(self, values: Floats) -> None:
        """Take the objectives (n, objectives) of those."""


class Best:
    """The best chromosome so far; of equals, the first."""

    def __init__(self, genes: Floats) -> None:
        self.genes, self.value = genes, np.inf

    def take(self, genes: Floats, values: Floats) -> bool:
        """Take in chromosomes (n, size) with their fitness (n, 1); return whether one is better."""
        index = int(values[:, 0].argmin())
        better = bool(values[index, 0] < self.value)
        if better:
            self.value, self.genes = values[index, 0], np.array(genes[index])
        return better


class _OnPymoo:
    """Ask and tell on a pymoo algorithm."""

    phase = ''

    def __init__(self, algorithm: Any, settings: GaSettings, size: int, objectives: int) -> None:
        self.problem = Problem(n_var=size, n_obj=objectives, xl=np.zeros(size), xu=np.ones(size))
        self.settings, self.stopped = settings, ''
        self.algorithm = algorithm.setup(self.problem, termination=NoTermination())
        self._asked: Any = None
        self.generation = 0

    @property
    def left(self) -> int:
        """Generations left, at most."""
        return self.settings.generations + 1 - self.generation

    def ask(self) -> Floats:
        """Return chromosomes (n, size) to be evaluated."""
        self._asked = self.algorithm.ask()
        return np.array(self._asked.get('X'))

    def tell(self, values: Floats) -> None:
        """Take the objectives (n, objectives) of those."""
        Evaluator().eval(StaticProblem(self.problem, F=values), self._asked)
        self.algorithm.tell(infills=self._asked)
        self.generation += 1
        if self.left == 0:
            self.stopped = f'{self.settings.generations} generations'


class GaSearch(_OnPymoo):
    """The paper's genetic algorithm; stops after `stall` generations without a better fitness."""

    phase = 'GA'

    def __init__(self, settings: GaSettings, seed: int, size: int, starts: Floats) -> None:
        first = first_generation(settings.population, size, seed, starts)
        super().__init__(PaperGa(settings, seed, first), settings, size, 1)
        self.best, self._stalled = Best(first[0]), 0

    def tell(self, values: Floats) -> None:
        """Take the fitness (n, 1) of those."""
        genes = np.array(self._asked.get('X'))
        super().tell(values)
        self._stalled = 0 if self.best.take(genes, values) else self._stalled + 1
        if self._stalled >= self.settings.stall and not self.stopped:
            self.stopped = f'no better controller in {self.settings.stall} generations'


class ParetoSearch(_OnPymoo):
    """NSGA-II over several objectives, with pymoo's own operators."""

    phase = 'NSGA-II'

    def __init__(self, settings: GaSettings, seed: int, size: int, starts: Floats) -> None:
        first = first_generation(settings.population, size, seed, starts)
        super().__init__(NSGA2(settings.population, sampling=first, seed=seed), settings, size, 2)
        self.seed = seed

    def ask(self) -> Floats:
        """Return chromosomes (n, size) to be evaluated."""
        self.algorithm.random_state = generator(self.seed, self.generation)
        return super().ask()


@dataclass(frozen=True)
class CmaSettings:
    """Options of CMA-ES.

    population : samples of a generation
    sigma : first standard deviation, as a share of a gene's range
    evaluations : budget of all descents together
    descents : at most; the first begins at the start, each later one at the best so far, with the
        first sigma
    tolerance : a descent ends when its best has improved by less [N^2 s] over `patience` samples
    """

    population: int = 32
    sigma: float = 0.05
    evaluations: int = 30_000
    descents: int = 4
    tolerance: float = 1e-3
    patience: int = 3000

    def __post_init__(self) -> None:
        whole('cmaes.population', self.population, least=4, most=100_000)
        real('cmaes.sigma', self.sigma, above=0.0, most=1.0)
        whole('cmaes.evaluations', self.evaluations, least=self.population)
        whole('cmaes.descents', self.descents, least=1)
        real('cmaes.tolerance', self.tolerance, 'N^2 s', least=0.0)
        whole('cmaes.patience', self.patience, least=1)


class CmaSearch:
    """CMA-ES in the unit box, restarted from its best."""

    phase = 'CMA-ES'

    def __init__(self, settings: CmaSettings, seed: int, start: Floats, stream: int = 0) -> None:
        self.settings, self.seed, self.stopped = settings, seed, ''
        self._stream = (1 << 20) + stream
        self.best = Best(start)
        self.evaluations = self.descent = 0
        self._descend()

    @property
    def left(self) -> int:
        """Generations left, at most."""
        return -(-(self.settings.evaluations - self.evaluations) // self.settings.population)

    def _descend(self) -> None:
        import cma  # brings matplotlib, which other searches need not wait for

        rng = generator(self.seed, self._stream, self.descent)
        self.descent += 1
        self._bests: list[float] = []
        options = {
            'bounds': [0, 1],
            'popsize': self.settings.population,
            'randn': lambda *shape: rng.standard_normal(shape),
            'seed': float('nan'),
            'verbose': -9,
        }
        start = np.clip(self.best.genes, 1e-3, 1.0 - 1e-3)
        self._es = cma.CMAEvolutionStrategy(start, self.settings.sigma, options)

    def ask(self) -> Floats:
        """Return chromosomes (n, size) to be evaluated."""
        self._asked = self._es.ask()
        return np.array(self._asked)

    def tell(self, values: Floats) -> None:
        """Take the fitness (n, 1) of those."""
        self._es.tell(self._asked, values[:, 0].tolist())
        self.evaluations += len(values)
        self.best.take(self._asked, values)
        self._bests.append(min([float(values.min()), *self._bests[-1:]]))
        if self.left <= 0:
            self.stopped = f'{self.settings.evaluations} evaluations'
        elif self._is_spent():
            if self.descent == self.settings.descents:
                self.stopped = f'{self.descent} descents have converged'
            else:
                self._descend()

    def _is_spent(self) -> bool:
        back = self.settings.patience // self.settings.population
        if len(self._bests) <= back:
            return bool(self._es.stop())
        return self._bests[-back - 1] - self._bests[-1] < self.settings.tolerance
