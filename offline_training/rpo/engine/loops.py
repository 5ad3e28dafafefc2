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

from rpo.engine.lanes import (
    BEFORE,
    DISTURBANCE,
    EFFORT,
    ENERGY,
    FORCE,
    FROM_GOAL,
    LATE_F,
    LATE_R,
    LATE_V,
    OUTSIDE,
    SLEW,
    STORED,
    R,
    V,
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
from rpo_core.kernels.arrays import Floats, Ints
from rpo_core.kernels.jit import inlined, unlocked
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
    states : (ticks + 1, lanes, 2) r and v of all ticks; without ticks: they are not kept
    """

    w: Floats
    norms: Floats
    states: Floats


@unlocked
def fly(candidate: Candidate, loops: Loops, windows: Windows, room: Room) -> None:
    """Fly loops through all ticks of the horizon, and count what `finish` combines."""
    w, n = room.w, 2 * loops.planar + loops.vertical
    position = FROM_GOAL if len(loops.goal) > 0 else R
    w[:] = 0.0
    for s in range(n):
        w[R + s], w[V + s] = loops.starts[0, s], loops.starts[1, s]
    _aim(w, loops.goal)
    for tick in range(windows.horizon):
        if len(room.states) > 0:
            _keep(w, n, room.states[tick])
        command(w, n, position, tick, candidate)
        _act(w, n, tick, loops)
        _step(w, loops.planar, loops.vertical, loops.step)
        _aim(w, loops.goal)
        _count(w, n, tick, position, windows)
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
        w[FROM_GOAL + s] = w[R + s] - goal[s]


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
            w[DISTURBANCE + s] = disturbance[s]


@inlined
def _step(w, p, q, step):  # type: ignore[no-untyped-def]
    for x in range(p):
        y = p + x
        state = (w[R + x], w[R + y], 0.0, w[V + x], w[V + y], 0.0)
        force = (w[FORCE + x] + w[DISTURBANCE + x], w[FORCE + y] + w[DISTURBANCE + y], 0.0)
        w[R + x], w[R + y], _, w[V + x], w[V + y], _ = cw_step(state, force, step)
    for z in range(2 * p, 2 * p + q):
        state = (0.0, 0.0, w[R + z], 0.0, 0.0, w[V + z])
        force = (0.0, 0.0, w[FORCE + z] + w[DISTURBANCE + z])
        _, _, w[R + z], _, _, w[V + z] = cw_step(state, force, step)


@inlined
def _count(w, n, tick, position, windows):  # type: ignore[no-untyped-def]
    """Count the command of a tick, and the state that it led to."""
    if tick < windows.ticks:
        for s in range(n):
            force = w[FORCE + s]
            w[ENERGY + s] = with_square(w[ENERGY + s], force)
            w[EFFORT + s] += abs(force)
            w[SLEW + s] = larger(w[SLEW + s], force - w[BEFORE + s]) + STORED
            w[BEFORE + s] = force
            outside = last_outside(w[OUTSIDE + s], tick, w[position + s], windows.arrival_m)
            w[OUTSIDE + s] = outside + STORED
    if tick >= windows.horizon - windows.late:
        for s in range(n):
            w[LATE_F + s] = larger(w[LATE_F + s], w[FORCE + s]) + STORED
            w[LATE_R + s] = larger(w[LATE_R + s], w[position + s]) + STORED
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


@unlocked
def _axis_sums(w, s):  # type: ignore[no-untyped-def]
    energy, effort, step = w[ENERGY + s], w[EFFORT + s], w[SLEW + s]
    return AxisSums(
        energy, effort, step, w[LATE_R + s], w[LATE_V + s], w[LATE_F + s], w[OUTSIDE + s]
    )


@unlocked
def _summed(norms, x, z, tail):  # type: ignore[no-untyped-def]
    sums = np.zeros(len(x))
    for tick in range(tail):
        row = norms[tick]
        for k in range(len(x)):
            sums[k] += sqrt(row[np.uint64(x[k])] + row[np.uint64(z[k])])  # none from the end
    return sums


@unlocked
def finish(room: Room, lanes: Ints, tail: int, dt: float, mass: float, rows: Any) -> None:
    """Fill rows of metrics (n, columns) of flights whose axes are in lanes (3, n) x, y, z."""
    w, x, y, z = room.w, lanes[0], lanes[1], lanes[2]
    distances, speeds = _summed(room.norms[0], x, z, tail), _summed(room.norms[1], x, z, tail)
    for k in range(len(rows)):
        sums = _axis_sums(w, x[k]), _axis_sums(w, y[k]), _axis_sums(w, z[k])
        fill_row(rows[k], sums[0], sums[1], sums[2], distances[k], speeds[k], tail, dt, mass)


@unlocked
def judge(states: Any, lanes: Ints, goal: State, asked: Asked, rows: Any) -> None:
    """Fill the columns of rows that `count_together` counts, from the states of all ticks."""
    flight = np.empty((len(states), 6))
    for k in range(len(rows)):
        for axis in range(3):
            s = lanes[axis, k]
            for tick in range(len(states)):
                flight[tick, axis], flight[tick, 3 + axis] = states[tick, s, 0], states[tick, s, 1]
        count_together(flight, goal, asked, rows[k])
