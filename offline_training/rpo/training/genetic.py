# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's genetic algorithm on pymoo, with the operators that are missing in pymoo.

The paper names the options of MATLAB's `ga`. This module has their meaning, with two readings:

- an adaptive feasible mutation has no "mutation probability 0.2": it is read as the share of the
  children that mutation makes (11 of 57); crossover makes the others, with probability 0.85, else
  copies a pair of parents;
- genes are normalised to [0, 1], so that one step size suits feet, scales and rules alike.

Random numbers of generation g come from PCG64 seeded with (seed, g).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np
from pymoo.algorithms.base.genetic import GeneticAlgorithm
from pymoo.core.mutation import Mutation
from pymoo.core.population import Population
from pymoo.core.survival import Survival
from pymoo.operators.crossover.pntx import TwoPointCrossover
from pymoo.operators.selection.tournament import TournamentSelection

from rpo_core.files.validation import Checked, InputError, real, whole
from rpo_core.kernels.arrays import Floats


def generator(seed: int, *stream: int) -> np.random.Generator:
    """Return the PCG64 generator of a stream, such as a generation, of a run."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=stream)))


@dataclass(frozen=True)
class GaSettings(Checked):
    """Options of the genetic algorithm; the defaults are the paper's.

    stall : generations without a better controller after which the search stops
    mutation : share of the children that mutation makes
    mutation_scale : first step of a mutation, as a share of a gene's range
    mutation_floor : smallest factor of the step; MATLAB's is 1.5e-8, at which rules, which are
        rounded, no longer change
    """

    PLACE = 'ga.'

    population: Annotated[int, partial(whole, least=4, most=100_000)] = 60
    generations: Annotated[int, partial(whole, least=1, most=1_000_000)] = 300
    stall: Annotated[int, partial(whole, least=1)] = 100
    tournament: int = 4
    crossover: Annotated[float, partial(real, least=0.0, most=1.0)] = 0.85
    mutation: Annotated[float, partial(real, least=0.0, most=1.0)] = 0.2
    elites: Annotated[int, partial(whole, least=0)] = 3
    mutation_scale: Annotated[float, partial(real, above=0.0, most=1.0)] = 0.25
    mutation_floor: Annotated[float, partial(real, above=0.0, most=1.0)] = 1.0 / 64.0

    def __post_init__(self) -> None:
        super().__post_init__()
        whole('ga.tournament', self.tournament, least=1, most=self.population)
        if self.elites > self.population - 2:
            raise InputError(
                f'`ga.elites` must leave room for two children in a population of '
                f'{self.population}; got {self.elites}'
            )

    @property
    def children(self) -> int:
        """Members of a generation that are not elites."""
        return self.population - self.elites

    @property
    def mutants(self) -> int:
        """Children made by mutation."""
        return round(self.mutation * self.children)


class AdaptiveFeasibleMutation(Mutation):  # type: ignore[misc]
    """A step along a random basis that stays within the bounds; the step adapts to success.

    For each parent the 2n directions +-d of a random lower triangular basis (unit diagonal, rows
    and columns permuted; Audet and Dennis 2006) are tried in random order, and the first feasible
    x + step * scale * d is taken; if there is none the parent is returned. The step is 1 for two
    generations, then four times larger (at most 1) after a generation that found a better best,
    four times smaller after one that did not.
    """

    def __init__(self, scale: float, floor: float) -> None:
        super().__init__(prob=1.0)
        self.scale, self.floor, self.step = scale, floor, 1.0

    def adapt(self, generation: int, improved: bool) -> None:
        """Set the step for the children of a generation (2 is the first that has any)."""
        if generation > 2:
            self.step = min(1.0, 4.0 * self.step) if improved else max(self.floor, self.step / 4.0)

    def _do(self, problem: Any, X: Floats, *_: Any, random_state: Any = None, **__: Any) -> Floats:
        return np.array([self._mutate(x, problem.xl, problem.xu, random_state) for x in X])

    def _mutate(self, x: Floats, low: Floats, high: Floats, rng: np.random.Generator) -> Floats:
        directions = self._basis(len(x), rng)
        trials = x + self.step * self.scale * (high - low) * directions
        feasible = ((trials >= low) & (trials <= high)).all(axis=1)
        return trials[int(feasible.argmax())] if feasible.any() else x

    def _basis(self, n: int, rng: np.random.Generator) -> Floats:
        """Return the directions (2n, n), of largest component 1, in random order."""
        spread = 1.0 - np.sqrt(self.step)  # axis-parallel at step 1, as on a coarse mesh
        basis = np.tril(rng.uniform(-spread, spread, (n, n)), -1)
        basis[np.arange(n), np.arange(n)] = rng.choice([-1.0, 1.0], n)
        basis = basis[rng.permutation(n)][:, rng.permutation(n)].T
        return rng.permutation(np.concatenate([basis, -basis]))


def _fittest(pop: Any, contests: Any, **_: Any) -> Any:
    """Return the winner of each tournament (contests, players)."""
    fitness = pop.get('F')[:, 0]
    return contests[np.arange(len(contests)), fitness[contests].argmin(axis=1)]


class _Generations(Survival):  # type: ignore[misc]
    """The next generation: the elites of the last one and all its children."""

    def __init__(self, elites: int) -> None:
        super().__init__(filter_infeasible=False)
        self.elites = elites

    def _do(self, problem: Any, pop: Any, *_: Any, n_survive: int, **__: Any) -> Any:
        parents = pop[:n_survive]
        best = np.argsort(parents.get('F')[:, 0], kind='stable')[: self.elites]
        return Population.merge(parents[best], pop[n_survive:])


def first_generation(count: int, size: int, seed: int, starts: Floats) -> Floats:
    """Return chromosomes (count, size): the given starts (k, size), the others at random."""
    genes = generator(seed, 0).random((count, size))
    kept = starts[:count]
    genes[: len(kept)] = kept
    return genes


class PaperGa(GeneticAlgorithm):  # type: ignore[misc]
    """Generational GA with elites; a child is made by crossover or by mutation, not both."""

    def __init__(self, settings: GaSettings, seed: int, first: Floats) -> None:
        self.settings = settings
        self.mutate = AdaptiveFeasibleMutation(settings.mutation_scale, settings.mutation_floor)
        self.select = TournamentSelection(_fittest, pressure=settings.tournament)
        self.cross = TwoPointCrossover(prob=settings.crossover)
        self._bests: list[float] = []
        super().__init__(
            pop_size=settings.population,
            n_offsprings=settings.children,
            sampling=first,
            survival=_Generations(settings.elites),
            eliminate_duplicates=False,
            mating=self._children,
            seed=seed,
        )

    def _infill(self) -> Any:
        best = float(self.pop.get('F').min())
        improved = bool(self._bests) and best < self._bests[-1]
        self._bests.append(best)
        self.mutate.adapt(self.n_iter, improved)
        self.random_state = generator(self.seed, self.n_iter)
        return self._children()

    def _children(self) -> Any:
        rng, settings = self.random_state, self.settings
        pairs = -(-(settings.children - settings.mutants) // 2)
        parents = self.select(self.problem, self.pop, pairs, n_parents=2, random_state=rng)
        crossed = self.cross(self.problem, parents, random_state=rng)
        crossed = crossed[: settings.children - settings.mutants]
        parents = self.select(self.problem, self.pop, settings.mutants, 1, random_state=rng)
        mutants = Population.new('X', np.array([[p.X for p in row] for row in parents])[:, 0])
        mutants = self.mutate(self.problem, mutants, random_state=rng)
        return Population.merge(crossed, mutants)
