# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Searches by ask and tell: genetic algorithm, CMA-ES, one after the other, NSGA-II.

A search depends on its settings, its seed and the objectives it gets, on nothing else: with the
same objectives it asks for the same chromosomes again. That is how a run is resumed.
"""

from __future__ import annotations

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

from rpo.training.genetic import GaSettings, PaperGa, first_generation, generator
from rpo_core.files.validation import Checked, real, whole
from rpo_core.kernels.arrays import Floats


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
    tolerance : a descent ends when its best has improved by less [N²s] over `patience` samples
    """

    PLACE = 'cmaes.'

    population: Annotated[int, partial(whole, least=4, most=100_000)] = 32
    sigma: Annotated[float, partial(real, above=0.0, most=1.0)] = 0.05
    evaluations: int = 30_000
    descents: Annotated[int, partial(whole, least=1)] = 4
    tolerance: Annotated[float, partial(real, unit='N²s', least=0.0)] = 1e-3
    patience: Annotated[int, partial(whole, least=1)] = 3000

    def __post_init__(self) -> None:
        super().__post_init__()
        whole('cmaes.evaluations', self.evaluations, least=self.population)


Script = Generator[Floats, Floats, str]
"""Yields chromosomes (n, size); each yield returns their objectives (n, objectives). Returns why it
ends."""

Part = Generator[Floats, Floats, None]
"""A part of a `Script`."""


CMA_ES = 'CMA-ES'


class Search:
    """A search by ask and tell, whose course is a script.

    most : evaluations, at most
    phase : what runs now
    size : samples of most generations; 0: as many as of the present one
    stopped : why it has ended; empty until then
    best : so far, of the present stage; stage : what is drawn
    """

    def __init__(
        self,
        seed: int,
        start: Floats,
        most: int,
        course: Callable[[Any], Script],
        phase: str = '',
        size: int = 0,
    ) -> None:
        self.seed, self.most, self.phase, self._size = seed, most, phase, size
        self.stopped, self.evaluations = '', 0
        self.best, self.stage = Best(start), Stage(0, np.empty(0))
        self._better = False
        self._course = course(self)
        self._asked = next(self._course)

    @property
    def left(self) -> int:
        """Generations left, at most."""
        return -(-max(self.most - self.evaluations, 0) // (self._size or len(self._asked)))

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

    def enter(self, number: int, phase: str, entries: Floats) -> Part:
        """Begin a stage, which judges chromosomes (n, size) anew."""
        self.stage, self.phase = Stage(number, self.best.genes), phase
        self.best = Best(self.best.genes)
        yield entries

    def evolve(self, algorithm: Any, objectives: int, generations: int, stall: int) -> Script:
        """Let an algorithm of pymoo ask, until `stall` generations have no better fitness."""
        size = len(self.best.genes)
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

    def descend(
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


def genetic(
    settings: GaSettings, seed: int, size: int, starts: Floats, then: CmaSettings | None = None
) -> Search:
    """Return the paper's genetic algorithm; then, if given, CMA-ES from its best chromosome."""
    first = first_generation(settings.population, size, seed, starts)

    def course(search: Search) -> Script:
        algorithm = PaperGa(settings, seed, first)
        reason = yield from search.evolve(algorithm, 1, settings.generations, settings.stall)
        if then is not None:
            search.phase, search.most = CMA_ES, search.evaluations + then.evaluations
            _, reason = yield from search.descend(then, search.best.genes)
        return reason

    most = settings.population + settings.generations * settings.children
    return Search(seed, first[0], most, course, 'GA')


def pareto(settings: GaSettings, seed: int, size: int, starts: Floats) -> Search:
    """Return NSGA-II over fitness and a second objective, with pymoo's own operators."""
    first = first_generation(settings.population, size, seed, starts)
    algorithm = NSGA2(settings.population, sampling=first, seed=seed)
    generations = settings.generations

    def course(search: Search) -> Script:
        return (yield from search.evolve(algorithm, 2, generations, generations + 1))

    return Search(seed, first[0], settings.population * (generations + 1), course, 'NSGA-II')


def cma_es(settings: CmaSettings, seed: int, start: Floats, phase: str = CMA_ES) -> Search:
    """Return CMA-ES in the unit box, restarted from its best."""

    def course(search: Search) -> Script:
        _, reason = yield from search.descend(settings, start)
        return reason

    return Search(seed, start, settings.evaluations, course, phase)
