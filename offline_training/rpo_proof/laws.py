# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Affine laws: F(r, v) within k_r r + k_v v + k_0 +- rho for every r, v of a box. Kernels."""

from __future__ import annotations

from typing import Any, NamedTuple

from rpo_core.kernels import infer, saturate
from rpo_montecarlo.engine.lanes import compiled
from rpo_proof.tables import Table

TINY = 2.0**-47
"""Relative rounding of a few operations, with room: 64 units of 2^-53."""

FEW = 36
"""Cells; in a box of no more, the bounds of the slopes are tried too."""


class Law(NamedTuple):
    """F in k_r r + k_v v + k_0 +- rho [N]; r [m], v [m/s]."""

    k_r: float
    k_v: float
    k_0: float
    rho: float


@compiled
def cell_of(edges: Any, x: float) -> int:
    """Return the cell that holds x: edges[i] <= x < edges[i+1], the last one included."""
    low, high = 0, len(edges) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if edges[middle] <= x:
            low = middle
        else:
            high = middle
    return low


@compiled
def bilinear(table: Table, i: int, j: int, e: float, w: float) -> float:
    """Interpolate the corners of a cell."""
    s = (e - table.e[i]) / (table.e[i + 1] - table.e[i])
    t = (w - table.w[j]) / (table.w[j + 1] - table.w[j])
    low = table.u[i, j] + s * (table.u[i + 1, j] - table.u[i, j])
    high = table.u[i, j + 1] + s * (table.u[i + 1, j + 1] - table.u[i, j + 1])
    return low + t * (high - low)


@compiled
def law_of(table: Table, r0: float, r1: float, v: float, tilt: float, half: float) -> Law:
    """Return a law of the strip r0 <= r <= r1 [m], |v' - v - tilt (r' - r)| <= half [m/s].

    r is the middle of r0 and r1; rho < 0: the strip leaves the table. Two laws are tried. One has
    the slopes between the corners of the strip, and what is left is the extreme of bilinear pieces,
    at their corners, plus their bends. The other has the middle slopes of the cells and the
    kernel's own value in the middle of the strip.
    """
    e0, e1 = -r1 / table.position_m, -r0 / table.position_m
    e, w = 0.5 * (e0 + e1), -v / table.velocity_m_s
    e0, e1 = e0 - abs(e0) * TINY, e1 + abs(e1) * TINY
    tilt = tilt * table.position_m / table.velocity_m_s
    reach = abs(tilt) * (e1 - e0)
    half = half / table.velocity_m_s + TINY * (abs(w) + reach + abs(tilt * e))
    half = half * (1.0 + TINY) + 1e-300
    most_w = abs(w) + half + 0.5 * reach
    if not (e0 > table.e[0] and e1 < table.e[-1] and most_w < table.w[-1]):
        return Law(0.0, 0.0, 0.0, -1.0)
    i0, i1 = cell_of(table.e, e0), cell_of(table.e, e1)
    w0, w1 = w + tilt * (e0 - e), w + tilt * (e1 - e)
    u00, u01 = value(table, i0, e0, w0 - half), value(table, i0, e0, w0 + half)
    u10, u11 = value(table, i1, e1, w1 - half), value(table, i1, e1, w1 + half)
    b = 0.25 * ((u01 - u00) + (u11 - u10)) / half if half > 1e-200 else 0.0
    a = 0.5 * ((u10 - u00) + (u11 - u01)) / (e1 - e0) - b * tilt if e1 > e0 else 0.0
    least, most = 1e300, -1e300
    a0, a1, b0, b1 = 1e300, -1e300, 1e300, -1e300
    cells = 0
    for i in range(i0, i1 + 1):
        left, right = max(e0, table.e[i]), min(e1, table.e[i + 1])
        w0, w1 = w + tilt * (left - e), w + tilt * (right - e)
        w0, w1 = min(w0, w1) - half, max(w0, w1) + half
        j0, j1 = cell_of(table.w, w0), cell_of(table.w, w1)
        cells += j1 - j0 + 1
        for j in range(j0, j1 + 1):
            low, high = max(w0, table.w[j]), min(w1, table.w[j + 1])
            bend = table.bend[i, j]
            for x in (left, right):
                for y in (low, high):
                    rest = bilinear(table, i, j, x, y) - a * x - b * y
                    least, most = min(least, rest - bend), max(most, rest + bend)
            a0, a1 = min(a0, table.slopes[i, j, 0]), max(a1, table.slopes[i, j, 1])
            b0, b1 = min(b0, table.slopes[i, j, 2]), max(b1, table.slopes[i, j, 3])
    c, rho = 0.5 * (least + most), 0.5 * (most - least)
    if cells <= FEW:
        other = 0.25 * ((a1 - a0) + abs(tilt) * (b1 - b0)) * (e1 - e0) + 0.5 * (b1 - b0) * half
        if other < rho:
            a, b, rho = 0.5 * (a0 + a1), 0.5 * (b0 + b1), other
            u = infer(saturate(e, 1.0), saturate(w, 1.0), table.fis)
            c = saturate(u, table.limit) - a * e - b * w
    return _physical(table, a, b, c, rho, max(abs(e0), abs(e1)), most_w)


@compiled
def value(table: Table, i: int, e: float, w: float) -> float:
    """Return the bilinear value at e, which is in row i, and w."""
    return bilinear(table, i, cell_of(table.w, w), e, w)


@compiled
def _physical(table: Table, a: float, b: float, c: float, rho: float, e: float, w: float) -> Law:
    """Return a law of errors as one of position and velocity; e, w : their greatest sizes."""
    room = table.slack + TINY * (1.0 + abs(a) * e + abs(b) * w + abs(c) + rho)
    return Law(
        -table.force_n * a / table.position_m,
        -table.force_n * b / table.velocity_m_s,
        table.force_n * c,
        table.force_n * (rho * (1.0 + TINY) + room + TINY * (abs(a) * e + abs(b) * w)),
    )
