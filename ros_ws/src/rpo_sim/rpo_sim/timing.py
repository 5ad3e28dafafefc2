# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The wall clock of a loop, without ROS: pace, overruns, durations, all in bounded memory."""

from __future__ import annotations

import math

_NS = 1_000_000_000
_LEAST_S = 1e-6
_PER_DECADE = 50
_DECADES = 9
MOST_CATCH_UP = 10
"""Most ticks that are caught up after an overrun; after a longer stall the pace starts anew."""


class Histogram:
    """Durations in bins of 4.7 % width from 1 us to 1000 s; the largest is exact."""

    def __init__(self) -> None:
        self.count = 0
        self.largest_s = 0.0
        self._bins = [0] * (_PER_DECADE * _DECADES + 1)

    def add(self, duration_s: float) -> None:
        """Take one duration >= 0."""
        place = math.ceil(math.log10(max(duration_s, _LEAST_S) / _LEAST_S) * _PER_DECADE)
        self._bins[min(place, len(self._bins) - 1)] += 1
        self.count += 1
        self.largest_s = max(self.largest_s, duration_s)

    def quantile_s(self, share: float) -> float:
        """Return an upper bound of a share in (0, 1] of the durations; 0 if there are none."""
        rank, seen = share * self.count, 0
        for place, number in enumerate(self._bins):
            seen += number
            if number and seen >= rank:
                edge = _LEAST_S * math.pow(10.0, place / _PER_DECADE)
                return min(edge, self.largest_s)
        return self.largest_s

    def figures(self, name: str) -> dict[str, float]:
        """Return median, 95th percentile and largest [ms], by name."""
        values = (self.quantile_s(0.5), self.quantile_s(0.95), self.largest_s)
        return {
            f'{name}_{what}_ms': round(1e3 * value, 4)
            for what, value in zip(('p50', 'p95', 'max'), values, strict=True)
        }


class Pace:
    """Which ticks are due on the wall clock, and how late they are; in whole nanoseconds.

    overruns : ticks that were late by a period or more
    stalls : how often the pace started anew, more than MOST_CATCH_UP ticks behind
    """

    def __init__(self) -> None:
        self.lateness = Histogram()
        self.overruns = self.stalls = 0
        self._period_ns = self._next_ns = 0

    def restart(self, now_ns: int, period_s: float) -> None:
        """Count from now, after a start, a pause or a change of speed."""
        self._period_ns = max(1, int(period_s * _NS))  # as rclpy rounds the period of a timer
        self._next_ns = now_ns + self._period_ns

    def due(self, now_ns: int) -> int:
        """Return how many ticks are due, and count them as begun."""
        count = 0
        while self._next_ns <= now_ns and count < MOST_CATCH_UP:
            late_ns = now_ns - self._next_ns
            self.lateness.add(late_ns / _NS)
            self.overruns += late_ns >= self._period_ns
            self._next_ns += self._period_ns
            count += 1
        if self._next_ns + self._period_ns <= now_ns:
            self.stalls += 1
            self._next_ns = now_ns + self._period_ns
        return count
