# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Threads that fly controllers through cases.

One thread flies a controller. Controllers share nothing, so that results do not depend on the
number of threads. The kernels release the interpreter's lock.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.flight import fly
from rpo_core.control.controller import Controller, FuzzyController
from rpo_core.control.fuzzy import DEFAULT_SAMPLES
from rpo_core.files.validation import InputError
from rpo_core.judge.metrics import row_of
from rpo_core.judge.verdicts import verdicts
from rpo_ctrl.baselines import Baseline
from rpo_montecarlo.engine import counters, lanes, parts, tick
from rpo_montecarlo.engine.cases import Case, Crossed
from rpo_montecarlo.engine.drawn import DrawnCase, with_own_memory
from rpo_montecarlo.engine.judged import VALUES, judge, make_trace
from rpo_montecarlo.engine.population import Population, population_of
from rpo_montecarlo.engine.support import announce, why_not
from rpo_montecarlo.engine.worlds import THRUST

Floats = NDArray[np.float64]
Candidates = Population | Sequence[Controller]


class Scratch(threading.local):
    """What a thread writes while it flies.

    w : rows of lanes; pairs : metrics of all pairs of loops
    norms : (2, tail, lanes) squared distances and speeds, see `tick.fly`
    """

    def __init__(self, tail: int) -> None:
        self.w = lanes.make_scratch(parts.ROWS)
        self.pairs = np.empty((lanes.STRIDE**2, counters.COLUMNS))
        self.norms = np.empty((2, tail, lanes.STRIDE))


class Simulator:
    """Flies controllers through cases.

    workers : threads; 0, one per core; 1, the calling thread
    samples : of the output range, for every member of a population
    """

    def __init__(
        self, cases: Sequence[Case | DrawnCase], workers: int = 0, samples: int = DEFAULT_SAMPLES
    ) -> None:
        self.samples = samples
        self.workers = workers or len(os.sched_getaffinity(0))
        self.take(cases)
        self._pool = ThreadPoolExecutor(self.workers, 'rpo-engine')

    def __enter__(self) -> Simulator:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)

    def take(self, cases: Sequence[Case | DrawnCase]) -> None:
        """Fly these cases from now on."""
        self.cases = tuple(cases)
        self._scratch = Scratch(max(case.windows.tail for case in cases))

    def fly(self, candidates: Candidates, some: slice = slice(None)) -> list[Floats]:
        """Return the metrics (candidates, starts, case.columns) of each case, or of some."""
        cases = self.cases[some]
        n = len(candidates.scales) if isinstance(candidates, Population) else len(candidates)
        found = [np.empty((n, len(case.starts), case.columns)) for case in cases]

        def one(index: int) -> None:
            for case, rows in zip(cases, found, strict=True):
                if isinstance(case, DrawnCase):
                    self._fly_paired(self._control(candidates, index), case, rows[index])
                elif isinstance(candidates, Population):
                    self._fly_fuzzy(candidates, index, self.samples, case, rows[index])
                else:
                    self._fly_controller(candidates[index], case, rows[index])

        list((map if self.workers == 1 else self._pool.map)(one, range(n)))
        return found

    def _fly_controller(self, controller: Controller, case: Case, rows: Floats) -> None:
        reason = why_not(case.base, controller)
        if reason:
            announce(reason)
            _fly_singly(controller, case, rows)
        elif isinstance(controller, FuzzyController):
            self._fly_fuzzy(population_of(controller), 0, controller.system.samples, case, rows)
        elif isinstance(controller, Baseline):
            self._fly_baseline(controller, case, rows)

    def _fly_fuzzy(
        self, population: Population, index: int, samples: int, case: Case, rows: Floats
    ) -> None:
        crossed = case.half if population.is_odd(index) else case.full
        control = parts.Control(population.law(index, samples))
        if crossed is None:
            self._fly_paired(control, case, rows)
        else:
            self._fly_crossed(control, case, crossed, rows)

    def _fly_baseline(self, baseline: Baseline, case: Case, rows: Floats) -> None:
        baseline.refuse_other_ticks(case.base.dt_s)
        crossed = case.half if baseline.alike else None
        if crossed is None:
            self._fly_paired(parts.Control(None, baseline.law), case, rows)
        else:
            self._fly_crossed(parts.Control(axes=baseline.law), case, crossed, rows)

    def _fly_crossed(
        self, control: parts.Control, case: Case, crossed: Crossed, rows: Floats
    ) -> None:
        w, norms, pairs = self._scratch.w, self._scratch.norms, self._scratch.pairs
        p, q = len(crossed.runs.planar), len(crossed.runs.vertical)
        judged = case.judged
        trace: Any = None if judged is None else make_trace(case.windows.horizon, 2 * p + q)
        tick.fly(crossed.runs, control, case.plant, case.windows, w, norms, trace)
        counters.finish_crossed(p, q, case.plant, case.base.mass_kg, case.windows, w, norms, pairs)
        rows[:, : counters.COLUMNS] = pairs[crossed.pairs]
        if judged is not None:
            rows[:, counters.COLUMNS :] = judge(trace[0], crossed.lanes, case.base, judged)

    def _fly_paired(self, control: parts.Control, case: Case | DrawnCase, rows: Floats) -> None:
        """Fly starts `RUNS` at a time: any number of them."""
        w, judged, columns = self._scratch.w, case.judged, counters.COLUMNS
        counted, final = np.empty((parts.RUNS, columns)), np.empty((parts.RUNS, 6))
        trace: Any = None
        if judged is not None:
            trace = make_trace(case.windows.horizon, parts.PAIRED_LANES)
        masses_kg = np.full(len(rows), case.base.mass_kg)
        batches: Iterable[parts.Runs]
        if isinstance(case, DrawnCase):
            masses_kg, batches = case.masses_kg, map(with_own_memory, case.batches)
        else:
            batches = case.paired()
        for first, runs in zip(range(0, len(rows), parts.RUNS), batches, strict=True):
            tick.fly(runs, control, case.plant, case.windows, w, None, trace)
            some = slice(first, first + parts.RUNS)
            n = len(rows[some])
            counters.finish_paired(
                case.plant, masses_kg[some], case.windows, w, counted[:n], final[:n]
            )
            rows[some, :columns] = counted[:n]
            if judged is not None:
                judged_to = columns + len(VALUES)
                rows[some, columns:judged_to] = judge(
                    trace[0], parts.paired_lanes(n), case.base, judged
                )
            if runs.valves is not None:
                rows[some, -len(THRUST) :] = runs.valves.memory[:n, THRUST]

    def _control(self, candidates: Candidates, index: int) -> parts.Control:
        if isinstance(candidates, Population):
            return parts.Control(candidates.law(index, self.samples))
        controller = candidates[index]
        if isinstance(controller, Baseline):
            return parts.Control(None, controller.law)
        if isinstance(controller, FuzzyController):
            law = population_of(controller).law(0, controller.system.samples)
            return parts.Control(law)
        raise InputError(f'the engine does not know controller {controller.name}')


def _fly_singly(controller: Controller, case: Case, rows: Floats) -> None:
    """Fly start after start through `rpo_core.chain.flight.fly`."""
    for row, scenario in zip(rows, case.scenarios(), strict=True):
        flight = fly(scenario, controller)
        row[: counters.COLUMNS] = row_of(flight, case.windows)
        if case.together:
            values = {verdict.key: verdict.value for verdict in verdicts(flight)}
            row[counters.COLUMNS :] = [values.get(name, 0.0) for name in VALUES]
