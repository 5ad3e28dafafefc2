# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a population is flown through, and the threads that fly it.

A candidate is flown alone by one thread; nothing is shared between candidates, so that results do
not depend on the number of threads. The kernels release the interpreter's lock.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rpo_core.fuzzy import DEFAULT_SAMPLES
from rpo_core.metrics import ARRIVAL_WINDOW_S, window_ticks
from rpo_core.scenario import Scenario, ScenarioSet
from rpo_core.validation import InputError
from rpo_training.engine import lanes
from rpo_training.engine import tick as batch
from rpo_training.search.genes import Ints, Population

Floats = NDArray[np.float64]

ENERGY, SPEED, SLEW, DISTANCE, LATE_POSITION, LATE_SPEED, LATE_FORCE, ARRIVAL = range(batch.FIGURES)
"""Columns of what `Simulator.fly` returns, see `rpo_training.batch.combine`."""


@dataclass(frozen=True)
class Loops:
    """The distinct planar and vertical loops of a set of starts; rows : (starts,) pair of each."""

    block: batch.Block
    rows: Ints


@dataclass(frozen=True)
class Case:
    """Starts that are flown together.

    starts : (n, 6) states
    disturbances : (k, horizon, 3) [N], or (k, 1, 3), the same all the time
    disturbance : (n,) which of them acts on each start
    late_s : extremes are taken over the last `late_s` of `horizon_s`
    """

    name: str
    base: Scenario
    starts: Floats
    disturbances: Floats
    disturbance: Ints
    horizon_s: float
    late_s: float

    @cached_property
    def times(self) -> batch.Times:
        """Windows in ticks."""
        longer = replace(self.base, duration_s=self.horizon_s)
        return batch.Times(
            self.base.ticks,
            window_ticks(self.base, ARRIVAL_WINDOW_S),
            longer.ticks,
            window_ticks(longer, self.late_s),
        )

    @cached_property
    def full(self) -> Loops:
        """Loops for any controller."""
        return _loops(self, odd=False)

    @cached_property
    def half(self) -> Loops:
        """Loops for an odd controller, whose flight from -start is the negative, bit for bit."""
        return _loops(self, odd=not self.disturbances.any())


def _loops(case: Case, *, odd: bool) -> Loops:
    """Return the loops of a case; with `odd`, starts that differ in sign share one."""

    def distinct(columns: list[int]) -> tuple[Floats, Ints, Ints]:
        starts = case.starts[:, columns]
        if odd:
            first = np.array([next((x for x in row if x != 0.0), 0.0) for row in starts])
            starts = np.where((first < 0.0)[:, None], -starts, starts) + 0.0
        keyed = np.column_stack([starts, case.disturbance])
        rows, which = np.unique(keyed, axis=0, return_inverse=True)
        return np.ascontiguousarray(rows[:, :-1]), rows[:, -1].astype(np.int64), which.ravel()

    planar, pushed, which_planar = distinct([0, 1, 3, 4])
    vertical, lifted, which_vertical = distinct([2, 5])
    axes = 2 * len(planar) + len(vertical)
    if axes > lanes.STRIDE:
        raise InputError(
            f'scenario {case.base.name} has {axes} axis loops; at most '
            f'{lanes.STRIDE} fit, as with eight positions per axis'
        )
    d = case.disturbances
    forces = np.hstack([d[pushed, :, 0].T, d[pushed, :, 1].T, d[lifted, :, 2].T])
    block = batch.Block(planar, vertical, np.ascontiguousarray(forces))
    return Loops(block, which_planar * len(vertical) + which_vertical)


def case_of_set(
    scenarios: ScenarioSet,
    *,
    mass_kg: float | None = None,
    horizon_s: float = 0.0,
    late_s: float = 100.0,
) -> Case:
    """Return the case of a scenario set, flown on to `horizon_s` if that is longer."""
    base = scenarios.base if mass_kg is None else replace(scenarios.base, mass_kg=mass_kg)
    velocity = base.initial_velocity_m_s
    starts = np.array([(*position, *velocity) for position in scenarios.initial_positions_m])
    horizon = max(horizon_s, base.duration_s)
    times = replace(base, duration_s=horizon).times_s[:-1]
    disturbances = base.disturbance.over(times[:1] if base.disturbance.is_zero else times)
    return Case(
        f'{scenarios.name}, {base.mass_kg:g} kg',
        base,
        starts,
        disturbances[None],
        np.zeros(len(starts), np.int64),
        horizon,
        late_s,
    )


def case_of_flights(scenarios: Sequence[Scenario], late_s: float) -> Case:
    """Return the case of flights that differ in start and disturbance only."""
    base = scenarios[0]
    kinds = list(dict.fromkeys(s.disturbance for s in scenarios))
    disturbances = np.array([kind.over(base.times_s[:-1]) for kind in kinds])
    return Case(
        ', '.join(dict.fromkeys(s.name for s in scenarios)),
        base,
        np.array([s.start for s in scenarios]),
        disturbances,
        np.array([kinds.index(s.disturbance) for s in scenarios]),
        base.duration_s,
        late_s,
    )


class Simulator:
    """Flies populations through cases, on `workers` threads (0: one per core).

    samples : of the output range, for every controller
    """

    def __init__(
        self, cases: Sequence[Case], workers: int = 0, samples: int = DEFAULT_SAMPLES
    ) -> None:
        self.cases, self.samples = tuple(cases), samples
        self.workers = workers or len(os.sched_getaffinity(0))
        self._local = threading.local()
        self._pool = ThreadPoolExecutor(self.workers, 'rpo-batch')

    def __enter__(self) -> Simulator:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)

    def fly(self, population: Population) -> list[Floats]:
        """Return the figures (members, starts, 8) of each case."""
        return self._fly(population, self._pool.map)

    def fly_here(self, population: Population) -> list[Floats]:
        """Return the same, flown by the thread that asks."""
        return self._fly(population, map)

    def _fly(self, population: Population, over: Callable[..., Iterable[None]]) -> list[Floats]:
        n = len(population.scales)
        outcomes = [np.empty((n, len(case.starts), batch.FIGURES)) for case in self.cases]
        odd = (population.rules[:, ::-1] == 4 - population.rules).all(axis=1)

        def one(index: int) -> None:
            for case, outcome in zip(self.cases, outcomes, strict=True):
                loops = case.half if odd[index] else case.full
                self._fly_one(population, index, case, loops, outcome[index])

        for _ in over(one, range(n)):
            pass
        return outcomes

    def _scratch(self, tail: int) -> tuple[lanes.Law, Floats, Floats, Floats]:
        local = self._local
        if not hasattr(local, 'law'):
            local.law = lanes.make_law(self.samples)
            local.rows, local.figures = (
                lanes.make_scratch(batch.ROWS),
                np.empty((lanes.STRIDE**2, batch.FIGURES)),
            )
            local.norms = np.empty((2, 0, lanes.STRIDE))
        if local.norms.shape[1] < tail:
            local.norms = np.empty((2, tail, lanes.STRIDE))
        return local.law, local.rows, local.norms, local.figures

    def _fly_one(
        self, population: Population, index: int, case: Case, loops: Loops, outcome: Floats
    ) -> None:
        law, rows, norms, figures = self._scratch(case.times.tail)
        lanes.set_law(
            law, population.scales[index], population.functions[index], population.rules[index]
        )
        base, block = case.base, loops.block
        p, q = len(block.planar), len(block.vertical)
        batch.assess(block, law, base.max_force_n, base.step, case.times, rows, norms)
        batch.combine(p, q, base.dt_s, case.times, rows, norms, figures)
        outcome[:] = figures[loops.rows]
