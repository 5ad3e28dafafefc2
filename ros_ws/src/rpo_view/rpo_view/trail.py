# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The path of a chaser, in a bounded number of points."""

from __future__ import annotations

import math
from collections.abc import Sequence


class Trail:
    """Positions (n, 3) [m], target LVLH, n <= most; from the first to the last.

    A position is kept if it is `spacing_m` away from the last one kept. If there are too many,
    every second one is deleted and the spacing doubles: the path stays complete, but coarser.
    """

    def __init__(self, most: int = 2000, spacing_m: float = 0.02) -> None:
        self._most, self._first_spacing_m = most, spacing_m
        self.clear()

    def clear(self) -> None:
        """Delete all points."""
        self.points: list[tuple[float, float, float]] = []
        self.spacing_m = self._first_spacing_m

    def add(self, position_m: Sequence[float]) -> bool:
        """Take a position (3,); return whether it was kept."""
        x, y, z = position_m
        if self.points and math.dist(self.points[-1], (x, y, z)) < self.spacing_m:
            return False
        self.points.append((x, y, z))
        if len(self.points) > self._most:
            del self.points[1::2]
            self.spacing_m *= 2.0
        return True
