# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The metrics of `rpo_core.judge.metrics`, counted in lanes at each tick, combined at the end."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from rpo.engine.lanes import (
    BEFORE,
    EFFORT,
    ENERGY,
    FORCE,
    LATE_F,
    LATE_R,
    LATE_V,
    OUTSIDE,
    RUNS,
    SEEN_R,
    SLEW,
    STORED,
    STRIDE,
    SUM_R,
    SUM_V,
    R,
    V,
    compiled,
)
from rpo.engine.parts import goal
from rpo.engine.parts.control import Control
from rpo.engine.tick import COMMANDED, COUNTED, MOVED, Part, Runs, fly, table_of
from rpo_core.judge import metrics
from rpo_core.judge.metrics import AxisSums, Windows, fill_row, larger, last_outside, with_square
from rpo_core.kernels.arithmetic import norm
from rpo_core.kernels.arrays import Floats

COLUMNS = len(metrics.UNITS)
"""Columns of a row of metrics."""

PLANAR, VERTICAL, ARE_PAIRED, TICKS, TAIL, HORIZON, LATE, ARRIVAL_M, ROW_R, ROW_V, GOAL = range(11)
"""Places in the table: loops, and whether they are pairs; the fields of `Windows`; rows that
are judged; the goal [m] of each lane, or nothing."""


@compiled
def count_force(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Count row FORCE: the saturated, delayed command, before the errors of the thrusters."""
    n = 2 * int(t[PLANAR]) + int(t[VERTICAL])
    if tick < t[TICKS]:
        for s in range(n):
            force = w[FORCE + s]
            w[ENERGY + s] = with_square(w[ENERGY + s], force)
            w[EFFORT + s] += abs(force)
            w[SLEW + s] = larger(w[SLEW + s], force - w[BEFORE + s]) + STORED
            w[BEFORE + s] = force
    if tick >= t[HORIZON] - t[LATE]:
        for s in range(n):
            w[LATE_F + s] = larger(w[LATE_F + s], w[FORCE + s]) + STORED


@compiled
def count_state(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Count positions, less the goal, and velocities, after the step of a tick.

    Squared norms of the tail stay in the memory for `finish_crossed`; those of pairs are added up.
    """
    p, q, r, v = int(t[PLANAR]), int(t[VERTICAL]), int(t[ROW_R]), int(t[ROW_V])
    n = 2 * p + q
    if len(t) > GOAL:
        for s in range(n):
            w[SEEN_R + s] = w[r + s] - t[GOAL + s]
        r = SEEN_R
    if tick < t[TICKS]:
        arrival_m = t[ARRIVAL_M]
        for s in range(n):
            w[OUTSIDE + s] = last_outside(w[OUTSIDE + s], tick, w[r + s], arrival_m) + STORED
    if tick >= t[HORIZON] - t[LATE]:
        for s in range(n):
            w[LATE_R + s] = larger(w[LATE_R + s], w[r + s]) + STORED
            w[LATE_V + s] = larger(w[LATE_V + s], w[v + s]) + STORED
    row = tick - int(t[TICKS] - t[TAIL])
    if row < 0 or tick >= t[TICKS]:
        return
    if t[ARE_PAIRED] > 0.0:
        for s in range(RUNS):
            y, z = s + RUNS, s + 2 * RUNS
            w[SUM_R + s] += norm(w[r + s], w[r + y], w[r + z])
            w[SUM_V + s] += norm(w[v + s], w[v + y], w[v + z])
        return
    distances, speeds = m[STRIDE * row :], m[STRIDE * (int(t[TAIL]) + row) :]
    for i in range(p):
        distances[i] = w[r + i] * w[r + i] + w[r + p + i] * w[r + p + i]
        speeds[i] = w[v + i] * w[v + i] + w[v + p + i] * w[v + p + i]
    for i in range(q):
        s = 2 * p + i
        distances[p + i] = w[r + s] * w[r + s]
        speeds[p + i] = w[v + s] * w[v + s]


def counting(runs: Runs, windows: Windows, norms: Floats | None) -> Part:
    """Return the part that counts."""
    planar, vertical = len(runs.planar), len(runs.vertical)
    goals = [goal.position_of(part) for part in runs.parts if part.name == 'goal']
    table = table_of(planar, vertical, norms is None, windows, runs.judged_rows, *goals)
    memory = np.zeros(0) if norms is None else norms.reshape(-1)
    return Part('counters', ((COUNTED, count_force), (MOVED, count_state)), table, memory)


@compiled
def keep_trace(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Keep states and commands of all ticks."""
    n, ticks, r, v = int(t[0]), int(t[1]), int(t[2]), int(t[3])
    states, forces = m[2 * n * tick :], m[2 * n * (ticks + 1) + n * tick :]
    for s in range(n):
        states[2 * s] = w[r + s]
        states[2 * s + 1] = w[v + s]
        forces[s] = w[FORCE + s]


class Trace:
    """Room for the states (N + 1, lanes, 2), r and v, and commands (N + 1, lanes) of a flight.

    rows : of positions and velocities
    """

    def __init__(self, ticks: int, lanes: int, rows: tuple[int, int] = (R, V)) -> None:
        memory = np.empty(3 * (ticks + 1) * lanes)
        states, forces = np.split(memory, [2 * (ticks + 1) * lanes])
        self.states: Any = states.reshape(ticks + 1, lanes, 2)
        self.forces: Any = forces.reshape(ticks + 1, lanes)
        self.part = Part('trace', ((COMMANDED, keep_trace),), table_of(lanes, ticks, rows), memory)


def fly_lanes(
    control: Control,
    runs: Runs,
    windows: Windows,
    w: Floats,
    *,
    norms: Floats | None = None,
    trace: Trace | None = None,
) -> dict[str, Floats]:
    """Fly runs, and count what `finish_crossed` or `finish_paired` combine.

    norms : (2, tail, lanes) room for squared distances and speeds; None where loops are pairs
    """
    own = [control.part(runs), counting(runs, windows, norms)]
    own += [trace.part] if trace else []
    return fly(runs, own, windows.horizon, w)


@compiled
def _sums(w, s):  # type: ignore[no-untyped-def]
    energy, effort, step = w[ENERGY + s], w[EFFORT + s], w[SLEW + s]
    return AxisSums(
        energy, effort, step, w[LATE_R + s], w[LATE_V + s], w[LATE_F + s], w[OUTSIDE + s]
    )


@compiled
def _finish(w, x, y, z, tail, dt, mass, row):  # type: ignore[no-untyped-def]
    distances, speeds = w[SUM_R + x], w[SUM_V + x]
    fill_row(row, _sums(w, x), _sums(w, y), _sums(w, z), distances, speeds, tail, dt, mass)


@compiled
def _sum_norms(w, p, vertical, tail, norms):  # type: ignore[no-untyped-def]
    for i in range(p):
        w[SUM_R + i] = w[SUM_V + i] = 0.0
    for tick in range(tail):
        distance, speed = norms[0, tick, vertical], norms[1, tick, vertical]
        for i in range(p):
            w[SUM_R + i] += sqrt(norms[0, tick, i] + distance)
            w[SUM_V + i] += sqrt(norms[1, tick, i] + speed)


@compiled
def finish_crossed(p, q, dt, mass, tail, w, norms, rows):  # type: ignore[no-untyped-def]
    """Pair every planar with every vertical loop: rows of metrics (P * Q, columns), z fastest."""
    for j in range(q):
        z = 2 * p + j
        _sum_norms(w, p, p + j, tail, norms)
        for i in range(p):
            _finish(w, i, p + i, z, tail, dt, mass, rows[i * q + j])


@compiled
def finish_paired(dt, masses, tail, w, rows, final):  # type: ignore[no-untyped-def]
    """Fill rows of metrics (n, columns) and final states (n, 6) of the first n runs."""
    for s in range(len(rows)):
        y, z = s + RUNS, s + 2 * RUNS
        _finish(w, s, y, z, tail, dt, masses[s], rows[s])
        for axis in range(3):
            final[s, axis] = w[R + axis * RUNS + s]
            final[s, 3 + axis] = w[V + axis * RUNS + s]
