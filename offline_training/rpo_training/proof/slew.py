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


@compiled
def slew_of(
    table: Table, drift: Drift, r0: float, r1: float, v0: float, v1: float, f0: float, f1: float
) -> float:
    """Return a bound [N/s] of |F+ - F| / dt of an axis.

    r0, r1 [m], v0, v1 [m/s] : box that holds both states; f0, f1 : force of the first [N]
    """
    e0, e1 = -r1 / table.position_m, -r0 / table.position_m
    w0, w1 = -v1 / table.velocity_m_s, -v0 / table.velocity_m_s
    e0, e1 = e0 - abs(e0) * TINY, e1 + abs(e1) * TINY
    w0, w1 = w0 - abs(w0) * TINY, w1 + abs(w1) * TINY
    if not (e0 > table.e[0] and e1 < table.e[-1] and w0 > table.w[0] and w1 < table.w[-1]):
        return 1e300
    i0, i1 = cell_of(table.e, e0), cell_of(table.e, e1)
    j0, j1 = cell_of(table.w, w0), cell_of(table.w, w1)
    steep_e, steep_w = 0.0, 0.0
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            s = table.slopes[i, j]
            steep_e = max(steep_e, -s[0], s[1])
            steep_w = max(steep_w, -s[2], s[3])
    pull = max(abs(drift.low + drift.push * f0), abs(drift.low + drift.push * f1))
    pull = max(pull, abs(drift.high + drift.push * f0), abs(drift.high + drift.push * f1))
    change_v = drift.dt_s * pull
    change_r = drift.dt_s * (max(abs(v0), abs(v1)) + drift.bend_m_s)
    change_u = steep_e * change_r / table.position_m + steep_w * change_v / table.velocity_m_s
    change_e = (0.5 * change_v + drift.bend_m_s) / table.position_m
    most = 0.0
    for i in range(i0, i1 + 1):
        for j in range(j0, j1 + 1):
            s, bend = table.slopes[i, j], table.bend[i, j] + change_u + table.slack
            low = (
                min(
                    min(table.u[i, j], table.u[i + 1, j]),
                    min(table.u[i, j + 1], table.u[i + 1, j + 1]),
                )
                - bend
            )
            high = (
                max(
                    max(table.u[i, j], table.u[i + 1, j]),
                    max(table.u[i, j + 1], table.u[i + 1, j + 1]),
                )
                + bend
            )
            force_low = max(f0, table.force_n * low)
            force_high = min(f1, table.force_n * high)
            if force_low > force_high:  # no state of the set starts here
                continue
            ratio = table.velocity_m_s / table.position_m
            e_low = max(w0, table.w[j]) * ratio - change_e
            e_high = min(w1, table.w[j + 1]) * ratio + change_e
            w_low = -(drift.high + drift.push * force_high) / table.velocity_m_s
            w_high = -(drift.low + drift.push * force_low) / table.velocity_m_s
            rise = max(max(s[0] * e_low, s[0] * e_high), max(s[1] * e_low, s[1] * e_high))
            rise += max(max(s[2] * w_low, s[2] * w_high), max(s[3] * w_low, s[3] * w_high))
            fall = min(min(s[0] * e_low, s[0] * e_high), min(s[1] * e_low, s[1] * e_high))
            fall += min(min(s[2] * w_low, s[2] * w_high), min(s[3] * w_low, s[3] * w_high))
            most = max(most, rise, -fall)
    return (most * (1.0 + TINY) + 2.0 * table.slack / drift.dt_s) * table.force_n


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
