# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Threads that fly the candidates of a search through cases; candidates share nothing."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from rpo.engine.cases import Case, Group
from rpo.engine.lanes import STRIDE, make_scratch
from rpo.engine.laws import COUPLED, Candidate, baseline_candidate, fuzzy_candidate
from rpo.engine.loops import Room, finish, fly, judge
from rpo.engine.population import Population
from rpo_core.chain.flight import fly as fly_chain
from rpo_core.control.baselines import Baseline
from rpo_core.control.controller import Controller
from rpo_core.control.fuzzy import DEFAULT_SAMPLES
from rpo_core.judge.metrics import asked_of, counts_of
from rpo_core.kernels.arrays import Floats

Candidates = Population | Sequence[Controller]


class _Rooms(threading.local):
    """What each thread writes while it flies, large enough for any of some cases."""

    def __init__(self, cases: Sequence[Case]) -> None:
        tail = max(case.windows.tail for case in cases)
        ticks = max((case.windows.horizon + 1 for case in cases if case.together), default=0)
        self._w, self._norms = make_scratch(), np.empty((2, tail, STRIDE))
        self._states = np.empty((ticks, STRIDE, 2))

    def of(self, case: Case) -> Room:
        """Return the room of a case: without states where they are not kept."""
        ticks = case.windows.horizon + 1 if case.together else 0
        return Room(self._w, self._norms, self._states[:ticks])


class Simulator:
    """Flies candidates through cases.

    workers : threads; 0, one per core; 1, the calling thread
    samples : of the output range, for every member of a population
    """

    def __init__(
        self, cases: Sequence[Case], workers: int = 0, samples: int = DEFAULT_SAMPLES
    ) -> None:
        self.cases, self.samples, self._rooms = tuple(cases), samples, _Rooms(cases)
        self.workers = workers or len(os.sched_getaffinity(0))
        self._pool = ThreadPoolExecutor(self.workers, 'rpo-search')

    def __enter__(self) -> Simulator:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)

    def each(self, function: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[Any]:
        """Map on the threads."""
        return (map if self.workers == 1 else self._pool.map)(function, items)

    def fly(self, candidates: Candidates) -> list[Floats]:
        """Return the rows (candidates, starts, case.columns) of each case; see `VALUES`."""
        n = len(candidates.scales) if isinstance(candidates, Population) else len(candidates)
        rows = [np.empty((n, len(case.starts), case.columns)) for case in self.cases]

        def one(index: int) -> None:
            for case, of_case in zip(self.cases, rows, strict=True):
                if isinstance(candidates, Population):
                    groups = case.halved if candidates.is_odd(index) else case.crossed
                    law = fuzzy_candidate(candidates.law(index, self.samples))
                    self._fly(law, groups, case, of_case[index])
                else:
                    self._fly_controller(candidates[index], case, of_case[index])

        list(self.each(one, range(n)))
        return rows

    def _fly_controller(self, controller: Any, case: Case, rows: Floats) -> None:
        """Fly a baseline in lanes; one with a stage of its own, and others, through the chain."""
        known = isinstance(controller, Baseline) and type(controller).stage is Baseline.stage
        if not known or case.base.sections:
            for row, scenario in zip(rows, case.scenarios(), strict=True):
                row[:] = counts_of(fly_chain(scenario, controller), case.windows)[: case.columns]
            return
        controller.refuse_other_ticks(case.base.dt_s)
        candidate = baseline_candidate(controller)
        groups = case.paired if candidate.form == COUPLED else case.halved
        self._fly(candidate, groups, case, rows)

    def _fly(self, candidate: Candidate, groups: Sequence[Group], case: Case, rows: Floats) -> None:
        room, base, windows = self._rooms.of(case), case.base, case.windows
        for some, loops, lanes, which in groups:
            distinct = np.full((lanes.shape[1], case.columns), np.nan)
            fly(candidate, loops, windows, room)
            finish(room, lanes, windows.tail, base.dt_s, base.mass_kg, distinct)
            if case.together:
                judge(room.states, lanes, base.goal_state, asked_of(base), distinct)
            rows[some] = distinct[which]
