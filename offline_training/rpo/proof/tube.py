# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A tube: zonotopes that hold every state of the closed loop, tick by tick. Kernels.

A set is a zonotope {c + G xi + delta : |xi_j| <= 1, |delta_i| <= d_i}. State: the p positions [m],
then the p velocities [m/s] of axes that move together: x and y, or z alone. In a tick each axis
gets a law of its box, so the state follows x' = A x + B (K x + k_0 + rho xi), which a zonotope
follows exactly.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rpo.proof.enclosure import Table, law_of
from rpo.proof.slew import Strip, coupled_drift, drift_of, slew_by_parts, slew_of
from rpo_core.kernels.jit import unlocked

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


class Zonotope(NamedTuple):
    """Centre c (n,), generators g (n, capacity), box d (n,): changed in place as it moves."""

    c: Any
    g: Any
    d: Any


@unlocked
def box_of(z: Zonotope, m: int, low: Any, high: Any) -> None:
    """Fill the box of a set whose first m generators count, rounded outwards."""
    for i in range(len(z.c)):
        radius = z.d[i]
        for j in range(m):
            radius += abs(z.g[i, j])
        radius = radius * (1.0 + ROUND) + abs(z.c[i]) * ROUND
        low[i], high[i] = z.c[i] - radius, z.c[i] + radius


@unlocked
def strip_of(z: Zonotope, m: int, r: int, v: int) -> tuple[float, float]:
    """Return tilt [1/s] and half-width [m/s] of a strip in r, v that holds the set.

    Every v - tilt r of the set is within the half-width of that of its middle; the tilt is the one
    of least squares.
    """
    _, g, d = z
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


@unlocked
def reduce(z: Zonotope, fixed: int, m: int) -> int:
    """Keep the first `fixed` and the larger half of the other generators, box the small ones."""
    _, g, d = z
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


@unlocked
def tidy(tick: int, z: Zonotope, fixed: int, m: int) -> int:
    """Make generators of the box of rounding, now and then, and a box of small generators."""
    _, g, d = z
    n = len(d)
    if tick % BATCH == BATCH - 1:
        for i in range(n):
            for k in range(n):
                g[k, m + i] = 0.0
            g[i, m + i] = d[i]
            d[i] = 0.0
        m += n
    if m > MOST:
        m = reduce(z, fixed, m)
    return m


@unlocked
def is_inside(omega: InvariantSet, z: Zonotope, m: int, low: Any, high: Any) -> bool:
    """Whether a set is inside the invariant set, on every axis."""
    c, g, d = z
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


@unlocked
def weigh(g: Any, fixed: int, weights: Any) -> None:
    """Add the sizes of the first generators."""
    n = len(g)
    for j in range(min(fixed, len(weights))):
        for i in range(n):
            weights[j] += abs(g[i, j]) * (1.0 if 2 * i < n else WORTH_S)


class Motion(NamedTuple):
    """What moves a set.

    a : (n, n), b : (n, p), of x' = a x + b f; dt : length of a tick [s]
    constant : (N, p) known force [N] at each tick
    carried : (N, q, p) force [N] of each of the first q generators at each tick
    mass : share by which 1/m may differ; generator `q` - 1 carries it, if > 0
    any_n : force per axis [N] that may change at every tick
    coupling, coupling_half : (N, n) what axes outside the set add to the state at each tick: middle
        and half-width
    """

    a: Any
    b: Any
    dt: float
    constant: Any
    carried: Any
    mass: float
    any_n: float
    coupling: Any
    coupling_half: Any


class Trace(NamedTuple):
    """What a tube was, filled as it is computed; ticks 0..N, forces 0..N-1.

    low, high : (N+1, n) box of the states
    force_low, force_high : (N, p) commanded force [N]
    slew : (N, p) bound of the change of the command until the next tick [N/s]
    laws : (N, p, 6) k_r, k_v, k_0, rho; tilt and half-width of the strip that they hold on
    weights : (j,) sizes of the first generators, summed over the ticks
    """

    low: Any
    high: Any
    force_low: Any
    force_high: Any
    slew: Any
    laws: Any
    weights: Any

    @classmethod
    def empty(cls, ticks: int, n: int, carried: int) -> Trace:
        """Return an empty trace of n states, and of so many generators that forces have."""
        p = n // 2
        return cls(
            np.zeros((ticks + 1, n)),
            np.zeros((ticks + 1, n)),
            np.zeros((ticks, p)),
            np.zeros((ticks, p)),
            np.full((ticks, p), np.inf),
            np.zeros((ticks, p, 6)),
            np.zeros(n + carried),
        )


@unlocked
def step(
    table: Table, motion: Motion, tick: int, z: Zonotope, m: int, trace: Trace, row: int
) -> int:
    """Move a set by one tick; return the number of its generators, -1 if a law is missing.

    row : of the trace; it has the box of the set, laws and forces are filled
    """
    c, g, d = z
    low, high, laws = trace.low[row], trace.high[row], trace.laws[row]
    n = len(c)
    p = n // 2
    q = motion.carried.shape[1]
    rho = np.empty(p)
    middle = np.empty(p)
    closed = motion.a.copy()
    size = np.zeros(n)
    for i in range(p):
        tilt, half = strip_of(z, m, i, p + i)
        half += ROUND * abs(c[p + i])
        law = law_of(table, low[i], high[i], c[p + i], tilt, half)
        laws[i, 4], laws[i, 5] = tilt, half
        if law.rho < 0.0:
            return -1
        laws[i, 0], laws[i, 1], laws[i, 2], laws[i, 3] = law.k_r, law.k_v, law.k_0, law.rho
        command = law.k_0 + law.k_r * c[i] + law.k_v * c[p + i]
        spread = law.rho + abs(law.k_r) * d[i] + abs(law.k_v) * d[p + i]
        for j in range(m):
            spread += abs(law.k_r * g[i, j] + law.k_v * g[p + i, j])
        largest = abs(law.k_0) + abs(law.k_r) * max(abs(low[i]), abs(high[i]))
        largest += abs(law.k_v) * max(abs(low[p + i]), abs(high[p + i]))
        spread += ROUND * (largest + spread)
        limit = table.limit * table.force_n
        trace.force_low[row, i] = max(command - spread, -limit)
        trace.force_high[row, i] = min(command + spread, limit)
        middle[i] = motion.constant[tick, i]
        rho[i] = law.rho + motion.any_n
        if motion.mass > 0.0:
            for j in range(q):
                spread += abs(motion.carried[tick, j, i])
            rho[i] += motion.mass * (spread + motion.any_n)
        for k in range(n):
            closed[k, i] += motion.b[k, i] * law.k_r
            closed[k, p + i] += motion.b[k, i] * law.k_v
            size[k] += abs(motion.b[k, i]) * (largest + abs(middle[i]) + rho[i])
        middle[i] += law.k_0
        if motion.mass > 0.0:  # what the uncertain mass does to the force of the middle
            pull = motion.mass * (command + motion.constant[tick, i])
            for k in range(n):
                size[k] += abs(motion.b[k, i] * pull)
    for k in range(n):
        for i in range(n):
            size[k] += abs(motion.a[k, i]) * max(abs(low[i]), abs(high[i]))
    _move(motion, tick, z, m, closed, middle, laws, size)
    for i in range(p):
        for k in range(n):
            g[k, m + i] = motion.b[k, i] * rho[i]
    return m + p


@unlocked
def _move(
    motion: Motion, tick: int, z: Zonotope, m: int, closed: Any, middle: Any, laws: Any, size: Any
) -> None:
    """Move centre, generators and the box of rounding of a set."""
    c, g, d = z
    n = len(c)
    p = n // 2
    q = motion.carried.shape[1]
    pull = np.zeros(p)
    for i in range(p):
        pull[i] = motion.mass * (middle[i] + laws[i, 0] * c[i] + laws[i, 1] * c[p + i])
    new = np.empty(n)
    for k in range(n):
        total, wide = 0.0, 0.0
        for i in range(n):
            total += closed[k, i] * c[i]
            wide += abs(closed[k, i]) * d[i]
        for i in range(p):
            total += motion.b[k, i] * middle[i]
            for j in range(q):
                size[k] += abs(motion.b[k, i] * motion.carried[tick, j, i])
        new[k] = total + motion.coupling[tick, k]
        far = abs(motion.coupling[tick, k]) + motion.coupling_half[tick, k]
        size[k] = wide + motion.coupling_half[tick, k] + ROUND * (size[k] + wide + far)
    for k in range(n):
        c[k], d[k] = new[k], size[k]
    for j in range(m):
        for k in range(n):
            total = 0.0
            for i in range(n):
                total += closed[k, i] * g[i, j]
            if j < q:
                for i in range(p):
                    total += motion.b[k, i] * motion.carried[tick, j, i]
            new[k] = total
        for k in range(n):
            g[k, j] = new[k]
    if motion.mass > 0.0:
        for k in range(n):
            for i in range(p):
                g[k, q - 1] += motion.b[k, i] * pull[i]


@unlocked
def fly(
    table: Table,
    motion: Motion,
    z: Zonotope,
    m: int,
    omega: InvariantSet,
    until: int,
    widest: Any,
    most_m: float,
    trace: Trace,
) -> tuple[int, int, int]:
    """Move a set; return the last tick of the trace, that of entering omega, its generators.

    omega, until : the flight ends inside it, but not before tick `until`; -1 where it never is
    widest : (n,) half-widths at which it is given up; most_m : distance, from tick `until` on
    """
    last, fixed = len(trace.laws), m
    resting = -1
    trace.weights[:] = 0.0
    for tick in range(last + 1):
        low, high = trace.low[tick], trace.high[tick]
        box_of(z, m, low, high)
        weigh(z.g, fixed, trace.weights)
        for i in range(len(z.c)):
            if not high[i] - low[i] <= 2.0 * widest[i]:
                return tick, -1, m
            if tick >= until and 2 * i < len(z.c) and max(-low[i], high[i]) > most_m:
                return tick, -1, m
        if tick > 0 and resting < 0 and is_inside(omega, z, m, low, high):
            resting = tick
        if tick == last or (tick >= until and resting >= 0):
            return tick, resting, m
        m = step(table, motion, tick, z, m, trace, tick)
        if m < 0:
            return tick, -1, m
        m = tidy(tick, z, fixed, m)
    return last, resting, m


@unlocked
def fill_slew(table: Table, motion: Motion, trace: Trace, last: int, limit_n_s: float) -> None:
    """Fill the bounds of slew of a tube that lasts until a tick.

    limit_n_s : what is asked for; a bound that exceeds it is made sharper, until that fails
    """
    worst = 0.0
    for tick in range(last):
        worst = max(worst, _slew(table, motion, tick, trace, worst, limit_n_s))


@unlocked
def _slew(
    table: Table, motion: Motion, tick: int, trace: Trace, worst: float, limit: float
) -> float:
    """Fill the bound of slew from a tick to the next; return the greatest of the axes.

    worst : of earlier ticks; one that is no greater need not be sharp
    """
    low, high, p = trace.low[tick], trace.high[tick], trace.slew.shape[1]
    f0, f1 = trace.force_low[tick], trace.force_high[tick]
    other = 0.0
    for i in range(p):
        total = motion.any_n
        for j in range(motion.carried.shape[1]):
            total += abs(motion.carried[tick, j, i])
        own_force = max(abs(f0[i]), abs(f1[i])) + abs(motion.constant[tick, i])
        other = max(other, total + motion.mass * (total + own_force))
    enough = worst
    for i in range(p):
        drift = drift_of(motion.a, motion.b, i, motion.dt, low, high, f0, f1, other)
        far, fast = motion.coupling[tick, i], motion.coupling[tick, p + i]
        for j in range(p):
            far += motion.b[i, j] * motion.constant[tick, j]
            fast += motion.b[p + i, j] * motion.constant[tick, j]
        drift = coupled_drift(
            drift, far, motion.coupling_half[tick, i], fast, motion.coupling_half[tick, p + i]
        )
        strip = Strip(
            0.5 * (low[i] + high[i]),
            0.5 * (low[p + i] + high[p + i]),
            0.5 * (high[i] - low[i]) * (1.0 + ROUND),
            trace.laws[tick, i, 4],
            trace.laws[tick, i, 5],
        )
        bound = slew_of(table, drift, strip, f0[i], f1[i], enough)
        if bound > limit >= worst:
            bound = slew_by_parts(table, drift, strip, f0[i], f1[i], limit)
        trace.slew[tick, i] = bound
        worst = max(worst, bound)
    return worst
