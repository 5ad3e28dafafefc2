# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flights side by side, tick by tick: somebody outside the engine commands the force."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

from rpo.engine.calls import call, rows_of
from rpo.engine.cases import DrawnCase
from rpo.engine.counters import Trace, counting
from rpo.engine.lanes import FORCE, PAIRED_LANES, ROWS, RUNS, STRIDE, compiled
from rpo.engine.simulator import Pairs, flown
from rpo.engine.tick import PASSED, Part, fresh, place, steps_of
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import COMPILED
from rpo_core.stage import Place


@compiled
def _pass(rows, tick, w):  # type: ignore[no-untyped-def]
    """Let the kernels of each batch act, one after the other."""
    for b in range(len(w)):
        for i in range(len(rows[b])):
            call(rows[b][i], w[b], tick)


class Stepping:
    """The flights of a case.

    Of each tick, `sense` passes what comes before the controller, `pass_tick` what comes after it.
    """

    def __init__(self, case: DrawnCase) -> None:
        self.case = case
        self.w = np.zeros((len(case.batches), ROWS * STRIDE))
        self._traces: list[Trace | None] = []
        self._parts: list[list[Part]] = []
        for w, runs in zip(self.w, case.batches, strict=True):
            place(w, runs)
            rows = runs.judged_rows
            trace = Trace(case.windows.horizon, PAIRED_LANES, rows) if case.judged else None
            own = fresh(runs.parts)
            own += [counting(runs, case.windows, None), *([trace.part] if trace else [])]
            self._parts.append(own)
            self._traces.append(trace)
        self._before = self._rows(0, Place.CONTROLLER)
        self._after = self._rows(Place.CONTROLLER, sys.maxsize)
        self._ending = self._rows(Place.CONTROLLER, PASSED + 1)

    def _rows(self, first: int, end: int) -> Any:
        """Return the kernels of each batch at some places of a tick."""
        batches = [
            rows_of([step for place, step in steps_of(parts) if first <= place < end])
            for parts in self._parts
        ]
        return np.array(batches).reshape(len(batches), -1, 5) if COMPILED else batches

    def sense(self, tick: int) -> None:
        """Let sensors, navigation and guidance act."""
        _pass(self._before, tick, self.w)

    def pass_tick(self, tick: int, forces_n: Floats) -> None:
        """Let commands (n, 3) [N] act, and what comes after a controller."""
        self._command(forces_n)
        _pass(self._after, tick, self.w)

    def end(self, tick: int) -> None:
        """Pass what the last tick of a flight has: a command, which moves nothing any more."""
        self._command(np.zeros((0, 3)))
        _pass(self._ending, tick, self.w)

    def _command(self, forces_n: Floats) -> None:
        padded = np.zeros((len(self.w) * RUNS, 3))
        padded[: len(forces_n)] = forces_n
        self.of(FORCE)[...] = padded.reshape(len(self.w), RUNS, 3).transpose(0, 2, 1)

    def of(self, row: int) -> Any:
        """Return a row of the scratch (batches, 3, 40) as a view."""
        return self.w[:, row : row + PAIRED_LANES].reshape(len(self.w), 3, RUNS)

    def vectors(self, row: int) -> Floats:
        """Return a row of the scratch as vectors (n, 3)."""
        found = self.of(row).transpose(0, 2, 1).reshape(-1, 3)[: len(self.case.starts)]
        return np.asarray(found)

    def landed(self) -> Iterator[tuple[Pairs, Floats]]:
        """Yield the flights after their last tick, with their scratch."""
        for i, (runs, parts, w) in enumerate(
            zip(self.case.batches, self._parts, self.w, strict=True)
        ):
            memories = {part.name: part.memory for part in parts}
            yield flown(self.case, i * RUNS, runs, memories, w, self._traces[i]), w
