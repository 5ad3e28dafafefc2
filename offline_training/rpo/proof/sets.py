# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Zonotopes {c + G xi + delta : |xi_j| <= 1, |delta_i| <= d_i} of an axis or two. Kernels.

A state is the p positions [m], then the p velocities [m/s].
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rpo.engine.lanes import compiled

ROUND = 2.0**-44
"""Share of the sizes of all terms by which a tick is widened, for what rounding can do.

A sum of at most 200 products, each of which has at most 8 roundings, is wrong by at most
208 x 2^-53 of the sum of the sizes of its terms, less than half of this (Higham 2002, section 3.1).
The other half holds the flight's own arithmetic: sums of five products, of coefficients that are
right to 8 x 2^-53.
"""

MOST = 180
"""Generators, at which the small ones become a box."""

BATCH = 16
"""Ticks whose rounding is fixed as a box, before it becomes generators."""

WORTH_S = 20.0
"""Weight of a velocity [m/s] beside a position [m], where generators are compared."""


class InvariantSet(NamedTuple):
    """A set that the closed loop maps into itself: |r| <= radius_m, |v + rate r| <= speed_m_s."""

    radius_m: float
    rate: float
    speed_m_s: float


@compiled
def box_of(c: Any, g: Any, d: Any, m: int, low: Any, high: Any) -> None:
    """Fill the box of a set whose first m generators count, rounded outwards."""
    for i in range(len(c)):
        radius = d[i]
        for j in range(m):
            radius += abs(g[i, j])
        radius = radius * (1.0 + ROUND) + abs(c[i]) * ROUND
        low[i], high[i] = c[i] - radius, c[i] + radius


@compiled
def strip_of(g: Any, d: Any, m: int, r: int, v: int) -> tuple[float, float]:
    """Return tilt [1/s] and half-width [m/s] of a strip in r, v that holds the set.

    Every v - tilt r of the set is within the half-width of that of its middle; the tilt is the one
    of least squares.
    """
    product, square = 0.0, 1e-300
    for j in range(m):
        product, square = product + g[r, j] * g[v, j], square + g[r, j] * g[r, j]
    tilt = product / square
    half = d[v] + abs(tilt) * d[r]
    size = half
    for j in range(m):
        half += abs(g[v, j] - tilt * g[r, j])
        size += abs(g[v, j]) + abs(tilt * g[r, j])
    return tilt, half + ROUND * size


@compiled
def reduce(g: Any, d: Any, fixed: int, m: int) -> int:
    """Keep the first `fixed` and the larger half of the other generators, box the small ones."""
    n = len(d)
    sizes = np.empty(m - fixed)
    for j in range(fixed, m):
        total, largest = 0.0, 0.0
        for i in range(n):
            size = abs(g[i, j]) * (1.0 if 2 * i < n else WORTH_S)
            total, largest = total + size, max(largest, size)
        sizes[j - fixed] = total - largest
    small = np.sort(sizes)[(m - fixed) // 2]
    box = np.zeros(n)
    count = fixed
    for j in range(fixed, m):
        if sizes[j - fixed] <= small:
            for i in range(n):
                box[i] += abs(g[i, j])
        else:
            for i in range(n):
                g[i, count] = g[i, j]
            count += 1
    for i in range(n):
        for k in range(n):
            g[k, count + i] = 0.0
        g[i, count + i] = (box[i] + d[i]) * (1.0 + ROUND)
        d[i] = 0.0
    return count + n


@compiled
def tidy(tick: int, g: Any, d: Any, fixed: int, m: int) -> int:
    """Make generators of the box of rounding, now and then, and a box of small generators."""
    n = len(d)
    if tick % BATCH == BATCH - 1:
        for i in range(n):
            for k in range(n):
                g[k, m + i] = 0.0
            g[i, m + i] = d[i]
            d[i] = 0.0
        m += n
    if m > MOST:
        m = reduce(g, d, fixed, m)
    return m


@compiled
def is_inside(omega: InvariantSet, c: Any, g: Any, d: Any, m: int, low: Any, high: Any) -> bool:
    """Whether a set is inside the invariant set, on every axis."""
    p = len(c) // 2
    for i in range(p):
        if max(-low[i], high[i]) > omega.radius_m:
            return False
        spread = d[p + i] + omega.rate * d[i]
        size = spread + abs(c[p + i]) + abs(omega.rate * c[i])
        for j in range(m):
            spread += abs(g[p + i, j] + omega.rate * g[i, j])
            size += abs(g[p + i, j]) + abs(omega.rate * g[i, j])
        if abs(c[p + i] + omega.rate * c[i]) + spread + ROUND * size > omega.speed_m_s:
            return False
    return True


@compiled
def weigh(g: Any, fixed: int, weights: Any) -> None:
    """Add the sizes of the first generators."""
    n = len(g)
    for j in range(min(fixed, len(weights))):
        for i in range(n):
            weights[j] += abs(g[i, j]) * (1.0 if 2 * i < n else WORTH_S)
