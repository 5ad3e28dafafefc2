# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The metrics of `rpo_core.judge.metrics`, counted in lanes at each tick, combined at the end."""

from __future__ import annotations

from math import sqrt

from rpo_core.judge import metrics
from rpo_core.judge.metrics import AxisSums, fill_row, larger, last_outside, with_square
from rpo_core.kernels import norm
from rpo_montecarlo.engine.lanes import compiled
from rpo_montecarlo.engine.parts import (
    BEFORE,
    EFFORT,
    ENERGY,
    FORCE,
    GOAL,
    LATE_F,
    LATE_R,
    LATE_V,
    OUTSIDE,
    RUNS,
    SEEN_R,
    SLEW,
    SUM_R,
    SUM_V,
    R,
    V,
)

COLUMNS = len(metrics.UNITS)
"""Columns of a row of metrics."""


@compiled
def begin_forces(w, n, tick, thrusters):  # type: ignore[no-untyped-def]
    """Make the first effective command its own predecessor: the step from rest is not counted."""
    if tick == 0:
        for s in range(n):
            w[BEFORE + s] = w[FORCE + s]
    if thrusters is None:
        return
    if tick < len(thrusters.queue):
        for axis in range(3):
            for s in range(RUNS):
                lane = axis * RUNS + s
                late = tick <= thrusters.delays[s]
                w[BEFORE + lane] = w[FORCE + lane] if late else w[BEFORE + lane]


@compiled
def count_force(w, n, tick, windows):  # type: ignore[no-untyped-def]
    """Count row FORCE: the saturated, delayed command, before the errors of the thrusters."""
    if tick < windows.ticks:
        for s in range(n):
            force = w[FORCE + s]
            w[ENERGY + s] = with_square(w[ENERGY + s], force)
            w[EFFORT + s] += abs(force)
            w[SLEW + s] = larger(w[SLEW + s], force - w[BEFORE + s])
            w[BEFORE + s] = force
    if tick >= windows.horizon - windows.late:
        for s in range(n):
            w[LATE_F + s] = larger(w[LATE_F + s], w[FORCE + s])


@compiled
def count_state(w, n, tick, windows, goal):  # type: ignore[no-untyped-def]
    """Count rows R, less the goal, and V, after the step of a tick."""
    if goal is None:
        _count_state(w, n, tick, windows, R)
        return
    for s in range(n):
        w[SEEN_R + s] = w[R + s] - w[GOAL + s]
    _count_state(w, n, tick, windows, SEEN_R)


@compiled
def _count_state(w, n, tick, windows, r):  # type: ignore[no-untyped-def]
    if tick < windows.ticks:
        for s in range(n):
            w[OUTSIDE + s] = last_outside(w[OUTSIDE + s], tick, w[r + s], windows.arrival_m)
    if tick >= windows.horizon - windows.late:
        for s in range(n):
            w[LATE_R + s] = larger(w[LATE_R + s], w[r + s])
            w[LATE_V + s] = larger(w[LATE_V + s], w[V + s])


@compiled
def keep_norms(w, p, q, tick, windows, norms, goal):  # type: ignore[no-untyped-def]
    """Keep squared norms of the tail for `finish_crossed`, or add up those of paired runs.

    With a goal, `count_state` has left the positions less the goal in row SEEN_R.
    """
    if not windows.ticks - windows.tail <= tick < windows.ticks:
        return
    if goal is None:
        _keep_norms(w, p, q, tick, windows, norms, R)
    else:
        _keep_norms(w, p, q, tick, windows, norms, SEEN_R)


@compiled
def _keep_norms(w, p, q, tick, windows, norms, r):  # type: ignore[no-untyped-def]
    if norms is None:
        for s in range(RUNS):
            y, z = s + RUNS, s + 2 * RUNS
            w[SUM_R + s] += norm(w[r + s], w[r + y], w[r + z])
            w[SUM_V + s] += norm(w[V + s], w[V + y], w[V + z])
        return
    row = tick - (windows.ticks - windows.tail)
    for i in range(p):
        norms[0, row, i] = w[r + i] * w[r + i] + w[r + p + i] * w[r + p + i]
        norms[1, row, i] = w[V + i] * w[V + i] + w[V + p + i] * w[V + p + i]
    for i in range(q):
        s = 2 * p + i
        norms[0, row, p + i] = w[r + s] * w[r + s]
        norms[1, row, p + i] = w[V + s] * w[V + s]


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
def finish_crossed(p, q, plant, mass, windows, w, norms, rows):  # type: ignore[no-untyped-def]
    """Pair every planar with every vertical loop: rows of metrics (P * Q, columns), z fastest."""
    for j in range(q):
        z = 2 * p + j
        _sum_norms(w, p, p + j, windows.tail, norms)
        for i in range(p):
            _finish(w, i, p + i, z, windows.tail, plant.dt, mass, rows[i * q + j])


@compiled
def finish_paired(plant, masses, windows, w, rows, final):  # type: ignore[no-untyped-def]
    """Fill rows of metrics (n, columns) and final states (n, 6) of the first n runs."""
    for s in range(len(rows)):
        y, z = s + RUNS, s + 2 * RUNS
        _finish(w, s, y, z, windows.tail, plant.dt, masses[s], rows[s])
        for axis in range(3):
            final[s, axis] = w[R + axis * RUNS + s]
            final[s, 3 + axis] = w[V + axis * RUNS + s]
