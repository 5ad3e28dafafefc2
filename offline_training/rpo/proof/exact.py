# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The checker's own arithmetic: rational numbers, in which nothing is rounded.

The inference is written anew from the controller file, without the kernels or their tables.
"""

from __future__ import annotations

import itertools
from fractions import Fraction
from typing import Any

import numpy as np

from rpo.proof.enclosure import Law, Table
from rpo_core.control.controller import FuzzyController
from rpo_core.control.fuzzy import MembershipFunctions

Exact = Any
"""A row or matrix of rational numbers: an array of objects."""

UNIT = Fraction(1, 2**53)

FLIGHT = 16 * UNIT
"""Share of the sizes of its terms by which a tick of a flight may be rounded.

A component is a sum of five products: 6 roundings, and 8 of the coefficients.
"""


_fractions = np.frompyfunc(Fraction, 1, 1)


def exact(values: Any) -> Exact:
    """Return a float as a rational number; a row or matrix of floats as an array of them."""
    return Fraction(values) if isinstance(values, (float, int)) else _fractions(np.asarray(values))


def _triangle(x: Fraction, left: Fraction, centre: Fraction, right: Fraction) -> Fraction:
    if x == centre:
        return Fraction(1)
    share = (x - left) / (centre - left) if x < centre else (right - x) / (right - centre)
    return max(share, Fraction(0))


def grades(x: Fraction, functions: MembershipFunctions) -> list[Fraction]:
    """Return the memberships in LN, SN, Z, SP, LP of an error in [-1, 1]."""
    f = [exact(value) for value in vars(functions).values()][:5]
    one, two = Fraction(1), Fraction(2)
    words = {
        'Z': _triangle(abs(x), -f[0], Fraction(0), f[0]),
        'S': _triangle(abs(x), f[1], f[2], f[3]),
        'L': _triangle(abs(x), f[4], one, two),
    }
    none = Fraction(0)
    right = [words['S'], words['L']] if x >= 0 else [none, none]
    left = [words['L'], words['S']] if x < 0 else [none, none]
    return [*left, words['Z'], *right]


def output(controller: FuzzyController, e: Fraction, w: Fraction, limit: Fraction) -> Fraction:
    """Return the inference at two errors, saturated at `limit`."""
    system, one = controller.system, Fraction(1)
    position = grades(min(max(e, -one), one), system.position)
    velocity = grades(min(max(w, -one), one), system.velocity)
    strength = [Fraction(0)] * 5
    for row, line in enumerate(system.rules.codes.tolist()):
        for column, word in enumerate(line):
            strength[word] = max(strength[word], min(velocity[row], position[column]))
    half = (system.samples - 1) // 2
    moment = area = Fraction(0)
    for i in range(-half, half + 1):
        y = exact(float(i / half))
        clipped = map(min, grades(y, system.force), strength)
        grade = max(clipped)
        moment, area = moment + y * grade, area + grade
    u = moment / area if area else Fraction(0)
    return min(max(u, -limit), limit)


class ExactStrip:
    """The strip in r, v of an axis that holds a zonotope, in rational numbers.

    r, v : middle; half_r : half-width; tilt, half : |v' - v - tilt (r' - r)| <= half
    """

    def __init__(self, c: Exact, g: Exact, d: Exact, axis: int) -> None:
        (self.r, self.v), (d_r, d_v) = c[axis :: len(c) // 2], d[axis :: len(c) // 2]
        along, across = g[axis :: len(c) // 2]
        squares = sum(float(x) ** 2 for x in along)
        products = sum(float(x) * float(y) for x, y in zip(along, across, strict=True))
        self.tilt = Fraction(products / squares) if squares else Fraction(0)
        self.half_r = d_r + abs(along).sum()
        self.half = d_v + abs(self.tilt) * d_r + abs(across - self.tilt * along).sum()


def law_holds(
    controller: FuzzyController, table: Table, law: Law, strip: ExactStrip, slack: Fraction
) -> bool:
    """Whether a law holds on a strip, by what the table says of its cells.

    Either the bilinear pieces, with their bends, are within rho of the law at the corners of the
    cells' parts; or the output in the middle of the strip, with the slopes of all its cells.
    """
    position, velocity, force = map(exact, controller.scales)
    k_r, k_v, k_0, rho = exact(law)
    a, b, c = -k_r * position / force, -k_v * velocity / force, k_0 / force
    room = rho / force
    e, w = -strip.r / position, -strip.v / velocity
    half_e, half_w = strip.half_r / position, strip.half / velocity
    tilt = strip.tilt * position / velocity
    most = Fraction(0)
    slopes = []
    for i, left, right in _cells(table.e, e - half_e, e + half_e):
        ends = [w + tilt * (x - e) for x in (left, right)]
        for j, low, high in _cells(table.w, min(ends) - half_w, max(ends) + half_w):
            slopes.append(exact(table.slopes[i, j]))
            for x in (left, right):
                for y in (low, high):
                    rest = _bilinear(table, i, j, x, y) - a * x - b * y - c
                    most = max(most, abs(rest) + exact(float(table.bend[i, j])) + slack)
    if most <= room:
        return True
    middle = output(controller, e, w, exact(table.limit)) - a * e - b * w - c
    least, greatest = np.min(slopes, axis=0)[::2], np.max(slopes, axis=0)[1::2]
    radii = np.maximum(greatest - (a, b), (a, b) - least)
    spread = (radii[0] + abs(tilt) * radii[1]) * half_e + radii[1] * half_w
    return bool(abs(middle) + slack + spread <= room)


def _cells(edges: Any, low: Fraction, high: Fraction) -> list[tuple[int, Fraction, Fraction]]:
    """Return the cells that a range touches, and what it is in each."""
    return [
        (i, max(low, exact(left)), min(high, exact(right)))
        for i, (left, right) in enumerate(itertools.pairwise(edges.tolist()))
        if left <= high and right >= low
    ]


def _bilinear(table: Table, i: int, j: int, x: Fraction, y: Fraction) -> Fraction:
    (e0, e1), (w0, w1) = exact(table.e[i : i + 2]), exact(table.w[j : j + 2])
    s, t = (x - e0) / (e1 - e0), (y - w0) / (w1 - w0)
    (u00, u01), (u10, u11) = exact(table.u[i : i + 2, j : j + 2])
    low, high = u00 + s * (u10 - u00), u01 + s * (u11 - u01)
    return Fraction(low + t * (high - low))
