# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A bound of the change of the commanded force in a tick. Kernels.

F is continuous, with slopes between the bounds of its cells. So its change over a tick is the sum
of slope times change of the state, the slopes taken somewhere on the segment between both states
(mean value theorem for Clarke's slopes). Where the segment is in a cell, the velocity and the force
at its start are those of the cell, but for what they change in a tick.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from rpo_training.engine.lanes import compiled
from rpo_training.proof.laws import TINY, cell_of
from rpo_training.proof.tables import Table


class Drift(NamedTuple):
    """How far a tick is from r' = v, v' = F / m; greatest sizes.

    bend_m_s : of (r+ - r) / dt - (v+ + v) / 2
    low, high : least and greatest acceleration beside the axis's own force [m/s^2]
    push : what one newton of the axis's own force adds to v in a second [m/s^2 / N]
    dt_s : length of a tick
    """

    bend_m_s: float
    low: float
    high: float
    push: float
    dt_s: float


class Strip(NamedTuple):
    """Where an axis may be: |r' - r| <= half_m [m], |v' - v - tilt (r' - r)| <= half [m/s]."""

    r: float
    v: float
    half_m: float
    tilt: float
    half: float


@compiled
def slew_of(table: Table, drift: Drift, strip: Strip, f0: float, f1: float) -> float:
    """Return a bound [N/s] of |F+ - F| / dt of an axis that starts in a strip.

    f0, f1 : least and greatest force of the start [N]
    """
    reach = abs(strip.tilt) * strip.half_m
    pull = max(abs(drift.low + drift.push * f0), abs(drift.low + drift.push * f1))
    pull = max(pull, abs(drift.high + drift.push * f0), abs(drift.high + drift.push * f1))
    change_v = drift.dt_s * pull
    fastest = abs(strip.v) + reach + strip.half + change_v
    change_r = drift.dt_s * (fastest + drift.bend_m_s)
    # The strip that holds the segments between both states, in normalised errors.
    e, w = -strip.r / table.position_m, -strip.v / table.velocity_m_s
    half_e = (strip.half_m + change_r) / table.position_m + TINY * (1.0 + abs(e))
    tilt = strip.tilt * table.position_m / table.velocity_m_s
    half_w = strip.half + change_v + abs(strip.tilt) * change_r
    half_w = half_w / table.velocity_m_s + TINY * (1.0 + abs(w) + abs(tilt) * (abs(e) + half_e))
    if not (abs(e) + half_e < table.e[-1] and abs(w) + abs(tilt) * half_e + half_w < table.w[-1]):
        return 1e300
    i0, i1 = cell_of(table.e, e - half_e), cell_of(table.e, e + half_e)
    steep_e, steep_w = 0.0, 0.0
    for i in range(i0, i1 + 1):
        w0, w1 = _column(table, i, e, w, half_e, tilt, half_w)
        for j in range(cell_of(table.w, w0), cell_of(table.w, w1) + 1):
            s = table.slopes[i, j]
            steep_e = max(steep_e, -s[0], s[1])
            steep_w = max(steep_w, -s[2], s[3])
    change_u = steep_e * change_r / table.position_m + steep_w * change_v / table.velocity_m_s
    change_e = (0.5 * change_v + drift.bend_m_s) / table.position_m
    most = 0.0
    for i in range(i0, i1 + 1):
        w0, w1 = _column(table, i, e, w, half_e, tilt, half_w)
        for j in range(cell_of(table.w, w0), cell_of(table.w, w1) + 1):
            low, high = max(w0, table.w[j]), min(w1, table.w[j + 1])
            rate = _rate(table, drift, i, j, low, high, f0, f1, change_u, change_e)
            most = max(most, rate)
    return (most * (1.0 + TINY) + 2.0 * table.slack / drift.dt_s) * table.force_n


@compiled
def _column(
    table: Table, i: int, e: float, w: float, half_e: float, tilt: float, half_w: float
) -> tuple[float, float]:
    """Return the least and greatest velocity error of a strip in row i of the table."""
    left, right = max(e - half_e, table.e[i]), min(e + half_e, table.e[i + 1])
    w0, w1 = w + tilt * (left - e), w + tilt * (right - e)
    return min(w0, w1) - half_w, max(w0, w1) + half_w


@compiled
def _rate(
    table: Table,
    drift: Drift,
    i: int,
    j: int,
    w0: float,
    w1: float,
    f0: float,
    f1: float,
    change_u: float,
    change_e: float,
) -> float:
    """Return a bound [1/s] of the rate of the output in a cell, from w0 to w1; 0: none is there."""
    bend = table.bend[i, j] + change_u + table.slack
    u00, u01, u10, u11 = (
        table.u[i, j],
        table.u[i, j + 1],
        table.u[i + 1, j],
        table.u[i + 1, j + 1],
    )
    force_low = max(f0, table.force_n * (min(min(u00, u01), min(u10, u11)) - bend))
    force_high = min(f1, table.force_n * (max(max(u00, u01), max(u10, u11)) + bend))
    if force_low > force_high:
        return 0.0
    s, ratio = table.slopes[i, j], table.velocity_m_s / table.position_m
    e_low, e_high = w0 * ratio - change_e, w1 * ratio + change_e
    w_low = -(drift.high + drift.push * force_high) / table.velocity_m_s
    w_high = -(drift.low + drift.push * force_low) / table.velocity_m_s
    rise = max(max(s[0] * e_low, s[0] * e_high), max(s[1] * e_low, s[1] * e_high))
    rise += max(max(s[2] * w_low, s[2] * w_high), max(s[3] * w_low, s[3] * w_high))
    fall = min(min(s[0] * e_low, s[0] * e_high), min(s[1] * e_low, s[1] * e_high))
    fall += min(min(s[2] * w_low, s[2] * w_high), min(s[3] * w_low, s[3] * w_high))
    return max(rise, -fall, 0.0)


@compiled
def drift_of(
    a: Any, b: Any, axis: int, dt: float, low: Any, high: Any, f0: Any, f1: Any, other_n: float
) -> Drift:
    """Return the drift of an axis over a tick whose first state is in a box.

    a (n, n), b (n, p) : of the tick; low, high (n,) : the box; f0, f1 (p,) : commands [N]
    other_n : greatest force beside the commands, of any axis
    """
    n = len(low)
    p = n // 2
    v = p + axis
    bend, least, most = 0.0, 0.0, 0.0
    for i in range(n):
        size = max(abs(low[i]), abs(high[i]))
        own = 1.0 if i == axis else 0.0
        mine = 1.0 if i == v else 0.0
        rest = (a[axis, i] - own) / dt - 0.5 * (a[v, i] + mine)
        bend += abs(rest) * size + 8.0 * TINY * size
        slope = (a[v, i] - mine) / dt
        least += min(slope * low[i], slope * high[i]) - 8.0 * TINY * size / dt
        most += max(slope * low[i], slope * high[i]) + 8.0 * TINY * size / dt
    for i in range(p):
        size = max(abs(f0[i]), abs(f1[i])) + other_n
        rest = b[axis, i] / dt - 0.5 * b[v, i]
        bend += abs(rest) * size + 8.0 * TINY * size
        slope = b[v, i] / dt
        outside = abs(slope) * other_n
        if i != axis:
            outside += abs(slope) * max(abs(f0[i]), abs(f1[i]))
        least -= outside
        most += outside
    return Drift(bend, least, most, b[v, axis] / dt, dt)
