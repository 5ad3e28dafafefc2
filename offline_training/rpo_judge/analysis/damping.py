# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How far a control surface misses the sign of damping.

H = m v^2 / 2 + integral of |F(s, 0)| ds, the energy of the motion in the force at rest, falls where
v (F(r, v) - F(r, 0)) <= 0: where, at any position error, a velocity error e_v pushes the output to
its own side, sign(e_v) (U(e, e_v) - U(e, 0)) >= 0. The most that is missing from 0 is bounded.
"""

from __future__ import annotations

import itertools

import numpy as np

from rpo_core.control.fuzzy import FuzzySystem
from rpo_judge.analysis import surface
from rpo_judge.analysis.surface import Boxes
from rpo_kernels.arrays import Floats

_CLOSE = 1e-3
"""Strips are halved until the bound is so near to what was found, as a share of full output."""


def found(e: Floats, v: Floats, grid: Floats) -> tuple[float, int, int]:
    """Return the most that is missing on a grid (v, e) of outputs, and its row and column."""
    rest = int(np.flatnonzero(v == 0.0)[0])
    missing = -np.sign(v)[:, None] * (grid - grid[rest])
    row, column = np.unravel_index(missing.argmax(), missing.shape)
    return max(0.0, float(missing[row, column])), int(row), int(column)


def bound(
    system: FuzzySystem, e: Floats, v: Floats, seen: float, most_boxes: int
) -> tuple[float, int]:
    """Return a bound of what is missing anywhere, and the number of boxes that it took.

    e, v : edges of a grid that holds 0 and all breakpoints; seen : what is missing somewhere
    """
    sides = [v[v >= 0.0]] if system.rules.is_odd else [v[v >= 0.0], v[v <= 0.0][::-1]]
    worst, spent = seen, 0
    for side in sides:
        strips = np.array(list(itertools.pairwise(e)))
        while len(strips):
            bounds = _strips(system, strips, side)
            spent += len(strips) * (len(side) - 1)
            target = max(1.5 * seen, seen + _CLOSE)
            open_ = bounds > target
            worst = max(worst, float(bounds[~open_].max(initial=0.0)))
            if spent > most_boxes:
                worst = max(worst, float(bounds.max()))
                break
            low, high = strips[open_].T
            middle = low + (high - low) / 2
            strips = np.concatenate([np.stack([low, middle], 1), np.stack([middle, high], 1)])
    return worst, spent


def _strips(system: FuzzySystem, strips: Floats, side: Floats) -> Floats:
    """Return what may be missing in each strip of position errors, along velocity errors from 0.

    U at rest is at most the top of its range; and from rest on, U rises by at least the sum of the
    least slopes, each times the width of its box.
    """
    columns, up = len(side) - 1, side[-1] > 0.0
    low, high = np.minimum(side[:-1], side[1:]), np.maximum(side[:-1], side[1:])
    box = surface.enclose(
        system,
        Boxes(
            np.repeat(strips[:, 0], columns),
            np.repeat(strips[:, 1], columns),
            np.tile(low, len(strips)),
            np.tile(high, len(strips)),
        ),
    )
    shape = len(strips), columns
    least, most = (edge.reshape(shape) for edge in (box.low, box.high))
    missing = (most[:, :1] - least if up else most - least[:, :1]).max(axis=1)
    steps = box.v_slope_low.reshape(shape) * (high - low)
    with np.errstate(invalid='ignore'):
        along = np.nan_to_num(-np.cumsum(steps, axis=1).min(axis=1), nan=np.inf)
        slack = 4.0 * columns * surface.UNIT_ROUNDOFF * np.nan_to_num(np.abs(steps).sum(axis=1))
    if not surface.is_continuous(system.velocity):
        return np.maximum(missing, 0.0)
    return np.maximum(np.minimum(missing, along + slack), 0.0)
