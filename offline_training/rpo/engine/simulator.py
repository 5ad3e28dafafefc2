# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Drawn runs in lanes, 40 at a time."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from rpo.engine import counters, lanes
from rpo.engine.cases import DrawnCase
from rpo.engine.counters import Trace, fly_lanes
from rpo.engine.judged import VALUES, judge
from rpo.engine.lanes import PAIRED_LANES, RUNS, paired_lanes
from rpo.engine.parts.control import Control
from rpo.engine.parts.pointing import turned_at_contact
from rpo.engine.parts.thrusters import spent_of
from rpo.engine.tick import Runs
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.requirements import ATTITUDES


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


def fly_pairs(control: Control, case: DrawnCase, w: Floats) -> Iterator[Pairs]:
    """Fly any number of starts, `RUNS` at a time."""
    trace = None
    for first, runs in zip(range(0, len(case.starts), RUNS), case.batches, strict=True):
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
    case: DrawnCase,
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
