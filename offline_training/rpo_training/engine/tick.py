# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The batch simulator: many axis loops side by side, the bits of `rpo_core.flight.fly`.

Under Clohessy-Wiltshire z is decoupled from x and y, and the controller acts axis by axis: a set
of starts needs its distinct planar (x, y) and vertical (z) loops only. The axes of all loops of one
controller lie side by side as lanes of a block (`rpo_training.lanes`); nothing is allocated while
flying.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

from rpo_core.kernels import cw_step, saturate
from rpo_core.metrics import MAX_ARRIVAL_DISTANCE_M
from rpo_training.engine.lanes import E_R, E_V, FIRST_FREE, OUTPUT, STRIDE, compiled, infer_lanes

# Rows of the scratch, after those of the inference.
R, V, FORCE, FLOWN, ENERGY, SLEW, LATE_R, LATE_V, LATE_F, OUTSIDE, SUM_R, SUM_V = (
    (FIRST_FREE + row) * STRIDE for row in range(12)
)
ROWS = FIRST_FREE + 12

FIGURES = 8
"""Columns of what `combine` fills."""


class Block(NamedTuple):
    """Loops that fly side by side.

    planar : (P, 4) starts x, y, vx, vy [m, m/s]; vertical : (Q, 2) starts z, vz
    disturbance : (ticks, 2 P + Q) [N], lanes x..., y..., z...; or (1, 2 P + Q), always the same
    """

    planar: Any
    vertical: Any
    disturbance: Any


@compiled
def command(w, lanes, law):  # type: ignore[no-untyped-def]
    """Row FORCE [N] of the lanes from rows R [m] and V [m/s].

    Lanes are filled up to a multiple of eight, whole SIMD registers; the rest idles at the origin.
    """
    n = (lanes + 7) // 8 * 8
    position_scale, velocity_scale, force_scale = law.scales[0], law.scales[1], law.scales[2]
    for s in range(n):
        w[E_R + s] = saturate(-w[R + s] / position_scale, 1.0)
        w[E_V + s] = saturate(-w[V + s] / velocity_scale, 1.0)
    infer_lanes(w, n, law)
    for s in range(n):
        w[FORCE + s] = force_scale * w[OUTPUT + s]


@compiled
def place(w, block):  # type: ignore[no-untyped-def]
    """Put the starts of a block into rows R and V."""
    w[:] = 0.0
    p, q = len(block.planar), len(block.vertical)
    for i in range(p):
        w[R + i], w[R + p + i], w[V + i], w[V + p + i] = block.planar[i]
    for i in range(q):
        w[R + 2 * p + i], w[V + 2 * p + i] = block.vertical[i]


@compiled
def step(w, block, tick, limit, c):  # type: ignore[no-untyped-def]
    """Fly rows FORCE and the disturbance of `tick` for one step of the plant."""
    p, q = len(block.planar), len(block.vertical)
    d = block.disturbance[tick if len(block.disturbance) > 1 else 0]
    for i in range(p):
        state = (w[R + i], w[R + p + i], 0.0, w[V + i], w[V + p + i], 0.0)
        total = (
            saturate(w[FORCE + i], limit) + d[i],
            saturate(w[FORCE + p + i], limit) + d[p + i],
            0.0,
        )
        w[R + i], w[R + p + i], _, w[V + i], w[V + p + i], _ = cw_step(state, total, c)
    for i in range(2 * p, 2 * p + q):
        state = (0.0, 0.0, w[R + i], 0.0, 0.0, w[V + i])
        total = (0.0, 0.0, saturate(w[FORCE + i], limit) + d[i])
        _, _, w[R + i], _, _, w[V + i] = cw_step(state, total, c)


@compiled
def record(block, law, limit, c, ticks, w, states, forces):  # type: ignore[no-untyped-def]
    """Fly a block; keep states (ticks + 1, lanes, 2), r and v, and forces (ticks + 1, lanes)."""
    n = 2 * len(block.planar) + len(block.vertical)
    place(w, block)
    for tick in range(ticks + 1):
        command(w, n, law)
        for s in range(n):
            states[tick, s, 0] = w[R + s]
            states[tick, s, 1] = w[V + s]
            forces[tick, s] = w[FORCE + s]
        if tick < ticks:
            step(w, block, tick, limit, c)


class Times(NamedTuple):
    """What is watched when, in ticks.

    ticks : flight that is judged; energy and slew count its forces
    tail : last states of it whose norms are averaged
    horizon : flight in all, >= ticks
    late : last ticks of the horizon whose extremes are kept
    """

    ticks: int
    tail: int
    horizon: int
    late: int


@compiled
def assess(block, law, limit, c, times, w, norms):  # type: ignore[no-untyped-def]
    """Fly a block; leave energy sums, slew steps and late extremes in rows, the tail in `norms`.

    norms : (2, tail, >= P + Q) squared distances and speeds, planar loops first
    """
    n = 2 * len(block.planar) + len(block.vertical)
    place(w, block)
    for tick in range(times.horizon):
        command(w, n, law)
        if tick < times.ticks:
            _count_force(w, n, limit, tick)
        if tick >= times.horizon - times.late:
            for s in range(n):
                size = abs(saturate(w[FORCE + s], limit))
                w[LATE_F + s] = size if size > w[LATE_F + s] else w[LATE_F + s]
        step(w, block, tick, limit, c)
        if tick < times.ticks:
            for s in range(n):
                if abs(w[R + s]) > MAX_ARRIVAL_DISTANCE_M:
                    w[OUTSIDE + s] = tick + 1.0
        if times.ticks - times.tail <= tick < times.ticks:
            _keep_norms(
                w,
                len(block.planar),
                len(block.vertical),
                norms[:, tick - (times.ticks - times.tail)],
            )
        if tick >= times.horizon - times.late:
            for s in range(n):
                size = abs(w[R + s])
                w[LATE_R + s] = size if size > w[LATE_R + s] else w[LATE_R + s]
                size = abs(w[V + s])
                w[LATE_V + s] = size if size > w[LATE_V + s] else w[LATE_V + s]


@compiled
def _count_force(w, n, limit, tick):  # type: ignore[no-untyped-def]
    for s in range(n):
        flown = saturate(w[FORCE + s], limit)
        w[ENERGY + s] += flown * flown
        if tick > 0:
            size = abs(flown - w[FLOWN + s])
            w[SLEW + s] = size if size > w[SLEW + s] else w[SLEW + s]
        w[FLOWN + s] = flown


@compiled
def _keep_norms(w, p, q, norms):  # type: ignore[no-untyped-def]
    for i in range(p):
        norms[0, i] = w[R + i] * w[R + i] + w[R + p + i] * w[R + p + i]
        norms[1, i] = w[V + i] * w[V + i] + w[V + p + i] * w[V + p + i]
    for i in range(q):
        s = 2 * p + i
        norms[0, p + i] = w[R + s] * w[R + s]
        norms[1, p + i] = w[V + s] * w[V + s]


@compiled
def combine(p, q, dt, times, w, norms, figures):  # type: ignore[no-untyped-def]
    """Pair every planar with every vertical loop: figures (P * Q, FIGURES), z fastest.

    Columns: energy [N^2 s], mean speed [m/s], slew [N/s], mean distance [m], as
    `rpo_core.metrics.Metrics` names them, summed over ticks per axis, then x + y + z; and, over the
    late window, the largest |position| of an axis [m], the norm of the axes' largest speeds [m/s]
    and the largest |force| of an axis [N]; last, the time [s] after which every axis stays within
    the arrival distance, as far as the judged flight goes.
    """
    for j in range(q):
        z = 2 * p + j
        _mean_norms(p, p + j, times.tail, w, norms)
        for i in range(p):
            y = p + i
            row = figures[i * q + j]
            row[0] = (w[ENERGY + i] + w[ENERGY + y] + w[ENERGY + z]) * dt
            row[1] = w[SUM_V + i] / times.tail
            row[2] = max(w[SLEW + i], w[SLEW + y], w[SLEW + z]) / dt
            row[3] = w[SUM_R + i] / times.tail
            row[4] = max(w[LATE_R + i], w[LATE_R + y], w[LATE_R + z])
            row[5] = sqrt(
                w[LATE_V + i] * w[LATE_V + i]
                + w[LATE_V + y] * w[LATE_V + y]
                + w[LATE_V + z] * w[LATE_V + z]
            )
            row[6] = max(w[LATE_F + i], w[LATE_F + y], w[LATE_F + z])
            row[7] = max(w[OUTSIDE + i], w[OUTSIDE + y], w[OUTSIDE + z]) * dt


@compiled
def _mean_norms(p, vertical, tail, w, norms):  # type: ignore[no-untyped-def]
    for i in range(p):
        w[SUM_R + i] = w[SUM_V + i] = 0.0
    for tick in range(tail):
        distance, speed = norms[0, tick, vertical], norms[1, tick, vertical]
        for i in range(p):
            w[SUM_R + i] += sqrt(norms[0, tick, i] + distance)
            w[SUM_V + i] += sqrt(norms[1, tick, i] + speed)
