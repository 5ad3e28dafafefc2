# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The slew of a strip, part by part: far cheaper than to halve a cell and to fly again. Kernels."""

from __future__ import annotations

import numpy as np

from rpo_montecarlo.engine.lanes import compiled
from rpo_proof.laws import TINY, law_of
from rpo_proof.slew import Drift, Strip, slew_of
from rpo_proof.tables import Table

MOST_PARTS = 400
"""Parts of a strip that are looked at, at most."""

SMALLEST = 2.0**-14
"""Size of a part in errors; one that is smaller, and too fast, ends the search."""


@compiled
def slew_by_parts(
    table: Table, drift: Drift, strip: Strip, f0: float, f1: float, enough: float
) -> float:
    """Return a bound [N/s] of the slew of an axis that starts in a strip; see `slew.slew_of`.

    A part whose bound exceeds `enough` is halved, and gets a law of its own, until one is too
    small. The parts of |v' - v - tilt (r' - r)| <= half are strips of the same tilt.
    """
    todo = np.empty((MOST_PARTS, 5))
    todo[0] = strip.r, strip.v, strip.half_m, strip.half, 1e300
    left, looked, most = 1, 0, 0.0
    while left > 0:
        left -= 1
        r, v, half_m, half, whole = todo[left]
        bound = _bound(table, drift, Strip(r, v, half_m, strip.tilt, half), f0, f1, enough)
        bound = min(bound, whole)
        looked += 1
        by_r = half_m * (1.0 / table.position_m + abs(strip.tilt) / table.velocity_m_s)
        by_v = half / table.velocity_m_s
        if bound <= enough or looked + left + 2 > MOST_PARTS or by_r + by_v < SMALLEST:
            most = max(most, bound)
            if most > enough:  # sharper parts beside it do not help
                for k in range(left):
                    most = max(most, todo[k, 4])
                return most
            continue
        first, second = (0.5, 0.0) if by_r > by_v else (0.0, 0.5)
        for side in (-1.0, 1.0):
            away = side * first * half_m
            todo[left, 0], todo[left, 1] = r + away, v + strip.tilt * away + side * second * half
            todo[left, 2] = (1.0 - first) * half_m + TINY * (abs(r) + half_m)
            room = TINY * (abs(v) + half + abs(strip.tilt) * (abs(r) + half_m))
            todo[left, 3] = (1.0 - second) * half + room
            todo[left, 4] = bound
            left += 1
    return most


@compiled
def _bound(table: Table, drift: Drift, part: Strip, f0: float, f1: float, enough: float) -> float:
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
