# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Targets that turn, side by side: rows BODY have each state as the target sees it."""

from __future__ import annotations

from collections.abc import Sequence

from rpo.engine.lanes import BODY_QUAT, BODY_QUAT_W, BODY_R, BODY_RATE, BODY_V, RUNS, R, V, compiled
from rpo.engine.parts.attitude import put_attitude
from rpo.engine.tick import MOVED, Batch, Kind, Part, register, table_of
from rpo_core.attitude.attitude_kernels import (
    FRAME,
    attitude_at,
    attitude_step,
    body_at,
    frame_of,
    seen_from,
)
from rpo_core.attitude.target import Target, motion_of
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import inlined

FIRST = 1
"""Place in a tick of what is done once, before the first state is read."""

TURNS, DT, BODIES = range(3)
"""Places in a table of targets: whether they turn, the tick [s]; the rest of `Body` of each run,
its numbers one after the other (13, 40)."""

BODY = BODIES + 13 * RUNS
ATTITUDE = 7 * RUNS
"""Numbers of a table of targets, and of their attitudes in a memory (7, 40)."""


@inlined
def body_of(t, turns, s):  # type: ignore[no-untyped-def]
    """Return the body of a run, of a table of targets."""
    return body_at(turns, t, BODIES + s, RUNS)


@compiled
def _see(w, m, t, turns):  # type: ignore[no-untyped-def]
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        attitude = attitude_at(m, s, RUNS)
        f = frame_of(attitude, body_of(t, turns, s))
        state = (w[R + s], w[R + y], w[R + z], w[V + s], w[V + y], w[V + z])
        rx, ry, rz, vx, vy, vz = seen_from(state, f)
        w[BODY_R + s], w[BODY_R + y], w[BODY_R + z] = rx, ry, rz
        w[BODY_V + s], w[BODY_V + y], w[BODY_V + z] = vx, vy, vz
        put_attitude(w, BODY_QUAT, BODY_QUAT_W, BODY_RATE, s, attitude)


@compiled
def step_attitudes(m, t, later):  # type: ignore[no-untyped-def]
    """Turn the targets of a table, whose attitudes (7, 40) are in a memory, by a time [s].

    In place: into another array, which may be the same one, it would not become SIMD.
    """
    for s in range(RUNS if t[TURNS] > 0.0 else 0):
        found = attitude_step(attitude_at(m, s, RUNS), later, body_of(t, 1.0, s))
        for j in range(7):
            m[j * RUNS + s] = found[j]


@inlined
def _fill_axes(m, t, turns, axes):  # type: ignore[no-untyped-def]
    for s in range(RUNS):
        f = frame_of(attitude_at(m, s, RUNS), body_of(t, turns, s))
        for j in range(FRAME):
            axes[j * RUNS + s] = f[j]


@compiled
def fill_axes(m, t, axes):  # type: ignore[no-untyped-def]
    """Fill the axes (15, 40) of the targets of a table with these attitudes."""
    if t[TURNS] > 0.0:
        _fill_axes(m, t, 1.0, axes)
    else:
        _fill_axes(m, t, 0.0, axes)


@compiled
def begin(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill rows BODY with the states at the start."""
    if tick == 0:
        _see(w, m, t, t[TURNS])


@compiled
def turn(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Turn the targets by a tick; fill rows BODY with the states of the next tick."""
    step_attitudes(m, t, t[DT])
    if t[TURNS] > 0.0:
        _see(w, m, t, 1.0)
    else:
        _see(w, m, t, 0.0)


def targets_of(
    batch: Batch, targets: Sequence[Target], ticks: Sequence[int]
) -> tuple[Floats, Floats]:
    """Return table and memory of targets, a run each, whose attitudes are of these ticks."""
    bodies, starts = [], []
    for scenario, target, tick in zip(batch.scenarios, targets, ticks, strict=True):
        n = scenario.mean_motion_rad_s
        bodies.append(target.body(n)[1:])
        starts.append(motion_of(target, scenario).attitude(tick) if tick else target.start(n))
    turns = targets[0].body(0.0).turns
    table = table_of(turns, batch.base.dt_s, batch.lanes(bodies))
    return table, table_of(batch.lanes(starts))


def _part(batch: Batch) -> Part | None:
    if batch.base.target is None:
        return None
    targets = [scenario.target for scenario in batch.scenarios]
    table, attitudes = targets_of(batch, targets, [0] * len(targets))
    return Part('target', ((FIRST, begin), (MOVED, turn)), table, attitudes)


register(Kind('target', _part))
