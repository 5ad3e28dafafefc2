# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Searches by ask and tell: genetic algorithm, CMA-ES, one after the other, NSGA-II.

A search depends on its settings, its seed and the objectives it gets, on nothing else: with the
same objectives it asks for the same chromosomes again. That is how a run is resumed.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Generator
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, NamedTuple

import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.core.evaluator import Evaluator
from pymoo.core.problem import Problem
from pymoo.core.termination import NoTermination
from pymoo.problems.static import StaticProblem

from rpo_core.files.validation import Checked, real, whole
from rpo_kernels.arrays import Floats
from rpo_training.genetic import GaSettings, PaperGa, first_generation, generator


class Stage(NamedTuple):
    """A part of a search with a fitness of its own.

    number : of the draws; genes : the best chromosome when it began; empty: none is known
    """

    number: int
    genes: Floats


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


@dataclass(frozen=True)
class CmaSettings(Checked):
    """Options of CMA-ES.

    population : samples of a generation
    sigma : first standard deviation, as a share of a gene's range
    evaluations : budget of all descents together
    descents : at most; the first begins at the start, each later one at the best so far, with the
        first sigma
    tolerance : a descent ends when its best has improved by less [N^2 s] over `patience` samples
    """

    PLACE = 'cmaes.'

    population: Annotated[int, partial(whole, least=4, most=100_000)] = 32
    sigma: Annotated[float, partial(real, above=0.0, most=1.0)] = 0.05
    evaluations: int = 30_000
    descents: Annotated[int, partial(whole, least=1)] = 4
    tolerance: Annotated[float, partial(real, unit='N^2 s', least=0.0)] = 1e-3
    patience: Annotated[int, partial(whole, least=1)] = 3000

    def __post_init__(self) -> None:
        super().__post_init__()
        whole('cmaes.evaluations', self.evaluations, least=self.population)


Script = Generator[Floats, Floats, str]
"""Yields chromosomes (n, size); each yield returns their objectives (n, objectives). Returns why it
ends."""


class Search:
    """A search by ask and tell, whose course is a script.

    stopped : why it has ended; empty until then
    best : so far, of the present stage; stage : what is drawn; phase : what runs now
    most : evaluations, at most
    """

    phase = ''

    def __init__(self, seed: int, start: Floats, most: int) -> None:
        self.seed, self.most = seed, most
        self.stopped, self.evaluations = '', 0
        self.best, self.stage = Best(start), Stage(0, np.empty(0))
        self._better = False
        self._course = self._run()
        self._asked = next(self._course)

    @abstractmethod
    def _run(self) -> Script:
        """Return the course."""

    @property
    def left(self) -> int:
        """Generations left, at most, of the size of the present one."""
        return -(-max(self.most - self.evaluations, 0) // len(self._asked))

    def ask(self) -> Floats:
        """Return chromosomes (n, size) in [0, 1] to be evaluated."""
        return np.array(self._asked)

    def tell(self, values: Floats) -> None:
        """Take the objectives (n, objectives) of those."""
        self.evaluations += len(values)
        self._better = self.best.take(self._asked, values)
        try:
            self._asked = self._course.send(values)
        except StopIteration as end:
            self.stopped = end.value

    def _evolve(
        self, algorithm: Any, size: int, objectives: int, generations: int, stall: int
    ) -> Script:
        """Let an algorithm of pymoo ask, until `stall` generations have no better fitness."""
        problem = Problem(n_var=size, n_obj=objectives, xl=np.zeros(size), xu=np.ones(size))
        algorithm.setup(problem, termination=NoTermination())
        stalled = 0
        for number in range(generations + 1):
            if stalled >= stall:
                return f'no better controller in {stall} generations'
            algorithm.random_state = generator(self.seed, number)
            asked = algorithm.ask()
            values = yield np.array(asked.get('X'))
            Evaluator().eval(StaticProblem(problem, F=values), asked)
            algorithm.tell(infills=asked)
            stalled = 0 if self._better else stalled + 1
        return f'{generations} generations'

    def _descend(
        self,
        settings: CmaSettings,
        start: Floats,
        stream: int = 0,
        complete: Callable[[Floats], Floats] = np.array,
    ) -> Generator[Floats, Floats, tuple[Best, str]]:
        """Run CMA-ES from a chromosome, restarted from its best; return that, and why it ends.

        complete : from the genes that it varies to chromosomes
        """
        import cma  # brings matplotlib, which other searches need not wait for

        best, left, back = (
            Best(start),
            settings.evaluations,
            settings.patience // settings.population,
        )
        for descent in range(settings.descents):
            rng = generator(self.seed, (1 << 20) + stream, descent)
            options = {
                'bounds': [0, 1],
                'popsize': settings.population,
                'randn': lambda *shape, rng=rng: rng.standard_normal(shape),
                'seed': float('nan'),
                'verbose': -9,
            }
            begin = np.clip(best.genes, 1e-3, 1.0 - 1e-3)
            strategy = cma.CMAEvolutionStrategy(begin, settings.sigma, options)
            bests: list[float] = []
            spent = False
            while not spent:
                asked = strategy.ask()
                values = yield complete(np.array(asked))
                strategy.tell(asked, values[:, 0].tolist())
                left -= len(values)
                best.take(asked, values)
                bests.append(min([float(values.min()), *bests[-1:]]))
                if left <= 0:
                    return best, f'{settings.evaluations} evaluations'
                if len(bests) <= back:
                    spent = bool(strategy.stop())
                else:
                    spent = bests[-back - 1] - bests[-1] < settings.tolerance
        return best, f'{settings.descents} descents have converged'


class GaSearch(Search):
    """The paper's genetic algorithm; stops after `stall` generations without a better fitness."""

    phase = 'GA'

    def __init__(self, settings: GaSettings, seed: int, size: int, starts: Floats) -> None:
        self.settings = settings
        self._first = first_generation(settings.population, size, seed, starts)
        most = settings.population + settings.generations * settings.children
        super().__init__(seed, self._first[0], most)

    def _run(self) -> Script:
        own, size = self.settings, self._first.shape[1]
        algorithm = PaperGa(own, self.seed, self._first)
        return (yield from self._evolve(algorithm, size, 1, own.generations, own.stall))


class ParetoSearch(GaSearch):
    """NSGA-II over fitness and a second objective, with pymoo's own operators."""

    phase = 'NSGA-II'

    def _run(self) -> Script:
        own, size = self.settings, self._first.shape[1]
        self.most = own.population * (own.generations + 1)
        algorithm = NSGA2(own.population, sampling=self._first, seed=self.seed)
        return (yield from self._evolve(algorithm, size, 2, own.generations, own.generations + 1))


class CmaSearch(Search):
    """CMA-ES in the unit box, restarted from its best."""

    phase = 'CMA-ES'

    def __init__(self, settings: CmaSettings, seed: int, start: Floats) -> None:
        self.settings = settings
        super().__init__(seed, start, settings.evaluations)

    def _run(self) -> Script:
        _, reason = yield from self._descend(self.settings, self.best.genes)
        return reason


class InTurn(GaSearch):
    """The genetic algorithm, then CMA-ES from its best chromosome."""

    def __init__(
        self, settings: GaSettings, then: CmaSettings, seed: int, size: int, starts: Floats
    ) -> None:
        self._then = then
        super().__init__(settings, seed, size, starts)

    def _run(self) -> Script:
        yield from super()._run()
        self.phase, self.most = CmaSearch.phase, self.evaluations + self._then.evaluations
        _, reason = yield from self._descend(self._then, self.best.genes)
        return reason
