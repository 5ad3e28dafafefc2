# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The control surface u = F(e, v) on many points, and enclosures of F and its slopes on boxes.

F is the inference in real arithmetic on the numbers of the file; the kernel computes it to within
`rounding`. Between the breakpoints of the membership functions a grade is affine in its error, so
its range on a box lies between its values at the two edges. A rule's strength is the lesser of
two grades, a word's the greatest of its rules, an output sample's the greatest of the clipped
words: minima and maxima of intervals, without rounding. The centroid of samples known to lie in
intervals is greatest when all samples right of some threshold are high and all others low.

Slopes are Clarke's generalised ones: where a minimum or a maximum may be attained by several, the
hull of the slopes of all. With D the area, du/de = sum over samples of (y - u) dm/de, over D.
"""

from __future__ import annotations

import itertools
from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.control.fuzzy import FuzzySystem, MembershipFunctions
from rpo_core.control.inference import LN, LP, SN, SP, Z
from rpo_core.kernels.arrays import Floats

UNIT_ROUNDOFF = 2.0**-53
_CHUNK = 1024  # boxes evaluated together; their arrays stay in the cache


class Boxes(NamedTuple):
    """Boxes of the input square, each (n,): position error [e_low, e_high], velocity error v.

    None may hold a breakpoint in its inside.
    """

    e_low: Floats
    e_high: Floats
    v_low: Floats
    v_high: Floats

    def where(self, chosen: NDArray[np.bool_] | NDArray[np.intp] | slice) -> Boxes:
        """Return some of the boxes."""
        return Boxes(*(edge[chosen] for edge in self))

    def quartered(self) -> Boxes:
        """Return four boxes for each."""
        e = self.e_low + (self.e_high - self.e_low) / 2
        v = self.v_low + (self.v_high - self.v_low) / 2
        return Boxes(
            np.concatenate([self.e_low, e, self.e_low, e]),
            np.concatenate([e, self.e_high, e, self.e_high]),
            np.concatenate([self.v_low, self.v_low, v, v]),
            np.concatenate([v, v, self.v_high, self.v_high]),
        )


class Enclosure(NamedTuple):
    """Bounds on a box, each (n,): of the output, and of its slopes in both errors."""

    low: Floats
    high: Floats
    e_slope_low: Floats
    e_slope_high: Floats
    v_slope_low: Floats
    v_slope_high: Floats


def rounding(system: FuzzySystem) -> float:
    """Return how far a computed output may be from F.

    Grades are right to 3 u, sums of n terms to n u / (1 - n u) of the sum of their sizes (Higham,
    *Accuracy and Stability of Numerical Algorithms*, 2002, section 3.1); |y| <= 1 and |F| <= 1.
    """
    terms = (system.samples + 16) * UNIT_ROUNDOFF
    return 4.0 * terms / (1.0 - terms)


def breakpoints(functions: MembershipFunctions) -> Floats:
    """Return the ascending points of [-1, 1] between which every grade is affine, ends included."""
    feet = np.array([0.0, 1.0, *astuple(functions)])
    return np.unique(np.concatenate([-feet, feet]))


def is_continuous(functions: MembershipFunctions) -> bool:
    """Whether no triangle has a vertical edge."""
    return functions.sp_left < functions.sp_centre < functions.sp_right


def divided(points: Floats, max_gap: float) -> Floats:
    """Return ascending points with enough equally spaced ones between that none is > `max_gap`."""
    parts = [
        np.linspace(a, b, int(np.ceil((b - a) / max_gap)) + 1)[:-1]
        for a, b in itertools.pairwise(points)
    ]
    return np.concatenate([*parts, points[-1:]])


def tensor(e: Floats, v: Floats) -> Boxes:
    """Return the boxes between ascending edges e (m+1,) and v (n+1,): m n, those of v[0] first."""
    columns, rows = len(e) - 1, len(v) - 1
    return Boxes(
        np.tile(e[:-1], rows),
        np.tile(e[1:], rows),
        np.repeat(v[:-1], columns),
        np.repeat(v[1:], columns),
    )


def values(system: FuzzySystem, e: Floats, v: Floats) -> Floats:
    """Return F (n,) at points (n,) of the square, to within `rounding`."""
    y, parts = _samples(system), []
    for first in range(0, len(e), _CHUNK):
        chosen = slice(first, first + _CHUNK)
        words = _strengths(system, Boxes(e[chosen], e[chosen], v[chosen], v[chosen]))
        samples = _aggregate(words.low, _output_grades(system), len(y))
        moment, area = samples @ y, samples.sum(axis=1)
        parts.append(np.divide(moment, area, out=np.zeros_like(area), where=area > 0.0))
    return np.concatenate(parts)


def enclose(system: FuzzySystem, boxes: Boxes) -> Enclosure:
    """Return the enclosure of the surface on each box."""
    count = len(boxes.e_low)
    parts = [
        _enclose(system, boxes.where(slice(first, first + _CHUNK)))
        for first in range(0, count, _CHUNK)
    ]
    return Enclosure(*(np.concatenate(part) for part in zip(*parts, strict=True)))


@dataclass(frozen=True)
class _Grades:
    """Grades (5, n) of one error on intervals, and their slopes (5, n)."""

    low: Floats
    high: Floats
    slope: Floats


@dataclass(frozen=True)
class _Words:
    """Strengths (5, n) of the output words on boxes, and the hulls of their slopes in e and v."""

    low: Floats
    high: Floats
    slopes: tuple[tuple[Floats, Floats], tuple[Floats, Floats]]


def _triangle(x: Floats, left: float, centre: float, right: float) -> Floats:
    """Return the kernel's `triangle` of many points, bit for bit."""
    with np.errstate(divide='ignore', invalid='ignore', over='ignore'):
        rising = np.where(x > left, (x - left) / (centre - left), 0.0)
        falling = np.where(x < right, (right - x) / (right - centre), 0.0)
    return np.where(x < centre, rising, np.where(x > centre, falling, 1.0))


def _slope(x: Floats, left: float, centre: float, right: float) -> Floats:
    rising = 1.0 / (centre - left) if centre > left else np.inf
    falling = -1.0 / (right - centre) if right > centre else -np.inf
    inside = np.where((x > centre) & (x < right), falling, 0.0)
    return np.where((x > left) & (x < centre), rising, inside)


def _grades(low: Floats, high: Floats, functions: MembershipFunctions) -> _Grades:
    f = functions
    middle = low + (high - low) / 2
    negative = middle < 0.0
    lows, highs, slopes = (np.zeros((5, len(low))) for _ in range(3))
    triangles = {
        (Z, Z): (-f.z_half_width, 0.0, f.z_half_width),
        (SN, SP): (f.sp_left, f.sp_centre, f.sp_right),
        (LN, LP): (f.lp_left, 1.0, 2.0),
    }
    for (left, right), feet in triangles.items():
        ends = _triangle(np.abs(low), *feet), _triangle(np.abs(high), *feet)
        for rows, grade in (
            (lows, np.minimum(*ends) * (1.0 - 8.0 * UNIT_ROUNDOFF)),
            (highs, np.maximum(*ends) * (1.0 + 8.0 * UNIT_ROUNDOFF)),
            (slopes, np.where(negative, -1.0, 1.0) * _slope(np.abs(middle), *feet)),
        ):
            rows[left] += np.where(negative, grade, 0.0)
            rows[right] += np.where(negative, 0.0, grade)
    return _Grades(lows, highs, slopes)


def _strengths(system: FuzzySystem, boxes: Boxes) -> _Words:
    e = _grades(boxes.e_low, boxes.e_high, system.position)
    v = _grades(boxes.v_low, boxes.v_high, system.velocity)
    shape = (5, len(boxes.e_low))
    low, high = np.zeros(shape), np.zeros(shape)
    cells = [(i, j, int(system.rules.codes[i, j])) for i in range(5) for j in range(5)]
    for i, j, word in cells:
        np.maximum(low[word], np.minimum(v.low[i], e.low[j]), out=low[word])
        np.maximum(high[word], np.minimum(v.high[i], e.high[j]), out=high[word])
    hulls = [(np.full(shape, np.inf), np.full(shape, -np.inf)) for _ in range(2)]
    for i, j, word in cells:
        strongest = np.minimum(v.high[i], e.high[j])
        active = (strongest >= low[word]) & (strongest > 0.0)
        by_e, by_v = e.low[j] <= v.high[i], v.low[i] <= e.high[j]  # which grade may be the lesser
        for hull, own, other, slope in zip(
            hulls, (by_e, by_v), (by_v, by_e), (e.slope[j], v.slope[i]), strict=True
        ):
            least = np.where(own, np.where(other, np.minimum(slope, 0.0), slope), 0.0)
            most = np.where(own, np.where(other, np.maximum(slope, 0.0), slope), 0.0)
            np.minimum(hull[0][word], least, out=hull[0][word], where=active)
            np.maximum(hull[1][word], most, out=hull[1][word], where=active)
    slopes = [
        (np.where(np.isposinf(least), 0.0, least), np.where(np.isneginf(most), 0.0, most))
        for least, most in hulls
    ]
    return _Words(low, high, (slopes[0], slopes[1]))


def _samples(system: FuzzySystem) -> Floats:
    half = np.asarray(system.tables.samples)
    return np.concatenate([-half[::-1], [0.0], half])


def _output_grades(system: FuzzySystem) -> list[tuple[int, slice, Floats]]:
    """Return (word, samples of its support, their grades) of the words that any sample sees."""
    z, sp, lp = (np.asarray(t) for t in (system.tables.z, system.tables.sp, system.tables.lp))
    half = len(z)
    table = np.zeros((5, 2 * half + 1))
    table[[SP, LP], half + 1 :] = sp, lp
    table[[SN, LN], :half] = sp[::-1], lp[::-1]
    table[Z] = np.concatenate([z[::-1], [1.0], z])
    words = []
    for word, grades in enumerate(table):
        support = np.flatnonzero(grades)
        if len(support):
            span = slice(int(support[0]), int(support[-1]) + 1)
            words.append((word, span, grades[span]))
    return words


def _aggregate(strengths: Floats, grades: list[tuple[int, slice, Floats]], samples: int) -> Floats:
    """Return the aggregated set (n, samples) of word strengths (5, n)."""
    aggregated = np.zeros((strengths.shape[1], samples))
    for word, span, grade in grades:
        part = aggregated[:, span]
        np.maximum(part, np.minimum(strengths[word][:, None], grade), out=part)
    return aggregated


def _enclose(system: FuzzySystem, boxes: Boxes) -> Enclosure:
    words, grades, y = _strengths(system, boxes), _output_grades(system), _samples(system)
    low = _aggregate(words.low, grades, len(y))
    high = _aggregate(words.high, grades, len(y))
    margin = rounding(system)
    u_low, u_high = _centroid_range(y, low, high)
    u_low, u_high = u_low - margin, u_high + margin
    areas = low.sum(axis=1) * (1.0 - margin), high.sum(axis=1) * (1.0 + margin)
    slopes: list[Floats] = []
    for hull in words.slopes:
        rates = _sample_slopes(words, hull, grades, low)
        slopes += _centroid_slope(y, (u_low, u_high), rates, areas, margin)
    return Enclosure(u_low, u_high, *slopes)


def _centroid_range(y: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Return the least and the greatest centroid (n,) of samples between `low`, `high` (n, N)."""
    zero = np.where(low.any(axis=1), np.nan, 0.0)  # perhaps no rule fires: the output is 0
    extremes = []
    for left, right, pick, worst in (
        (high, low, np.fmin, np.inf),
        (low, high, np.fmax, -np.inf),
    ):
        area, moment = _across(left, right), _across(left * y, right * y)
        centroid = np.divide(moment, area, out=np.full(area.shape, worst), where=area > 0.0)
        extremes.append(pick(pick.reduce(centroid, axis=1), zero))
    return extremes[0], extremes[1]


def _across(left: Floats, right: Floats) -> Floats:
    """Return (n, N+1): for each threshold, the sum of `left` before it and of `right` after it."""
    sums = np.zeros((left.shape[0], left.shape[1] + 1))
    np.cumsum(left, axis=1, out=sums[:, 1:])
    sums[:, :-1] += np.cumsum(right[:, ::-1], axis=1)[:, ::-1]
    return sums


def _sample_slopes(
    words: _Words,
    hull: tuple[Floats, Floats],
    grades: list[tuple[int, slice, Floats]],
    aggregated_low: Floats,
) -> tuple[Floats, Floats]:
    """Return the hulls (n, N) of the slopes of each sample of the aggregated set."""
    least = np.full(aggregated_low.shape, np.inf)
    most = np.full(aggregated_low.shape, -np.inf)
    for word, span, grade in grades:
        low, high = words.low[word][:, None], words.high[word][:, None]
        greatest = (np.minimum(high, grade) >= aggregated_low[:, span]) & (high > 0.0)
        moves, rests = low <= grade, high >= grade  # the word's own strength, or its clipped shape
        for total, slope, pick in (
            (least[:, span], hull[0][word][:, None], np.minimum),
            (most[:, span], hull[1][word][:, None], np.maximum),
        ):
            rate = np.where(moves, np.where(rests, pick(slope, 0.0), slope), 0.0)
            pick(total, rate, out=total, where=greatest)
    least[np.isposinf(least)] = 0.0
    most[np.isneginf(most)] = 0.0
    return least, most


def _centroid_slope(
    y: Floats,
    output: tuple[Floats, Floats],
    rates: tuple[Floats, Floats],
    areas: tuple[Floats, Floats],
    margin: float,
) -> tuple[Floats, Floats]:
    """Return bounds (n,) of sum over samples of (y - u) rate / area."""
    arms = y - output[1][:, None], y - output[0][:, None]
    least, most = np.full(rates[0].shape, np.inf), np.full(rates[0].shape, -np.inf)
    with np.errstate(invalid='ignore'):
        for arm in arms:
            for rate in rates:
                product = arm * rate
                np.minimum(least, product, out=least)
                np.maximum(most, product, out=most)
        slack = margin * np.maximum(-least, most).sum(axis=1)
        low, high = least.sum(axis=1) - slack, most.sum(axis=1) + slack
    with np.errstate(divide='ignore', invalid='ignore'):
        low = low / np.where(low < 0.0, *areas)
        high = high / np.where(high > 0.0, *areas)
    # 0 / 0, where perhaps no rule fires, tells nothing.
    return np.nan_to_num(low, nan=-np.inf, neginf=-np.inf, posinf=np.inf), np.nan_to_num(
        high, nan=np.inf, neginf=-np.inf, posinf=np.inf
    )
