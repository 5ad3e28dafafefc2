# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A bound of the change of the commanded force in a tick. Kernels.

F is continuous, with slopes between the bounds of its cells. So its change over a tick is the sum
of slope times change of the state, the slopes taken somewhere on the segment between both states
(mean value theorem for Clarke's slopes). Where the segment is in a cell, the velocity and the force
at its start are those of the cell, but for what they change in a tick.

Let g(x) be the force at the share x of the segment, and C a bound of its change. For a rise only
the x matter at which g(x) >= g(0): after the last x with g(x) = g(0) it rises from there to the
end. At x the force of the start lags by 0 <= g(x) - g(0) <= x C. In each cell the rate is at most a
maximum of affine functions of this lag, so the greatest of all cells is convex in x, and its mean
over the segment is at most that of its values at lag 0 and at lag C. Where g(0) is known to be at
least f0, its least value max(f0, g(x) - x C) is replaced by the one of the two that is greater at
x = 1/2. A fall is the same with signs changed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rpo.proof.enclosure import TINY, Table, cell_of, law_of
from rpo_core.kernels.jit import unlocked

MOST_PARTS = 400
"""Parts of a strip that are looked at, at most."""

SMALLEST = 2.0**-14
"""Size of a part in errors; one that is smaller, and too fast, ends the search."""


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


class Path(NamedTuple):
    """A strip in errors: |e' - e| <= half_e, |w' - w - tilt (e' - e)| <= half_w."""

    e: float
    w: float
    half_e: float
    tilt: float
    half_w: float


class Reach(NamedTuple):
    """What is known of the first state of a tick.

    f0, f1 : least and greatest force [N]
    change_u, change_e : greatest change of the output in the tick, and of the position error's rate
    """

    f0: float
    f1: float
    change_u: float
    change_e: float


@unlocked
def slew_of(table: Table, drift: Drift, strip: Strip, f0: float, f1: float, enough: float) -> float:
    """Return a bound [N/s] of |F+ - F| / dt of an axis that starts in a strip.

    f0, f1 : least and greatest force of the start [N]
    enough : a bound that is no greater is not made sharper [N/s]
    """
    tilted = abs(strip.tilt) * strip.half_m
    pull = max(abs(drift.low + drift.push * f0), abs(drift.low + drift.push * f1))
    pull = max(pull, abs(drift.high + drift.push * f0), abs(drift.high + drift.push * f1))
    change_v = drift.dt_s * pull
    fastest = abs(strip.v) + tilted + strip.half + change_v
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
    path = Path(e, w, half_e, tilt, half_w)
    largest_e, largest_w = 0.0, 0.0
    for i in range(i0, i1 + 1):
        w0, w1 = _column(path, table.e[i], table.e[i + 1])
        for j in range(cell_of(table.w, w0), cell_of(table.w, w1) + 1):
            s = table.slopes[i, j]
            largest_e = max(largest_e, -s[0], s[1])
            largest_w = max(largest_w, -s[2], s[3])
    change_u = largest_e * change_r / table.position_m + largest_w * change_v / table.velocity_m_s
    quick = (change_u * (1.0 + TINY) + 2.0 * table.slack) / drift.dt_s * table.force_n
    if quick <= enough:
        return quick
    reach = Reach(f0, f1, change_u, (0.5 * change_v + drift.bend_m_s) / table.position_m)
    rate = 0.5 * _fastest(table, drift, path, reach, 0.0)
    rate += 0.5 * _fastest(table, drift, path, reach, 1.0)
    return (rate * (1.0 + TINY) + 2.0 * table.slack / drift.dt_s) * table.force_n


@unlocked
def _column(path: Path, left: float, right: float) -> tuple[float, float]:
    """Return the least and greatest velocity error of a path between two position errors."""
    left, right = max(path.e - path.half_e, left), min(path.e + path.half_e, right)
    w0, w1 = path.w + path.tilt * (left - path.e), path.w + path.tilt * (right - path.e)
    return min(w0, w1) - path.half_w, max(w0, w1) + path.half_w


@unlocked
def _range(table: Table, i: int, j: int) -> tuple[float, float]:
    """Return the least and the greatest output in a cell."""
    bend = table.bend[i, j] + table.slack
    u00, u01 = table.u[i, j], table.u[i, j + 1]
    u10, u11 = table.u[i + 1, j], table.u[i + 1, j + 1]
    low, high = min(min(u00, u01), min(u10, u11)), max(max(u00, u01), max(u10, u11))
    return low - bend, high + bend


@unlocked
def _fastest(table: Table, drift: Drift, path: Path, reach: Reach, lag: float) -> float:
    """Return a bound [1/s] of the rate of the output in all cells of a path."""
    fastest = 0.0
    i0, i1 = cell_of(table.e, path.e - path.half_e), cell_of(table.e, path.e + path.half_e)
    for i in range(i0, i1 + 1):
        w0, w1 = _column(path, table.e[i], table.e[i + 1])
        for j in range(cell_of(table.w, w0), cell_of(table.w, w1) + 1):
            low, high = max(w0, table.w[j]), min(w1, table.w[j + 1])
            least, greatest = _range(table, i, j)
            s = table.slopes[i, j]
            rate = _rate(table, drift, s, low, high, least, greatest, reach, lag)
            if rate > fastest and table.division[i, j] >= 0:
                rate = _rate_of_parts(table, drift, i, j, path, reach, lag)
            fastest = max(fastest, rate)
    return fastest


@unlocked
def _rate_of_parts(
    table: Table, drift: Drift, i: int, j: int, path: Path, reach: Reach, lag: float
) -> float:
    """Return a bound [1/s] of the rate of the output in a cell that is divided, part by part."""
    number, fastest = table.division[i, j], 0.0
    parts = table.part_slopes.shape[1]
    wide, tall = table.e[i + 1] - table.e[i], table.w[j + 1] - table.w[j]
    for k in range(parts):
        left = table.e[i] + wide * (k / parts) - TINY * abs(table.e[i])
        right = table.e[i] + wide * ((k + 1) / parts) + TINY * abs(table.e[i + 1])
        if right < path.e - path.half_e or left > path.e + path.half_e:
            continue
        w0, w1 = _column(path, left, right)
        for n in range(parts):
            low = max(w0, table.w[j] + tall * (n / parts) - TINY * abs(table.w[j]))
            high = min(w1, table.w[j] + tall * ((n + 1) / parts) + TINY * abs(table.w[j + 1]))
            if low <= high:
                s, u = table.part_slopes[number, k, n], table.part_range[number, k, n]
                fastest = max(fastest, _rate(table, drift, s, low, high, u[0], u[1], reach, lag))
    return fastest


@unlocked
def _rate(
    table: Table,
    drift: Drift,
    s: Any,
    w0: float,
    w1: float,
    least: float,
    greatest: float,
    reach: Reach,
    lag: float,
) -> float:
    """Return a bound [1/s] of the rate of an output from least to greatest, 0: none is there.

    s : slopes; w0, w1 : ends of the velocity error; lag : 0 or 1, see the top of the module
    """
    change = table.force_n * reach.change_u
    low = table.force_n * (least - table.slack)
    high = table.force_n * (greatest + table.slack)
    if max(reach.f0, low - change) > min(reach.f1, high + change):
        return 0.0
    lagging_low = reach.f0 if reach.f0 >= low - 0.5 * change else low - lag * change
    lagging_high = reach.f1 if reach.f1 <= high + 0.5 * change else high + lag * change
    ratio = table.velocity_m_s / table.position_m
    e_low, e_high = w0 * ratio - reach.change_e, w1 * ratio + reach.change_e
    by_e = max(max(s[0] * e_low, s[0] * e_high), max(s[1] * e_low, s[1] * e_high))
    rise = by_e + _pulled(table, drift, s, lagging_low, high)
    by_e = max(max(-s[0] * e_low, -s[0] * e_high), max(-s[1] * e_low, -s[1] * e_high))
    return max(rise, by_e + _pulled(table, drift, (0.0, 0.0, -s[2], -s[3]), low, lagging_high), 0.0)


@unlocked
def _pulled(table: Table, drift: Drift, s: Any, f0: float, f1: float) -> float:
    """Return the greatest of slope times rate of the velocity error; f0, f1 [N]: of the force."""
    slow = -(drift.high + drift.push * f1) / table.velocity_m_s
    fast = -(drift.low + drift.push * f0) / table.velocity_m_s
    return max(max(s[2] * slow, s[2] * fast), max(s[3] * slow, s[3] * fast))


@unlocked
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
    bend, accel_low, accel_high = 0.0, 0.0, 0.0
    for i in range(n):
        size = max(abs(low[i]), abs(high[i]))
        unit = 1.0 if i == axis else 0.0
        mine = 1.0 if i == v else 0.0
        rest = (a[axis, i] - unit) / dt - 0.5 * (a[v, i] + mine)
        bend += abs(rest) * size + 8.0 * TINY * size
        slope = (a[v, i] - mine) / dt
        accel_low += min(slope * low[i], slope * high[i]) - 8.0 * TINY * size / dt
        accel_high += max(slope * low[i], slope * high[i]) + 8.0 * TINY * size / dt
    for i in range(p):
        size = max(abs(f0[i]), abs(f1[i])) + other_n
        rest = b[axis, i] / dt - 0.5 * b[v, i]
        bend += abs(rest) * size + 8.0 * TINY * size
        slope = b[v, i] / dt
        # Also for the roundings of other_n, and of the axis's own push.
        outside = abs(slope) * (other_n + 8.0 * TINY * size)
        if i != axis:
            outside += abs(slope) * max(abs(f0[i]), abs(f1[i]))
        accel_low -= outside
        accel_high += outside
    return Drift(bend, accel_low, accel_high, b[v, axis] / dt, dt)


@unlocked
def coupled_drift(drift: Drift, r: float, half_m: float, v: float, half: float) -> Drift:
    """Return a drift to which other axes add r +- half_m [m] and v +- half [m/s] in the tick."""
    bend = (abs(r) + half_m) / drift.dt_s + 0.5 * (abs(v) + half)
    room = TINY * (abs(v) + half)
    return Drift(
        drift.bend_m_s + bend * (1.0 + TINY),
        drift.low + (v - half - room) / drift.dt_s,
        drift.high + (v + half + room) / drift.dt_s,
        drift.push,
        drift.dt_s,
    )


@unlocked
def slew_by_parts(
    table: Table, drift: Drift, strip: Strip, f0: float, f1: float, enough: float
) -> float:
    """Return a bound [N/s] of the slew of an axis that starts in a strip; see `slew_of`.

    A part whose bound exceeds `enough` is halved, and gets a law of its own, until one is too
    small. The parts of |v' - v - tilt (r' - r)| <= half are strips of the same tilt.
    """
    todo = np.empty((MOST_PARTS, 5))
    todo[0] = strip.r, strip.v, strip.half_m, strip.half, 1e300
    left, looked, worst = 1, 0, 0.0
    while left > 0:
        left -= 1
        r, v, half_m, half, whole = todo[left]
        bound = _bound_of_part(table, drift, Strip(r, v, half_m, strip.tilt, half), f0, f1, enough)
        bound = min(bound, whole)
        looked += 1
        by_r = half_m * (1.0 / table.position_m + abs(strip.tilt) / table.velocity_m_s)
        by_v = half / table.velocity_m_s
        if bound <= enough or looked + left + 2 > MOST_PARTS or by_r + by_v < SMALLEST:
            worst = max(worst, bound)
            if worst > enough:  # sharper parts beside it do not help
                for k in range(left):
                    worst = max(worst, todo[k, 4])
                return worst
            continue
        for side in (-1.0, 1.0):
            part = half_of(Strip(r, v, half_m, strip.tilt, half), by_r > by_v, side)
            todo[left] = part.r, part.v, part.half_m, part.half, bound
            left += 1
    return worst


@unlocked
def half_of(part: Strip, along: bool, side: float) -> Strip:
    """Return a half of a part: on a side, -1 or 1, along r or v; both overlap by their rounding."""
    r, v, half_m, tilt, half = part
    first, second = (0.5, 0.0) if along else (0.0, 0.5)
    away = side * first * half_m
    return Strip(
        r + away,
        v + tilt * away + side * second * half,
        (1.0 - first) * half_m + TINY * (abs(r) + half_m),
        tilt,
        (1.0 - second) * half + TINY * (abs(v) + half + abs(tilt) * (abs(r) + half_m)),
    )


@unlocked
def _bound_of_part(
    table: Table, drift: Drift, part: Strip, f0: float, f1: float, enough: float
) -> float:
    """Return a bound of the slew of a part, whose force is between f0, f1 and what its law says."""
    low, high = part.r - part.half_m, part.r + part.half_m
    law = law_of(table, low, high, part.v, part.tilt, part.half)
    if law.rho < 0.0:
        return 1e300
    middle = law.k_0 + law.k_r * part.r + law.k_v * part.v
    spread = law.rho + abs(law.k_r + law.k_v * part.tilt) * part.half_m + abs(law.k_v) * part.half
    size = abs(law.k_0) + abs(law.k_r) * (abs(part.r) + part.half_m)
    size += abs(law.k_v) * (abs(part.v) + part.half + abs(part.tilt) * part.half_m)
    spread += TINY * (spread + size)
    low, high = max(f0, middle - spread), min(f1, middle + spread)
    if low > high:
        return 0.0  # no state of the tube is here
    return slew_of(table, drift, part, low, high, enough)
