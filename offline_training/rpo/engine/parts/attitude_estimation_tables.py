# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Attitude filters of flights side by side, in flat tables.

The arithmetic is that of `rpo_core.navigation.attitude_estimator`, with the same bits. This module
goes with the engine.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np

from rpo.engine.parts.estimation_tables import joseph
from rpo_core.attitude.chaser import times, turn_back, upright
from rpo_core.kernels.arithmetic import Vector, saturate, sin_cos
from rpo_core.kernels.jit import as_table, inlined, kernel
from rpo_core.navigation import attitude_estimator
from rpo_core.navigation.attitude_estimator import MAX_RATE_RAD_S, AttitudeEstimator
from rpo_core.navigation.attitude_sensors import AttitudeSensors, angles_between, turned_by

STATES = 6
SQUARE = STATES * STATES
ESTIMATE = 7
BOTH = ESTIMATE + SQUARE

(
    ORBIT_SINE, ORBIT_COSINE, DT, TURN_NOISE, SHARED_NOISE, BIAS_NOISE, GATE, PATIENCE, LATENCY,
) = range(9)  # fmt: skip
AXES, VARIANCES, START, SPREAD = 9, 18, 21, 28
"""Places in a filter's settings: sine and cosine of half the angle by which LVLH turns in a tick,
its length [s]; variances that it adds to an angle, to an angle and the bias about it, to the bias;
largest NIS of a measurement (0: none); so many rejected ones in a row restart it (0: none do);
latency of the star tracker [ticks], its axes (3, 3) in those of the chaser, variances about them;
quaternion and bias (7,) at the start; variances of angle and bias at the start and after
a restart."""

NOW, BASE, ORIGIN, IN_A_ROW, RESETS, LAST_RESET, ACCEPTED, REJECTED, LAST_ACCEPTED = range(9)
RATE, X = 9, 12
P, SETTLED = X + ESTIMATE, X + BOTH
KEPT = SETTLED + BOTH
ERROR, WORK, TESTED = (KEPT + SQUARE + STATES * i for i in (0, 1, 3))
HISTORY, RECORD = TESTED + 5, 8
"""Places in what a filter remembers: counts; the newest rate (3,) less the bias; state and
covariance (7 + 36) of the newest tick, and of the tick up to which all measurements have come; a
covariance before a measurement; scratch. Of a measurement 5 numbers: how many were tested (0: none
came), the sum of their squares (NIS), each innovation over its sigma. Then of the newest ticks, 8
numbers each: rate of the gyro, quaternion of the star tracker, whether there is one."""


def scratch_of(f: Any) -> range:
    """Return the places of a memory that a tick writes before it reads them."""
    return range(KEPT if f[LATENCY] > 0.0 else SETTLED, TESTED)


@inlined
def _record(tick: int, f: Any) -> int:
    """Return the place of what was measured at a tick."""
    return HISTORY + RECORD * (tick % (int(f[LATENCY]) + 2))


@inlined
def _moved(m: Any, i: int, n: int, turned: tuple[float, float, float, float], half: float) -> None:
    """Move an error, a column (n = 6) or a row (n = 1) of P, by a tick: the bias turns it too."""
    j, k = i + n, i + 2 * n
    x, y, z = half * m[i + 3 * n], half * m[i + 4 * n], half * m[i + 5 * n]
    a, b, c = turn_back((m[i] - x, m[j] - y, m[k] - z), turned)
    m[i], m[j], m[k] = a - x, b - y, c - z


@kernel
def step_attitude(m: Any, rate: Vector, f: Any) -> None:
    """Move state and covariance by one tick at a rate (3,) of the gyro [rad/s]."""
    dt = f[DT]
    x, y, z = rate[0] - m[X + 4], rate[1] - m[X + 5], rate[2] - m[X + 6]
    size = sqrt(x * x + y * y + z * z)
    sine, cosine = sin_cos(0.5 * dt * size)
    share = sine / size if size > 0.0 else 0.5 * dt
    turned = (share * x, share * y, share * z, cosine)
    orbit = (0.0, 0.0, -f[ORBIT_SINE], f[ORBIT_COSINE])
    q = times(times(orbit, (m[X], m[X + 1], m[X + 2], m[X + 3])), turned)
    m[X], m[X + 1], m[X + 2], m[X + 3] = upright(q)
    for column in range(STATES):
        _moved(m, P + column, STATES, turned, 0.5 * dt)
    for row in range(3):  # a bias stays: so do the rows of it
        _moved(m, P + STATES * row, 1, turned, 0.5 * dt)
        for column in range(row + 1):
            m[P + STATES * column + row] = m[P + STATES * row + column]
        m[P + 7 * row] += f[TURN_NOISE]
        m[P + 7 * row + 3] += f[SHARED_NOISE]
        m[P + 7 * row + 21] += f[BIAS_NOISE]
        for column in range(3, STATES):
            m[P + STATES * column + row] = m[P + STATES * row + column]


@kernel
def _accept(m: Any, found: int, f: Any) -> bool:
    """Take the quaternion at a place of the memory unless its NIS is too large."""
    for j in range(SQUARE):
        m[KEPT + j] = m[P + j]
    for j in range(STATES):
        m[ERROR + j] = 0.0
    q = (m[X], m[X + 1], m[X + 2], m[X + 3])
    star = (m[found], m[found + 1], m[found + 2], m[found + 3])
    x, y, z = angles_between(star, q)
    m[TESTED + 1] = 0.0
    for i in range(3):
        h = (f[AXES + 3 * i], f[AXES + 3 * i + 1], f[AXES + 3 * i + 2])
        angle = h[0] * x + h[1] * y + h[2] * z
        m[TESTED + 2 + i] = joseph(m, ERROR, P, STATES, WORK, 0, h, angle, f[VARIANCES + i])
        m[TESTED + 1] += m[TESTED + 2 + i] * m[TESTED + 2 + i]
    m[TESTED] = 3.0
    if f[GATE] > 0.0 and m[TESTED + 1] > f[GATE]:
        for j in range(SQUARE):
            m[P + j] = m[KEPT + j]
        return False
    error = (m[ERROR], m[ERROR + 1], m[ERROR + 2])
    m[X], m[X + 1], m[X + 2], m[X + 3] = turned_by(q, error)
    for i in range(3):
        m[X + 4 + i] += m[ERROR + 3 + i]
    return True


@inlined
def _spread(m: Any, f: Any) -> None:
    """Give P the variances of the start."""
    for j in range(SQUARE):
        m[P + j] = 0.0
    for i in range(3):
        m[P + 7 * i], m[P + 7 * i + 21] = f[SPREAD], f[SPREAD + 1]


@kernel
def _advance(tick: int, f: Any, m: Any) -> None:
    """Move the state to a tick, and take what the star tracker measured at it."""
    found = _record(tick, f)
    if tick > m[ORIGIN]:
        old = _record(tick - 1, f)
        rate = (
            0.5 * (m[old] + m[found]),
            0.5 * (m[old + 1] + m[found + 1]),
            0.5 * (m[old + 2] + m[found + 2]),
        )
        step_attitude(m, rate, f)
    if m[found + 7] == 0.0:
        return
    if _accept(m, found + 3, f):
        m[ACCEPTED] += 1.0
        m[IN_A_ROW] = 0.0
        m[LAST_ACCEPTED] = tick
        return
    m[REJECTED] += 1.0
    m[IN_A_ROW] += 1.0
    if f[PATIENCE] > 0.0 and m[IN_A_ROW] >= f[PATIENCE]:
        for j in range(4):
            m[X + j] = m[found + 3 + j]
        for j in range(3):
            m[X + 4 + j] = f[START + 4 + j]
        _spread(m, f)
        m[IN_A_ROW] = 0.0
        m[RESETS] += 1.0
        m[LAST_RESET] = tick


@kernel
def _settle(tick: int, f: Any, m: Any) -> None:
    """Move the base to the newest tick of which no more measurements will come."""
    late = f[LATENCY] > 0.0  # else the newest tick is the one that is settled
    if tick - int(f[LATENCY]) > m[BASE]:
        for j in range(BOTH if late else 0):
            m[X + j] = m[SETTLED + j]
        m[BASE] += 1.0
        _advance(int(m[BASE]), f, m)
        for j in range(BOTH if late else 0):
            m[SETTLED + j] = m[X + j]


@kernel
def _begin(tick: int, f: Any, m: Any) -> None:
    """Begin with the start at a tick."""
    for j in range(HISTORY + RECORD * (int(f[LATENCY]) + 2)):
        m[j] = 0.0
    for j in range(ESTIMATE):
        m[X + j] = f[START + j]
    _spread(m, f)
    for j in range(BOTH):
        m[SETTLED + j] = m[X + j]
    m[NOW] = m[BASE] = tick - 1
    m[ORIGIN] = m[LAST_ACCEPTED] = tick
    m[LAST_RESET] = -1.0


@kernel
def estimate_attitude(tick: int, measured: Any, f: Any, m: Any) -> None:
    """Take a tick: fill the newest state and covariance of the memory, from place X, and RATE.

    measured : (7,) that arrived at this tick, see `attitude_sensors`; of ticks that are
    missing, the rate before is held

    The star tracker may come late. The base is moved to the newest tick of which it has come; from
    there to this tick the motion is computed anew.
    """
    if m[ORIGIN] < 0.0:
        _begin(tick, f, m)
    m[TESTED] = 0.0
    for t in range(int(m[NOW]) + 1, tick + 1):
        new, old = _record(t, f), _record(t - 1, f)
        for i in range(3):
            value = m[old + i]
            if t == tick:
                value = measured[4 + i]
                value = saturate(value if value - value == 0.0 else 0.0, MAX_RATE_RAD_S)
            m[new + i] = value
        m[new + 7] = 0.0
        m[NOW] = t
        if t < tick:
            _settle(t, f, m)
    taken = tick - int(f[LATENCY])
    x, y, z, w = measured[0], measured[1], measured[2], measured[3]
    size = sqrt(x * x + y * y + z * z + w * w)
    if taken >= m[ORIGIN] and 0.5 < size < 2.0:
        at = _record(taken, f)
        m[at + 3], m[at + 4], m[at + 5], m[at + 6] = upright((x, y, z, w))
        m[at + 7] = 1.0
    _settle(tick, f, m)
    if f[LATENCY] > 0.0:
        for j in range(BOTH):
            m[X + j] = m[SETTLED + j]
        for t in range(int(m[BASE]) + 1, tick + 1):
            _advance(t, f, m)
    newest = _record(tick, f)
    for i in range(3):
        m[RATE + i] = m[newest + i] - m[X + 4 + i]


def attitude_filter_of(settings: AttitudeEstimator, sensors: AttitudeSensors, scenario: Any) -> Any:
    """Return the settings of the filter of a scenario, table f of the kernels."""
    p = attitude_estimator.attitude_filter_of(settings, sensors, scenario)
    return as_table(
        [
            *(p.orbit_sine, p.orbit_cosine, p.dt, p.turn_noise, p.shared_noise, p.bias_noise),
            *(p.gate, p.patience, p.latency, *np.ravel(p.axes), *p.variances, *p.start),
            *(p.angle_variance, p.bias_variance),
        ]
    )


def attitude_memory_of(f: Any) -> Any:
    """Return the memory of a filter that has not begun, table m of the kernels."""
    slots = int(f[LATENCY]) + 2
    return as_table([-1.0] * RATE + [0.0] * (HISTORY - RATE + RECORD * slots))
