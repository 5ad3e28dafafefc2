# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Filters of flights side by side, in flat tables: eight flights in a SIMD register.

The arithmetic is that of `rpo_core.navigation.estimator`, with the same bits. This module goes with
the engine.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from rpo.engine.parts.sensor_tables import (
    COLUMNS,
    CROSS_SHARE,
    HAS_RANGE,
    HAS_VELOCITY,
    LATENCY,
    LOOKS,
    MEASURED,
    NOISE_FLOOR,
    NOISE_SHARE,
    TURNS,
    VELOCITY_FLOOR,
    VELOCITY_SHARE,
    row_of,
)
from rpo_core.attitude.chaser import turn, turn_back
from rpo_core.kernels.arithmetic import Vector, saturate
from rpo_core.kernels.jit import as_table, inlined, kernel
from rpo_core.kernels.vectors import pick
from rpo_core.navigation import estimator
from rpo_core.navigation.estimator import Estimator
from rpo_core.navigation.sensors import Sensors, across, larger, sight
from rpo_core.world.cw import CwStep, cw_step, unpacked

STATES = 9
SQUARE = STATES * STATES

N, LIMIT, DELAY, PATIENCE, NEWEST, FULL, UNITS, TURNED, GUST = range(9)
STEP, GATES, START = 9, 35, 42
PROCESS_NOISE, SPREAD, AGAIN, SENSORS = (START + STATES + SQUARE * i for i in range(4))
"""Places in a filter's settings: 6 or 9 states; limit of the thrusters [N]; ticks from a command to
its force; so many rejected measurements in a row restart it (0: none do); largest latency of a
sensor [ticks]; 1 if the covariance of the newest tick is wanted (0: the state alone, which is
faster); number of sensors; 1 if one of them turns with the chaser or looks at the port; share by
which the process noise grows with the square of a command [1/N^2]. Then the exact step of the
relative dynamics for one tick (26,), the largest NIS of so many numbers (7,), the state at the
start (9,), covariances (81,) that a tick adds, at the start, and after a restart; the columns of
each sensor as the filter takes it."""

NOW, BASE, ORIGIN, IN_A_ROW, RESETS, LAST_RESET, ACCEPTED, REJECTED, LAST_ACCEPTED = range(9)
WHOLE = 9
BOTH = STATES + SQUARE
X, SETTLED, KEPT = (10 + BOTH * i for i in range(3))
P, WORK = X + STATES, KEPT + BOTH
TESTED, MOST_SENSORS, TESTS = WORK + 2 * STATES, 4, 8
COMMANDS = TESTED + MOST_SENSORS * TESTS
"""Places in what a filter remembers: counts; whether the newest covariance is another one than the
settled; then, each a state and its covariance, that of the
newest tick (X, P), of the tick up to which all measurements have come, and before a measurement;
scratch. Of the newest measurement of each sensor 8 numbers: how many were tested (0: none came),
the sum of their squares (NIS), each innovation over its sigma. Then the newest commands, 3 numbers
in a slot, and the newest measurements, 8 of each sensor in a slot, with the tick each was taken
at. If a sensor turns or looks at the port, the newest attitudes follow, `HEADING` numbers in a
slot."""

HEADING, PORT = 16, 13
"""Numbers of an attitude: quaternion, covariance (3, 3) of the angles in the chaser's axes; from
place PORT the port (3,) [m], target LVLH."""


SCRATCH = range(KEPT, TESTED)
"""Places of a memory that a tick writes before it reads them."""


@inlined
def slots_of(f: Any) -> int:
    """Return how many commands are remembered."""
    return int(f[NEWEST]) + int(f[DELAY]) + 2


@inlined
def _pending(tick: int, i: int, f: Any) -> int:
    """Return the place of what sensor i measured at a tick."""
    slots, count = slots_of(f), int(f[UNITS])
    return COMMANDS + 3 * slots + (MEASURED + 1) * (count * (tick % slots) + i)


@inlined
def _heading(tick: int, f: Any) -> int:
    """Return the place of the attitude at a tick."""
    slots = slots_of(f)
    return COMMANDS + slots * (3 + (MEASURED + 1) * int(f[UNITS])) + HEADING * (tick % slots)


@inlined
def numbers_of(f: Any) -> int:
    """Return how many numbers a filter remembers."""
    slots = slots_of(f)
    each = 3 + (MEASURED + 1) * int(f[UNITS]) + (HEADING if f[TURNED] != 0.0 else 0)
    return COMMANDS + slots * each


@kernel
def step_state(m: Any, n: int, force: Vector, step: CwStep) -> None:
    """Move the state by one tick under a force (3,) [N]."""
    fx, fy, fz = force
    if n == STATES:
        fx, fy, fz = fx + m[X + 6], fy + m[X + 7], fz + m[X + 8]
    moved = cw_step((m[X], m[X + 1], m[X + 2], m[X + 3], m[X + 4], m[X + 5]), (fx, fy, fz), step)
    m[X], m[X + 1], m[X + 2], m[X + 3], m[X + 4], m[X + 5] = moved


@inlined
def _step_line(m: Any, i: int, n: int, step: CwStep) -> None:
    """Move a row (n = 1) or a column (n = 9) of a table as `step_state` moves a state."""
    j, k, q, r, s = i + n, i + 2 * n, i + 3 * n, i + 4 * n, i + 5 * n
    force = (m[i + 6 * n], m[i + 7 * n], m[i + 8 * n])
    m[i], m[j], m[k], m[q], m[r], m[s] = cw_step((m[i], m[j], m[k], m[q], m[r], m[s]), force, step)


@kernel
def step_covariance(m: Any, step: CwStep, f: Any, louder: float) -> None:
    """Replace the covariance P by F P F' + Q; louder : factor of what Q has of the motion."""
    for column in range(STATES):
        _step_line(m, P + column, STATES, step)
    for row in range(6):  # a disturbance stays: so do the rows of it
        _step_line(m, P + STATES * row, 1, step)
    for row in range(STATES):
        for column in range(row, STATES):
            at = STATES * row + column
            value = m[P + at] + f[PROCESS_NOISE + at] * (louder if row < 6 else 1.0)
            m[P + at] = value
            m[P + STATES * column + row] = value


@inlined
def spreads(m: Any) -> tuple[float, float]:
    """Return the roots of the traces of the covariances of position [m] and velocity [m/s]."""
    p, n = P, STATES + 1
    q = p + 3 * n
    position, velocity = m[p] + m[p + n] + m[p + 2 * n], m[q] + m[q + n] + m[q + 2 * n]
    position, velocity = pick(position < 0.0, 0.0, position), pick(velocity < 0.0, 0.0, velocity)
    return sqrt(position), sqrt(velocity)


@inlined
def joseph(
    m: Any,
    x: int,
    p: int,
    n: int,
    work: int,
    first: int,
    h: Vector,
    measured: float,
    variance: float,
) -> float:
    """Take one measured number, h . x[first : first + 3] plus noise; return innovation / sigma.

    x, p : places of n states and of their covariance; work : of 2 n numbers of scratch

    Of a variance more than 1e16 times the measured one, rounding leaves P with no digit that is
    right, and a diagonal or the spread may be negative; the updates that follow put that right.
    """
    row, gains = p + n * first, work + n  # P is symmetric: rows are faster than columns
    for i in range(n):
        m[work + i] = h[0] * m[row + i] + h[1] * m[row + n + i] + h[2] * m[row + 2 * n + i]
    at = work + first
    spread = variance + h[0] * m[at] + h[1] * m[at + 1] + h[2] * m[at + 2]
    at = x + first
    innovation = measured - (h[0] * m[at] + h[1] * m[at + 1] + h[2] * m[at + 2])
    for i in range(n):
        m[gains + i] = m[work + i] / spread
        m[x + i] += m[gains + i] * innovation
    share = spread - variance  # h' P h
    for a in range(n):
        gain, row = m[gains + a], p + n * a
        rest, noise = m[work + a] - gain * share, gain * variance  # of (I - K h') P h; K r
        for b in range(a, n):
            other = m[gains + b]
            value = m[row + b] - gain * m[work + b] - rest * other + noise * other
            m[row + b] = value
            m[p + n * b + a] = value
    return innovation / sqrt(abs(spread))


@kernel
def update(m: Any, first: int, h: Vector, measured: float, variance: float) -> float:
    """Take one measured number of position or velocity; see `joseph`."""
    return joseph(m, X, P, STATES, WORK, first, h, measured, variance)


@inlined
def _shared(m: Any, at: int, a: Vector, b: Vector) -> float:
    """Return a' P b of a covariance P (3, 3) at a place of the memory."""
    return (
        a[0] * (m[at] * b[0] + m[at + 1] * b[1] + m[at + 2] * b[2])
        + a[1] * (m[at + 3] * b[0] + m[at + 4] * b[1] + m[at + 5] * b[2])
        + a[2] * (m[at + 6] * b[0] + m[at + 7] * b[1] + m[at + 8] * b[2])
    )


@inlined
def _widened(m: Any, at: int, a: Vector, b: Vector, distance: float) -> tuple[float, float]:
    """Return variances [m^2] along a and b that are sure to cover those of an attitude.

    at : its place; a, b : (3,) at right angles to each other and to the line of sight, target LVLH

    An angle about one moves the point along the other. Independent errors as large as the diagonal
    and the correlation together are never less than correlated ones.
    """
    q = (m[at], m[at + 1], m[at + 2], m[at + 3])
    a, b = turn_back(a, q), turn_back(b, q)
    shared, square = abs(_shared(m, at + 4, a, b)), distance * distance
    along_a, along_b = _shared(m, at + 4, b, b) + shared, _shared(m, at + 4, a, a) + shared
    return square * along_a, square * along_b


@kernel
def _take(m: Any, found: int, sensor: Any, tested: int, heading: int) -> int:
    """Take the numbers of a measurement, and return how many; fill its tests.

    heading : place of the attitude by which it was turned
    """
    px, py, pz = 0.0, 0.0, 0.0
    if sensor[LOOKS] != 0.0:
        px, py, pz = m[heading + PORT], m[heading + PORT + 1], m[heading + PORT + 2]
    distance, ux, uy, uz = sight(m[X] - px, m[X + 1] - py, m[X + 2] - pz)
    first, second = across(ux, uy, uz)
    wide = (0.0, 0.0)
    if sensor[TURNS] != 0.0:
        wide = _widened(m, heading, first, second, distance)
    mx, my, mz = m[found + 1], m[found + 2], m[found + 3]
    if sensor[HAS_RANGE] == 0.0:  # a direction: the point at the distance that is expected
        mx, my, mz = px + distance * mx, py + distance * my, pz + distance * mz
    at = tested + 2
    m[tested + 1] = 0.0
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
            vx, vy, vz = m[found + 4], m[found + 5], m[found + 6]
            floor, share = sensor[VELOCITY_FLOOR], sensor[VELOCITY_SHARE]
        sigma = larger(floor, share * distance)
        value = h[0] * vx + h[1] * vy + h[2] * vz
        variance = sigma * sigma
        if sensor[TURNS] != 0.0 and number > 0:
            variance += wide[number - 1]
        m[at] = update(m, 3 if number >= 3 else 0, h, value, variance)
        m[tested + 1] += m[at] * m[at]
        at += 1
    m[tested] = float(at - tested - 2)
    return at - tested - 2


@kernel
def _accept(m: Any, found: int, sensor: Any, f: Any, i: int) -> bool:
    """Take a measurement unless its NIS is too large; return whether it was taken."""
    for j in range(BOTH):
        m[KEPT + j] = m[X + j]
    tested = TESTED + TESTS * i
    heading = _heading(int(m[found + MEASURED]), f) if f[TURNED] != 0.0 else 0
    gate = f[GATES + _take(m, found, sensor, tested, heading)]
    if gate <= 0.0 or m[tested + 1] <= gate:
        return True
    for j in range(BOTH):
        m[X + j] = m[KEPT + j]
    return False


@kernel
def _restart(m: Any, found: int, sensor: Any, f: Any) -> None:
    """Begin again with what was measured: P is large again, the disturbance is zero."""
    for j in range(SQUARE):
        m[P + j] = f[AGAIN + j]
    for j in range(3):
        m[X + 6 + j] = 0.0
        if sensor[HAS_RANGE] != 0.0:
            m[X + j] = m[found + 1 + j]
        if sensor[HAS_VELOCITY] != 0.0:
            m[X + 3 + j] = m[found + 4 + j]
    m[IN_A_ROW] = 0.0
    m[RESETS] += 1.0
    m[LAST_RESET] = m[NOW]


@kernel
def _advance(tick: int, step: CwStep, f: Any, m: Any, last: bool, full: bool) -> None:
    """Move the state to a tick, and take what was measured at that tick.

    last : whether all measurements of the tick have come; they are counted then, and only then
    full : with its covariance; otherwise nothing may be measured at the tick
    """
    if tick > m[ORIGIN]:
        c = COMMANDS + 3 * ((tick - 1 - int(f[DELAY])) % slots_of(f))
        x, y, z = m[c], m[c + 1], m[c + 2]
        step_state(m, int(f[N]), (x, y, z), step)
        if full:
            step_covariance(m, step, f, 1.0 + f[GUST] * (x * x + y * y + z * z))
    for i in range(int(f[UNITS])):
        found = _pending(tick, i, f)
        if m[found] == 0.0 or m[found + MEASURED] != tick:
            continue
        sensor = f[SENSORS + COLUMNS * i : SENSORS + COLUMNS * (i + 1)]
        taken = _accept(m, found, sensor, f, i)
        if not last:
            continue
        if taken:
            m[ACCEPTED] += 1.0
            m[IN_A_ROW] = 0.0
            m[LAST_ACCEPTED] = tick
        else:
            m[REJECTED] += 1.0
            m[IN_A_ROW] += 1.0
            if f[PATIENCE] > 0.0 and m[IN_A_ROW] >= f[PATIENCE]:
                _restart(m, found, sensor, f)


@kernel
def _settle(tick: int, step: CwStep, f: Any, m: Any) -> None:
    """Move the base to the newest tick of which no more measurements will come."""
    if tick - int(f[NEWEST]) > m[BASE]:
        m[BASE] += 1.0
        _advance(int(m[BASE]), step, f, m, True, True)


@kernel
def _keep(
    tick: int, command: Vector, measured: Any, attitude: Any, step: CwStep, f: Any, m: Any
) -> None:
    """Keep the command of the tick before, and what arrives at this one."""
    for t in range(int(m[NOW]) + 1, tick + 1):  # of missing ticks, the command is held
        line = COMMANDS + 3 * ((t - 1) % slots_of(f))
        for axis in range(3):
            m[line + axis] = saturate(command[axis], f[LIMIT])
        for i in range(int(f[UNITS])):
            m[_pending(t, i, f)] = 0.0
        if f[TURNED] != 0.0:
            for j in range(HEADING):
                m[_heading(t, f) + j] = attitude[j]
        m[NOW] = t
        if t < tick:
            _settle(t, step, f, m)
    for i in range(int(f[UNITS])):
        taken = tick - int(f[SENSORS + COLUMNS * i + LATENCY])
        if measured[MEASURED * i] != 0.0 and taken >= m[ORIGIN]:
            slot = _pending(taken, i, f)
            for j in range(MEASURED):
                m[slot + j] = measured[MEASURED * i + j]
            m[slot + MEASURED] = taken
            at = _heading(taken, f)
            if f[SENSORS + COLUMNS * i + TURNS] != 0.0:
                seen = (m[slot + 1], m[slot + 2], m[slot + 3])
                q = (m[at], m[at + 1], m[at + 2], m[at + 3])
                m[slot + 1], m[slot + 2], m[slot + 3] = turn(seen, q)
            if f[SENSORS + COLUMNS * i + LOOKS] * f[SENSORS + COLUMNS * i + HAS_RANGE] != 0.0:
                for j in range(3):
                    m[slot + 1 + j] += m[at + PORT + j]


@kernel
def begin(tick: int, f: Any, m: Any) -> None:
    """Begin with the start at a tick."""
    for j in range(STATES):
        m[SETTLED + j] = f[START + j]
    for j in range(SQUARE):
        m[SETTLED + STATES + j] = f[SPREAD + j]
    for j in range(X):
        m[j] = 0.0
    m[NOW] = m[BASE] = tick - 1
    m[ORIGIN] = m[LAST_ACCEPTED] = tick
    m[LAST_RESET], m[WHOLE] = -1.0, 1.0
    for j in range(COMMANDS, numbers_of(f)):
        m[j] = 0.0


@kernel
def estimate(tick: int, command: Vector, measured: Any, attitude: Any, f: Any, m: Any) -> None:
    """Take a tick: fill the newest state and covariance of the memory, from place X.

    command : (3,) [N] of the tick before
    measured : (7 sensors,) that arrived at this tick
    attitude : (16,) estimated at this tick, `HEADING`; read where a sensor turns with the chaser or
        looks at the port

    Measurements come late. The base is moved once, to the newest tick whose measurements have all
    come; from there to this tick the motion, and what has come already, are computed anew. So each
    measurement is taken at the tick it belongs to.
    """
    step, late = unpacked(f, STEP, 1), f[NEWEST] > 0.0
    if m[ORIGIN] < 0.0:
        begin(tick, f, m)
    for i in range(int(f[UNITS])):
        m[TESTED + TESTS * i] = 0.0
    if late or m[NOW] < m[ORIGIN]:  # else the newest tick is the one that is settled
        for j in range(BOTH if m[WHOLE] > 0.0 else STATES):
            m[X + j] = m[SETTLED + j]
    _keep(tick, command, measured, attitude, step, f, m)
    _settle(tick, step, f, m)
    if late:
        _look_ahead(tick, step, f, m)
    wrong = 0
    for j in range(BOTH):
        wrong += m[X + j] - m[X + j] != 0.0
    if wrong > 0:
        _begin_again(tick, f, m)


@kernel
def _look_ahead(tick: int, step: CwStep, f: Any, m: Any) -> None:
    """Keep the settled tick, and move on to the newest one with what has come already."""
    full, base = f[FULL] != 0.0, int(m[BASE])
    for t in range(base + 1, tick + 1):
        for i in range(int(f[UNITS])):
            found = _pending(t, i, f)
            full = full or (m[found] != 0.0 and m[found + MEASURED] == t)
    m[WHOLE] = 1.0 if full else 0.0
    for j in range(BOTH if full else STATES):
        m[SETTLED + j] = m[X + j]
    for t in range(base + 1, tick + 1):
        _advance(t, step, f, m, False, full)


@kernel
def _begin_again(tick: int, f: Any, m: Any) -> None:
    """Restart from the start: the numbers ran out of range."""
    resets = m[RESETS]
    begin(tick + 1, f, m)
    m[RESETS], m[LAST_RESET] = resets + 1.0, tick
    for j in range(SQUARE):
        m[SETTLED + STATES + j] = f[AGAIN + j]
    for j in range(BOTH):
        m[X + j] = m[SETTLED + j]


def filter_of(settings: Estimator, sensors: Sensors, scenario: Any) -> Any:
    """Return the settings of a scenario's filter, table f of the kernels."""
    p = estimator.filter_of(settings, sensors, scenario)
    covariances = p.process_noise, p.spread, p.spread_again
    return as_table(
        [
            *(p.states, p.limit_n, p.delay, p.patience, p.latency, p.covariance, len(p.sensors)),
            float(sensors.turn or sensors.look),
            *(p.gust, *p.step, *p.gates, *p.start, *np.ravel(covariances)),
            *(number for s in p.sensors for number in row_of(s)),
        ]
    )


def memory_of(f: Any) -> Any:
    """Return the memory of a filter not begun, table m of the kernels."""
    return as_table([-1.0] * X + [0.0] * (numbers_of(f) - X))
