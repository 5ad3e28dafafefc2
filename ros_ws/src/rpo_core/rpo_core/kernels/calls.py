# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Calls of the kernels of stages, `step(tick, u, p, m, y)`, one tick or many.

    tick : int
    u : (n,) the numbers that the stage reads, one signal after the other
    p : record, its settings; no tick changes them
    m : record, its memory
    y : (k,) the numbers that it writes

A kernel returns nothing, or ASK: then the Python method `answer` of its stage is called, which
writes into p and m what the kernel needs, and the kernel once more.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rpo_core.kernels.jit import COMPILED, compiled
from rpo_core.kernels.records import address_of, class_of


def driver(function: Any) -> Any:
    """Compile a loop over calls; it makes no array, and lets other threads run."""
    return compiled(function, _nrt=False, nogil=True)


ASK = 1
"""A kernel returns it where its stage must plan."""

if COMPILED:
    from rpo_core.kernels import numba_records

    call: Any = numba_records.call

    @driver
    def call_once(step: Any, p: Any, m: Any, tick: int, u: Any, y: Any) -> int:
        """Call a kernel for a tick, from Python."""
        answer: int = call(step, tick, u, p, m, y, 0, len(y))
        return answer

else:

    def call_once(step: Any, p: Any, m: Any, tick: int, u: Any, y: Any) -> int:
        """Call a kernel for a tick."""
        return step(tick, u, p, m, y) or 0

    def call(step: Any, tick: int, u: Any, p: Any, m: Any, y: Any, first: int, size: int) -> int:
        """Call a kernel; its outputs are y[first : first + size]."""
        outputs = y[first : first + size]
        answer = step(tick, u, p, m, outputs)
        y[first : first + size] = outputs
        return answer or 0


def row_of(step: Any, p: Any, m: Any) -> tuple[Any, Any, Any]:
    """Return a kernel, its settings and its memory as `call` takes them."""
    if not COMPILED:
        return step, p, m
    return (
        numba_records.address(step, class_of(p), class_of(m)),
        address_of(p),
        address_of(m),
    )


def compile_together(stages: Iterable[tuple[Any, Any, Any]]) -> None:
    """Compile kernels that are not yet, with several processes.

    stages : kernel, settings and memory of each
    """
    if COMPILED:
        steps = ((step, class_of(p), class_of(m)) for step, p, m in stages)
        numba_records.compile_together(*steps)


@driver
def run(
    at: Any, last: int, rows: Any, reads: Any, signals: Any, u: Any, carried: Any, log: Any,
    before: Any, after: Any,
) -> int:  # fmt: skip
    """Fly ticks, from where a flight stands, and keep the signals of each; return 0 at the end.

    Else ASK: a kernel returned it, or a row has no kernel. An error of a kernel is raised; `at`
    says where it was.

    at : [tick, row], where the flight stands
    last : tick that is the last
    rows : of each stage: kernel, settings, memory; first and number of its places in `reads`; first
        place and number of what it writes in `signals`
    reads : places in `signals`
    carried : pairs of places: what the next tick reads of this one
    log : (ticks, numbers) those of `before`, then those of `after`
    before, after : places that are kept before and after the stages of a tick
    """
    first = len(before)
    while at[0] <= last:
        tick, kept = at[0], log[at[0]]
        if at[1] == 0:
            for i in range(first):
                kept[i] = signals[before[i]]
        while at[1] < len(rows):
            row = rows[at[1]]
            for i in range(row[4]):
                u[i] = signals[reads[row[3] + i]]
            if row[6] == 0:
                return ASK
            answer = call(row[0], tick, u, row[1], row[2], signals, row[5], row[6])
            if answer != 0:
                return answer
            at[1] += 1
        for pair in carried:
            signals[pair[1]] = signals[pair[0]]
        for i in range(len(after)):
            kept[first + i] = signals[after[i]]
        at[0], at[1] = tick + 1, 0
    return 0


@driver
def run_together(
    at: Any, last: int, begin: int, end: int, rows: Any, reads: Any, signals: Any, u: Any,
    carried: Any, log: Any, before: Any, after: Any,
) -> int:  # fmt: skip
    """Fly flights as `run` does one, but each row of all of them before the next row.

    at : [tick, row, flight], where they stand
    begin, end : the first flight, and that after the last one
    rows : (rows, flights); signals, u : an item for each flight; log : (ticks, flights, numbers)
    """
    first = len(before)
    while at[0] <= last:
        tick = at[0]
        if at[1] == 0:
            for s in range(begin, end):
                for i in range(first):
                    log[tick][s][i] = signals[s][before[i]]
        while at[1] < len(rows):
            row = rows[at[1]][begin]
            if row[6] == 0:
                for s in range(begin, end):
                    for i in range(row[4]):
                        u[s][i] = signals[s][reads[row[3] + i]]
                return ASK
            while at[2] < end:
                row, read, made = rows[at[1]][at[2]], u[at[2]], signals[at[2]]
                for i in range(row[4]):
                    read[i] = made[reads[row[3] + i]]
                answer = call(row[0], tick, read, row[1], row[2], made, row[5], row[6])
                if answer != 0:
                    return answer
                at[2] += 1
            at[1], at[2] = at[1] + 1, begin
        for s in range(begin, end):
            for pair in carried:
                signals[s][pair[1]] = signals[s][pair[0]]
            for i in range(len(after)):
                log[tick][s][first + i] = signals[s][after[i]]
        at[0], at[1] = tick + 1, 0
    return 0


@driver
def run_stage(step: Any, p: Any, m: Any, first: int, ticks: Any, inputs: Any, outputs: Any) -> int:
    """Call a kernel for ticks, from the first one on; return how many it answered.

    ticks : (n,); inputs, outputs : (n, numbers) of each
    """
    for i in range(first, len(ticks)):
        if call(step, ticks[i], inputs[i], p, m, outputs[i], 0, len(outputs[i])) != 0:
            return i
    return len(ticks)
