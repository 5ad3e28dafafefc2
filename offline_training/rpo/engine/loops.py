# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The tick of the search: loops of axes side by side under Clohessy-Wiltshire, and what is counted.

A flight's metrics are those of `rpo_core.judge`: counted axis by axis at each tick, combined for
each flight at the end. What is required of the axes together is counted from the states, which are
kept only where a scenario requires such.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo.engine.lanes import (
    BEFORE,
    EFFORT,
    ENERGY,
    FORCE,
    LATE_F,
    LATE_R,
    LATE_V,
    OUTSIDE,
    PUSH,
    SEEN_R,
    SLEW,
    STORED,
    R,
    V,
    compiled,
)
from rpo.engine.laws import Candidate, command
from rpo_core.judge.metrics import (
    Asked,
    AxisSums,
    Windows,
    count_together,
    fill_row,
    larger,
    last_outside,
    with_square,
)
from rpo_core.kernels.arithmetic import State, saturate
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import inlined
from rpo_core.world.cw import CwStep, cw_step


class Loops(NamedTuple):
    """Loops side by side: lanes are the axes x of the planar ones, their y, then the vertical ones.

    planar, vertical : numbers of loops
    starts : (2, lanes) position [m], velocity [m/s]
    disturbance : (ticks, lanes) [N]; (1, lanes): always the same
    goal, hold : (lanes,) position [m], and the force that holds there [N]; empty: the target
    limit_n : largest force of an axis
    step : the motion of a tick
    """

    planar: int
    vertical: int
    starts: Floats
    disturbance: Floats
    goal: Floats
    hold: Floats
    limit_n: float
    step: CwStep


class Room(NamedTuple):
    """What a thread writes while it flies.

    w : rows of lanes
    norms : (2, tail, lanes) squared distances and speeds of loops in the mean window
    sums : (2, flights) of their roots
    states : (ticks + 1, lanes, 2) r and v of all ticks; without ticks: they are not kept
    flight : (ticks + 1, 6) states of one flight
    """

    w: Floats
    norms: Floats
    sums: Floats
    states: Floats
    flight: Floats


@compiled
def fly(candidate: Candidate, loops: Loops, windows: Windows, room: Room) -> None:
    """Fly loops through all ticks of the horizon, and count what `finish` combines."""
    w, n = room.w, 2 * loops.planar + loops.vertical
    position = SEEN_R if len(loops.goal) > 0 else R
    w[:] = 0.0
    for s in range(n):
        w[R + s], w[V + s] = loops.starts[0, s], loops.starts[1, s]
    _aim(w, loops.goal)
    for tick in range(windows.horizon):
        if len(room.states) > 0:
            _keep(w, n, room.states[tick])
        command(w, n, position, tick, candidate)
        _act(w, n, tick, loops)
        _count_force(w, n, tick, windows)
        _step(w, loops.planar, loops.vertical, loops.step)
        _aim(w, loops.goal)
        _count_state(w, n, tick, position, windows)
        row = tick - (windows.ticks - windows.tail)
        if 0 <= row < windows.tail:
            _keep_norms(w, loops.planar, loops.vertical, position, room.norms, row)
    if len(room.states) > 0:
        _keep(w, n, room.states[windows.horizon])


@inlined
def _keep(w, n, states):  # type: ignore[no-untyped-def]
    for s in range(n):
        states[s, 0], states[s, 1] = w[R + s], w[V + s]


@inlined
def _aim(w, goal):  # type: ignore[no-untyped-def]
    for s in range(len(goal)):
        w[SEEN_R + s] = w[R + s] - goal[s]


@inlined
def _act(w, n, tick, loops):  # type: ignore[no-untyped-def]
    """Hold at the goal, saturate; the step from rest to the first command is no slew."""
    for s in range(len(loops.hold)):
        w[FORCE + s] += loops.hold[s]
    for s in range(n):
        w[FORCE + s] = saturate(w[FORCE + s], loops.limit_n)
    if tick == 0:
        for s in range(n):
            w[BEFORE + s] = w[FORCE + s]
    if tick < len(loops.disturbance):
        disturbance = loops.disturbance[tick]
        for s in range(n):
            w[PUSH + s] = disturbance[s]


@inlined
def _count_force(w, n, tick, windows):  # type: ignore[no-untyped-def]
    if tick < windows.ticks:
        for s in range(n):
            force = w[FORCE + s]
            w[ENERGY + s] = with_square(w[ENERGY + s], force)
            w[EFFORT + s] += abs(force)
            w[SLEW + s] = larger(w[SLEW + s], force - w[BEFORE + s]) + STORED
            w[BEFORE + s] = force
    if tick >= windows.horizon - windows.late:
        for s in range(n):
            w[LATE_F + s] = larger(w[LATE_F + s], w[FORCE + s]) + STORED


@inlined
def _step(w, p, q, step):  # type: ignore[no-untyped-def]
    for x in range(p):
        y = p + x
        state = (w[R + x], w[R + y], 0.0, w[V + x], w[V + y], 0.0)
        force = (w[FORCE + x] + w[PUSH + x], w[FORCE + y] + w[PUSH + y], 0.0)
        w[R + x], w[R + y], _, w[V + x], w[V + y], _ = cw_step(state, force, step)
    for z in range(2 * p, 2 * p + q):
        state = (0.0, 0.0, w[R + z], 0.0, 0.0, w[V + z])
        force = (0.0, 0.0, w[FORCE + z] + w[PUSH + z])
        _, _, w[R + z], _, _, w[V + z] = cw_step(state, force, step)


@inlined
def _count_state(w, n, tick, position, windows):  # type: ignore[no-untyped-def]
    r = position
    if tick < windows.ticks:
        for s in range(n):
            w[OUTSIDE + s] = (
                last_outside(w[OUTSIDE + s], tick, w[r + s], windows.arrival_m) + STORED
            )
    if tick >= windows.horizon - windows.late:
        for s in range(n):
            w[LATE_R + s] = larger(w[LATE_R + s], w[r + s]) + STORED
            w[LATE_V + s] = larger(w[LATE_V + s], w[V + s]) + STORED


@inlined
def _keep_norms(w, p, q, position, norms, row):  # type: ignore[no-untyped-def]
    r, distances, speeds = position, norms[0, row], norms[1, row]
    for x in range(p):
        y = p + x
        distances[x] = w[r + x] * w[r + x] + w[r + y] * w[r + y]
        speeds[x] = w[V + x] * w[V + x] + w[V + y] * w[V + y]
    for z in range(2 * p, 2 * p + q):
        distances[z] = w[r + z] * w[r + z]
        speeds[z] = w[V + z] * w[V + z]


@compiled
def _axis_sums(w, lane):  # type: ignore[no-untyped-def]
    s = np.int64(lane)
    energy, effort, step = w[ENERGY + s], w[EFFORT + s], w[SLEW + s]
    return AxisSums(
        energy, effort, step, w[LATE_R + s], w[LATE_V + s], w[LATE_F + s], w[OUTSIDE + s]
    )


@compiled
def _add_norms(norms, x, z, tail, sums):  # type: ignore[no-untyped-def]
    sums[:] = 0.0
    for tick in range(tail):
        row = norms[tick]
        for k in range(len(x)):
            sums[k] += sqrt(row[x[k]] + row[z[k]])


@compiled
def finish(
    room: Room, lanes: NDArray[np.uint64], tail: int, dt: float, mass: float, rows: Any
) -> None:
    """Fill rows of metrics (n, columns) of flights whose axes are in lanes (3, n) x, y, z."""
    w, n = room.w, len(rows)
    distances, speeds = room.sums[0, :n], room.sums[1, :n]
    _add_norms(room.norms[0], lanes[0], lanes[2], tail, distances)
    _add_norms(room.norms[1], lanes[0], lanes[2], tail, speeds)
    for k in range(n):
        x, y, z = lanes[0, k], lanes[1, k], lanes[2, k]
        sums = _axis_sums(w, x), _axis_sums(w, y), _axis_sums(w, z)
        fill_row(rows[k], sums[0], sums[1], sums[2], distances[k], speeds[k], tail, dt, mass)


@compiled
def judge(room: Room, lanes: NDArray[np.uint64], goal: State, asked: Asked, rows: Any) -> None:
    """Fill the columns of rows that `count_together` counts, from the states of all ticks."""
    states, flight = room.states, room.flight
    for k in range(len(rows)):
        for tick in range(len(states)):
            for axis in range(3):
                s = np.int64(lanes[axis, k])
                flight[tick, axis], flight[tick, 3 + axis] = states[tick, s, 0], states[tick, s, 1]
        count_together(flight, goal, asked, rows[k])
