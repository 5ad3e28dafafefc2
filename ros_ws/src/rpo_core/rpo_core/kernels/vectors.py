# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Scalar kernels for eight flights at once, compiled by numba from the same source.

A kernel that gets a table of vectors (`lanes_at`, `wide`) in the place of one of floats is compiled
anew for it. Each of its numbers is then a SIMD vector, one number of each flight. + - * / sqrt abs
and comparisons act on each number alone, so the results are bit-identical to the scalar kernel.

A branch must go one way for all, and what becomes an integer must be the same one: otherwise the
kernel raises ArithmeticError, and its caller computes the flights one by one. Where flights often
differ, a kernel says `pick`.
"""

from __future__ import annotations

from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.kernels.jit import COMPILED, compiled

Floats = NDArray[np.float64]


def pick(test: bool, a: float, b: float) -> float:
    """Return a where a test holds, else b."""
    return a if test else b


def lanes_at(table: Any, place: int) -> Any:
    """Return a flat table from a place on in which a number is `WIDTH` that follow each other."""
    return table[place:]


def wide(table: Any) -> Any:
    """Return a flat table in which a place stands for the `WIDTH` numbers from it on."""
    return table


if COMPILED:
    from rpo_core.kernels import numba_vectors

    numba_vectors.teach(lanes_at, wide, pick)

WIDTH = numba_vectors.WIDTH if COMPILED else 1
"""Flights in a vector; interpreted kernels take one at a time."""

OWN = 7
"""Numbers with which a table begins whose runs have tables and memories of their own
(`own_tables`): the width, runs whose numbers alternate; numbers of a run's table and memory; places
of the first ones; the first number of a memory that only kernels' scratch needs, and the first one
after those."""


def aligned(values: Floats) -> Floats:
    """Return a copy (n,) that begins with a line of the cache: no vector then lies in two."""
    room = np.empty(len(values) + WIDTH)
    found = room[-(room.ctypes.data // room.itemsize) % WIDTH :][: len(values)]
    found[:] = values
    return found


def own_tables(
    width: int,
    head: Floats,
    tables: Floats,
    notes: Floats,
    memories: Floats,
    at: int,
    scratch: range,
) -> tuple[Floats, Floats]:
    """Return table and memory of a part whose runs have such of their own.

    width : `WIDTH`, where runs are computed together, or 1: run follows run
    head, notes : what the runs share; whole vectors of notes
    tables, memories : (numbers, runs)
    scratch : numbers of a memory, from place `at` on, that a tick writes before it reads them
    """

    def flat(rows: Floats) -> Floats:
        return rows.reshape(len(rows), -1, width).transpose(1, 0, 2).ravel()

    first = -(-(OWN + len(head)) // WIDTH) * WIDTH
    ends = at + scratch.start, at + scratch.stop
    sizes = (width, len(tables), len(memories), first, len(notes), *ends)
    fill = np.zeros(first - OWN - len(head))
    spare = np.zeros(len(tables) + (width + 1) * len(memories))
    table = np.concatenate([sizes, head, fill, flat(tables)])
    return aligned(table), np.concatenate([notes, flat(memories), spare])


_act: Any = None
_runs = 0


def _all_runs(w, m, t, tick):  # type: ignore[no-untyped-def]
    n, a, c, first = int(t[0]), int(t[1]), int(t[2]), int(t[4])
    spare = first + _runs * c
    table, memory = spare + n * c, spare + n * c + a
    for s in range(0, _runs, n):
        i, j = int(t[3]) + a * s, first + c * s
        if n == 1:
            _act(tick, w, m, s, t[i : i + a], m[j : j + c])
            continue
        for k in range(n * int(t[5])):
            m[spare + k] = m[j + k]
        for k in range(n * int(t[6]), n * c):
            m[spare + k] = m[j + k]
        together = True
        try:
            _act(tick, wide(w), wide(m), s, lanes_at(t, i), lanes_at(m, j))
        except Exception:
            together = False
        for lane in range(0 if together else n):
            for k in range(a):
                m[table + k] = t[i + n * k + lane]
            for k in range(c):
                m[memory + k] = m[spare + n * k + lane]
            _act(tick, w, m, s + lane, m[table : table + a], m[memory : memory + c])
            for k in range(c):
                m[j + n * k + lane] = m[memory + k]


def over_runs(act: Any, runs: int) -> Any:
    """Return the kernel (w, m, t, tick) that calls another one for all runs of such a part.

    act : (tick, scratch, memory, run, its table, its memory). Runs whose numbers alternate are
    computed together; those that differ in a branch, again one by one.
    """
    # As global names, not as a closure's: numba keeps no closure over a kernel for other processes.
    names = {**globals(), '_act': act, '_runs': runs}
    made = FunctionType(_all_runs.__code__, names, f'all_runs_{act.__name__}')
    made.__module__ = act.__module__
    return compiled(made, nogil=True)
