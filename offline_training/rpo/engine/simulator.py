# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Threads that fly controllers through cases.

One thread flies a controller. Controllers share nothing, so that results do not depend on the
number of threads. The kernels release the interpreter's lock.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from rpo.engine import counters, lanes
from rpo.engine.cases import Case, DrawnCase
from rpo.engine.counters import Trace, fly_lanes
from rpo.engine.judged import VALUES, judge
from rpo.engine.lanes import PAIRED_LANES, RUNS, paired_lanes
from rpo.engine.parts.control import Control, control_of, fuzzy_control
from rpo.engine.parts.pointing import turned_at_contact
from rpo.engine.parts.thrusters import spent_of
from rpo.engine.population import Population
from rpo.engine.support import announce, why_not
from rpo.engine.tick import Runs
from rpo_core.chain.flight import fly
from rpo_core.control.baselines import Baseline
from rpo_core.control.controller import Controller, FuzzyController
from rpo_core.control.fuzzy import DEFAULT_SAMPLES
from rpo_core.judge.metrics import row_of
from rpo_core.judge.verdicts import verdicts
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.requirements import ATTITUDES

Candidates = Population | Sequence[Controller]


class Scratch(threading.local):
    """What a thread writes while it flies.

    w : rows of lanes; pairs : metrics of all pairs of loops
    """

    def __init__(self, tail: int) -> None:
        self.w = lanes.make_scratch()
        self.pairs = np.empty((lanes.STRIDE**2, counters.COLUMNS))
        self._norms = np.empty(2 * tail * lanes.STRIDE)

    def norms(self, tail: int) -> Floats:
        """Return room (2, tail, lanes) for squared distances and speeds of a case."""
        return self._norms[: 2 * tail * lanes.STRIDE].reshape(2, tail, lanes.STRIDE)


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
        self.cases = tuple(cases)
        self._scratch = Scratch(max(case.windows.tail for case in cases))
        self._pool = ThreadPoolExecutor(self.workers, 'rpo-engine')

    def __enter__(self) -> Simulator:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)

    def fly(self, candidates: Candidates) -> list[Floats]:
        """Return the metrics (candidates, starts, case.columns) of each case."""
        cases = self.cases
        n = len(candidates.scales) if isinstance(candidates, Population) else len(candidates)
        found = [np.empty((n, len(case.starts), case.columns)) for case in cases]

        def one(index: int) -> None:
            for case, rows in zip(cases, found, strict=True):
                if isinstance(candidates, Population):
                    control = fuzzy_control(candidates.law(index, self.samples))
                    self._fly(control, candidates.is_odd(index), case, rows[index])
                else:
                    self._fly_controller(candidates[index], case, rows[index])

        list(self.each(one, range(n)))
        return found

    def each(self, function: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
        """Map on the threads."""
        return (map if self.workers == 1 else self._pool.map)(function, items)

    def _fly_controller(self, controller: Controller, case: Case | DrawnCase, rows: Floats) -> None:
        if isinstance(case, Case):
            if reason := why_not(case.base, controller, ()):
                announce(reason)
                _fly_singly(controller, case, rows)
                return
            if isinstance(controller, Baseline):
                controller.refuse_other_ticks(case.base.dt_s)
        odd = getattr(controller, 'alike', False) or None
        if isinstance(controller, FuzzyController):
            odd = controller.system.rules.is_odd
        self._fly(control_of(controller), odd, case, rows)

    def _fly(
        self, control: Control, odd: bool | None, case: Case | DrawnCase, rows: Floats
    ) -> None:
        """Fill rows; odd : whether a law that acts axis by axis is odd; None: it does not."""
        w, base, judged = self._scratch.w, case.base, case.judged
        crossed = None
        if isinstance(case, Case) and odd is not None:
            crossed = case.half if odd else case.full
        if crossed is None:
            for found in fly_pairs(control, case, w):
                rows[found.some] = found.rows
            return
        runs, windows, pairs = crossed.runs, case.windows, self._scratch.pairs
        norms = self._scratch.norms(windows.tail)
        trace = Trace(windows.horizon, runs.lanes) if judged else None
        fly_lanes(control, runs, windows, w, norms=norms, trace=trace)
        p, q = len(runs.planar), len(runs.vertical)
        counters.finish_crossed(p, q, base.dt_s, base.mass_kg, windows.tail, w, norms, pairs)
        rows[:, : counters.COLUMNS] = pairs[crossed.pairs]
        if judged and trace:
            rows[:, counters.COLUMNS :] = judge(trace.states, crossed.lanes, base, judged)


class Pairs(NamedTuple):
    """Up to 40 paired runs that have flown.

    some : their places in the case; rows : (n, case.columns); final : (n, 6) states at the end
    memories : of their parts
    """

    some: slice
    rows: Floats
    final: Floats
    runs: Runs
    memories: dict[str, Floats]


def fly_pairs(control: Control, case: Case | DrawnCase, w: Floats) -> Iterator[Pairs]:
    """Fly any number of starts, `RUNS` at a time."""
    batches = case.batches if isinstance(case, DrawnCase) else case.paired()
    trace = None
    for first, runs in zip(range(0, len(case.starts), RUNS), batches, strict=True):
        if case.judged and trace is None:
            trace = _trace(case.windows.horizon, runs.judged_rows)
        memories = fly_lanes(control, runs, case.windows, w, trace=trace)
        yield flown(case, first, runs, memories, w, trace)


_kept = threading.local()


def _trace(ticks: int, rows: tuple[int, int]) -> Trace:
    """Return room for paired flights, the same one as before in a thread: it is large."""
    if getattr(_kept, 'of', None) != (ticks, rows):
        _kept.of, _kept.trace = (ticks, rows), Trace(ticks, PAIRED_LANES, rows)
    found: Trace = _kept.trace
    return found


def flown(
    case: Case | DrawnCase,
    first: int,
    runs: Runs,
    memories: dict[str, Floats],
    w: Floats,
    trace: Trace | None,
) -> Pairs:
    """Return up to 40 runs that have flown, from the first of them in the case."""
    n, counted, judged = min(RUNS, len(case.starts) - first), counters.COLUMNS, case.judged
    some, rows = slice(first, first + n), np.empty((n, case.columns))
    final, metrics = np.empty((n, 6)), np.empty((n, counted))
    masses_kg, tail = case.masses_kg[some], case.windows.tail
    counters.finish_paired(case.base.dt_s, masses_kg, tail, w, metrics, final)
    rows[:, :counted] = metrics
    if judged and trace:
        counted += len(VALUES)
        rows[:, counters.COLUMNS : counted] = judge(
            trace.states, paired_lanes(n), case.base, judged
        )
        if 'contact' in memories:
            rows[:, counted - len(ATTITUDES) : counted] = turned_at_contact(memories, n)
    for at, values in enumerate(spent_of(memories).values(), counted):
        rows[:, at] = values[:n]
    return Pairs(some, rows, final, runs, memories)


def _fly_singly(controller: Controller, case: Case, rows: Floats) -> None:
    """Fly start after start through `rpo_core.chain.flight.fly`."""
    for row, scenario in zip(rows, case.scenarios(), strict=True):
        flight = fly(scenario, controller)
        row[: counters.COLUMNS] = row_of(flight, case.windows)
        if case.together:
            values = {verdict.key: verdict.value for verdict in verdicts(flight)}
            row[counters.COLUMNS :] = [values.get(name, 0.0) for name in VALUES]
