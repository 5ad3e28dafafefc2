# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Exponentials of matrices of rational numbers, as floats that are right to the last digits."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Matrix = list[list[Fraction]]


def times(a: Matrix, b: Matrix) -> Matrix:
    """Return the product."""
    columns = list(zip(*b, strict=True))
    return [[sum(map(Fraction.__mul__, row, c), Fraction(0)) for c in columns] for row in a]


def each(function: Callable[..., Fraction], *matrices: Matrix) -> Matrix:
    """Return a function of the entries of matrices."""
    rows = zip(*matrices, strict=True)
    return [[function(*entries) for entries in zip(*row, strict=True)] for row in rows]


def _series(a: Matrix, t: Fraction) -> tuple[Matrix, Fraction]:
    """Return exp(A t), and a bound of what each entry may be wrong by.

    Up to |At| = 1 it is a sum of rational numbers, else a square; digits below 2^-300 are cut.
    """

    def cut(matrix: Matrix) -> Matrix:
        return each(lambda v: Fraction(round(v * 2**300), 2**300), matrix)

    step = each(lambda v: v * t, a)
    norm = max(sum(map(abs, row)) for row in step)
    if norm > 1:
        half, wrong = _series(a, t / 2)
        far = max(sum(map(abs, row)) for row in half)
        return cut(times(half, half)), (2 * far + 4 * wrong) * wrong + Fraction(1, 2**280)
    term = total = [[Fraction(i == j) for j in range(len(a))] for i in range(len(a))]
    for k in range(1, 60):
        term = cut(each(lambda v, k=k: v / k, times(term, step)))
        total = each(Fraction.__add__, total, term)
    return total, Fraction(1, 2**250)


def exponential(a: Matrix, time_s: float) -> Floats:
    """Return exp(A t), each entry right to a share of 2^-52.

    An entry that the first powers of A leave at 0 is 0.

    Raises
    ------
    ValueError
        If an entry is too small, or A t too large, for that.
    """
    total, wrong = _series(a, Fraction(time_s))
    least = min(abs(v) for row in total for v in row if v)
    if wrong > least / 2**54:
        raise ValueError(f'`a` must have an exponential without tiny entries; got {float(least):g}')
    return np.array([[float(v) for v in row] for row in total])
