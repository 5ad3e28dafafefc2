# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The Kalman filter, number by number: + - * / sqrt and comparisons, in the order written.

The state has six numbers, position [m] and velocity [m/s] in target LVLH, or nine with a constant
disturbance force [N]. A covariance is an n x n table, row after row, always symmetric.

A measurement is taken number by number (they are independent in the frame of the line of sight), in
Joseph's form (`rpo_nav.kalman`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from rpo_core.kernels import CwStep, Vector, saturate
from rpo_core.kernels.jit import inlined, kernel
from rpo_nav.kalman import step_covariance, step_state, update
from rpo_nav.sensor_kernels import (
    CROSS_SHARE,
    HAS_RANGE,
    HAS_VELOCITY,
    LATENCY,
    MEASURED,
    NOISE_FLOOR,
    NOISE_SHARE,
    VELOCITY_FLOOR,
    VELOCITY_SHARE,
    across,
    larger,
    sight,
)

NOW, BASE, ORIGIN, IN_A_ROW, RESETS, LAST_RESET, ACCEPTED, REJECTED, LAST_ACCEPTED = range(9)
"""Places in `Memory.counts`."""

COUNTS = 9

TESTED = 8
"""Numbers kept of the newest measurement of a sensor: how many were tested (0: none came), the sum
of their squares (NIS), and each innovation over its sigma."""


class Filter(NamedTuple):
    """What the filter is told of the world.

    n : 6 or 9 states
    step : exact step of the relative dynamics for one tick
    noise : (n * n) covariance that a tick adds
    start, spread : (n) state and (n * n) covariance at the start
    again : (n * n) covariance after a restart
    sensors : (sensors, columns) as `rpo_nav.sensor_kernels` has them
    gates : (7) largest NIS of so many numbers
    limit_n : of the thrusters; delay : ticks from a command to its force
    patience : so many rejected measurements in a row restart the filter; 0: none do
    newest : largest latency of a sensor in ticks
    full : 1 if the covariance of the newest tick is wanted; 0 if the state alone, which is faster
    """

    n: int
    step: CwStep
    noise: Any
    start: Any
    spread: Any
    again: Any
    sensors: Any
    gates: Any
    limit_n: float
    delay: int
    patience: int
    newest: int
    full: int


class Memory(NamedTuple):
    """What the filter remembers.

    x, p : state and covariance at the tick up to which all measurements have come
    y, s : those of the newest tick
    work : (3 n + n * n) scratch
    commands : (slots, 3) newest commands; pending : (slots, sensors, 8) newest measurements, each
        with the tick it was taken at
    counts : whole numbers, see NOW and others
    tested : (sensors, 8) of the newest measurement of each sensor
    """

    x: Any
    p: Any
    y: Any
    s: Any
    work: Any
    commands: Any
    pending: Any
    counts: Any
    tested: Any


@inlined
def _take(x: Any, p: Any, n: int, found: Any, sensor: Any, work: Any, tested: Any) -> None:
    """Take the numbers of a measurement; fill the row of their innovations."""
    distance, ux, uy, uz = sight(x[0], x[1], x[2])
    first, second = across(ux, uy, uz)
    mx, my, mz = found[1], found[2], found[3]
    if sensor[HAS_RANGE] == 0.0:  # a direction: the point at the distance that is expected
        mx, my, mz = distance * mx, distance * my, distance * mz
    at = 2
    tested[1] = 0.0
    for number in range(6):
        if (number == 0 and sensor[HAS_RANGE] == 0.0) or (
            number >= 3 and sensor[HAS_VELOCITY] == 0.0
        ):
            continue
        h, vx, vy, vz = (ux, uy, uz), mx, my, mz
        floor, share = sensor[NOISE_FLOOR], sensor[NOISE_SHARE]
        if number > 0:
            h, share = (first if number == 1 else second), sensor[CROSS_SHARE]
        if number >= 3:
            h = (
                1.0 if number == 3 else 0.0,
                1.0 if number == 4 else 0.0,
                1.0 if number == 5 else 0.0,
            )
            vx, vy, vz = found[4], found[5], found[6]
            floor, share = sensor[VELOCITY_FLOOR], sensor[VELOCITY_SHARE]
        sigma = larger(floor, share * distance)
        value = h[0] * vx + h[1] * vy + h[2] * vz
        begin = 3 if number >= 3 else 0
        tested[at] = update(x, p, n, begin, h, value, sigma * sigma, work)
        tested[1] += tested[at] * tested[at]
        at += 1
    tested[0] = float(at - 2)


@inlined
def _accept(x: Any, p: Any, n: int, found: Any, sensor: Any, f: Filter, m: Memory, i: int) -> bool:
    """Take a measurement unless its NIS is too large; return whether it was taken."""
    work, kept = m.work, 2 * n
    for j in range(n):
        work[kept + j] = x[j]
    for j in range(n * n):
        work[kept + n + j] = p[j]
    tested = m.tested[i]
    _take(x, p, n, found, sensor, work, tested)
    gate = f.gates[int(tested[0])]
    if gate <= 0.0 or tested[1] <= gate:
        return True
    for j in range(n):
        x[j] = work[kept + j]
    for j in range(n * n):
        p[j] = work[kept + n + j]
    return False


@inlined
def _restart(x: Any, p: Any, n: int, found: Any, sensor: Any, f: Filter, m: Memory) -> None:
    """Begin again with what was measured: P is large again, the disturbance is zero."""
    for j in range(n * n):
        p[j] = f.again[j]
    for j in range(6, n):
        x[j] = 0.0
    if sensor[HAS_RANGE] != 0.0:
        for j in range(3):
            x[j] = found[1 + j]
    if sensor[HAS_VELOCITY] != 0.0:
        for j in range(3):
            x[3 + j] = found[4 + j]
    m.counts[IN_A_ROW] = 0
    m.counts[RESETS] += 1
    m.counts[LAST_RESET] = m.counts[NOW]


@inlined
def _advance(tick: int, x: Any, p: Any, f: Filter, m: Memory, last: bool, full: bool) -> None:
    """Move a state to a tick, and take what was measured at that tick.

    last : whether all measurements of the tick have come; they are counted then, and only then
    full : with its covariance; otherwise nothing may be measured at the tick
    """
    n, slots = f.n, len(m.commands)
    if tick > m.counts[ORIGIN]:
        c = m.commands[(tick - 1 - f.delay) % slots]
        step_state(x, n, (c[0], c[1], c[2]), f.step)
        if full:
            step_covariance(p, n, f.step, f.noise)
    waiting = m.pending[tick % slots]
    for i in range(len(f.sensors)):
        found = waiting[i]
        if found[0] == 0.0 or found[MEASURED] != tick:
            continue
        sensor = f.sensors[i]
        taken = _accept(x, p, n, found, sensor, f, m, i)
        if not last:
            continue
        if taken:
            m.counts[ACCEPTED] += 1
            m.counts[IN_A_ROW] = 0
            m.counts[LAST_ACCEPTED] = tick
        else:
            m.counts[REJECTED] += 1
            m.counts[IN_A_ROW] += 1
            if f.patience > 0 and m.counts[IN_A_ROW] >= f.patience:
                _restart(x, p, n, found, sensor, f, m)


@inlined
def _settle(tick: int, f: Filter, m: Memory) -> None:
    """Move the base to the newest tick of which no more measurements will come."""
    if tick - f.newest > m.counts[BASE]:
        m.counts[BASE] += 1
        _advance(m.counts[BASE], m.x, m.p, f, m, True, True)


@inlined
def _keep(tick: int, command: Vector, measured: Any, f: Filter, m: Memory) -> None:
    """Keep the command of the tick before, and what arrives at this one."""
    slots = len(m.commands)
    for t in range(m.counts[NOW] + 1, tick + 1):  # of missing ticks, the command is held
        line = m.commands[(t - 1) % slots]
        for axis in range(3):
            line[axis] = saturate(command[axis], f.limit_n)
        for i in range(len(f.sensors)):
            m.pending[t % slots][i][0] = 0.0
        m.counts[NOW] = t
        if t < tick:
            _settle(t, f, m)
    for i in range(len(f.sensors)):
        taken = tick - int(f.sensors[i][LATENCY])
        if measured[i][0] != 0.0 and taken >= m.counts[ORIGIN]:
            slot = m.pending[taken % slots][i]
            for j in range(MEASURED):
                slot[j] = measured[i][j]
            slot[MEASURED] = float(taken)


@kernel
def _is_finite(x: Any, n: int) -> bool:
    finite = True
    for i in range(n):
        finite = finite and x[i] - x[i] == 0.0
    return finite


@kernel
def begin(tick: int, f: Filter, m: Memory) -> None:
    """Begin with the start at a tick."""
    n = f.n
    for j in range(n):
        m.x[j] = f.start[j]
    for j in range(n * n):
        m.p[j] = f.spread[j]
    for j in range(COUNTS):
        m.counts[j] = 0
    m.counts[NOW] = m.counts[BASE] = tick - 1
    m.counts[ORIGIN] = m.counts[LAST_ACCEPTED] = tick
    m.counts[LAST_RESET] = -1
    for line in m.commands:
        for axis in range(3):
            line[axis] = 0.0
    for row in m.pending:
        for slot in row:
            slot[0] = 0.0


@kernel
def estimate(tick: int, command: Vector, measured: Any, f: Filter, m: Memory) -> None:
    """Take a tick: fill `m.y` and `m.s` with the estimate of its state.

    command : (3,) [N] of the tick before
    measured : (sensors, 7) that arrived at this tick

    Measurements come late. The base is moved once, to the newest tick whose measurements have all
    come; from there to this tick the motion, and what has come already, are computed anew. So each
    measurement is taken at the tick it belongs to.
    """
    if m.counts[ORIGIN] < 0:
        begin(tick, f, m)
    for row in m.tested:
        row[0] = 0.0
    _keep(tick, command, measured, f, m)
    _settle(tick, f, m)
    n = f.n
    for j in range(n):
        m.y[j] = m.x[j]
    for j in range(n * n):
        m.s[j] = m.p[j]
    full = f.full != 0
    for t in range(m.counts[BASE] + 1, tick + 1):
        for i in range(len(f.sensors)):
            found = m.pending[t % len(m.commands)][i]
            full = full or (found[0] != 0.0 and found[MEASURED] == t)
    for t in range(m.counts[BASE] + 1, tick + 1):
        _advance(t, m.y, m.s, f, m, False, full)
    if not _is_finite(m.y, n) or not _is_finite(m.s, n * n):
        _begin_again(tick, f, m)


@kernel
def _begin_again(tick: int, f: Filter, m: Memory) -> None:
    """Restart from the start: the numbers ran out of range."""
    resets = m.counts[RESETS]
    begin(tick + 1, f, m)
    m.counts[RESETS], m.counts[LAST_RESET] = resets + 1, tick
    n = f.n
    for j in range(n * n):
        m.p[j] = m.s[j] = f.again[j]
    for j in range(n):
        m.y[j] = m.x[j]
