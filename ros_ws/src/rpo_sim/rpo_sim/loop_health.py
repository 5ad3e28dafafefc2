# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The loop against the wall clock: pace, durations, and its health, all in bounded memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rpo_ros import health
from rpo_sim.plant import Plant

_FAULTS = ('resends', 'overruns', 'stalls', 'stale_ticks')
"""Counts that cause a warning while they grow, as ignored answers do."""
_SENT = 1024
"""Number of sent states whose times are kept."""
_KEPT = 10_000
"""Durations of which quantiles are: the last ten seconds of a loop at 1 kHz."""
_NS = 1_000_000_000
MOST_CATCH_UP = 10
"""Most ticks that are caught up after an overrun; after a longer stall the pace starts anew."""


class Durations:
    """Durations [s]: their number, the largest of all, and the last ones."""

    def __init__(self) -> None:
        self.count, self.largest_s = 0, 0.0
        self._last: deque[float] = deque(maxlen=_KEPT)

    def add(self, duration_s: float) -> None:
        """Take one duration >= 0."""
        self.count += 1
        self.largest_s = max(self.largest_s, duration_s)
        self._last.append(duration_s)

    def figures(self, name: str) -> dict[str, float]:
        """Return median and 95th percentile of the last ones, and the largest [ms], by name."""
        median_s, p95_s = np.percentile(self._last or [0.0], (50, 95)).tolist()
        values = {'p50': median_s, 'p95': p95_s, 'max': self.largest_s}
        return {f'{name}_{what}_ms': round(1e3 * value, 4) for what, value in values.items()}


class Pace:
    """Which ticks are due on the wall clock, and how late they are; in whole nanoseconds.

    overruns : ticks that were late by a period or more
    stalls : how often the pace started anew, more than MOST_CATCH_UP ticks behind
    """

    def __init__(self) -> None:
        self.lateness = Durations()
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


class LoopHealth:
    """Health of one run.

    plant : of the run
    figures : returns counts of the loop that depend on the wall clock
    latency : time from a sent state to the received command
    """

    def __init__(self, plant: Plant, figures: Callable[[], dict[str, Any]]) -> None:
        self._plant, self._figures = plant, figures
        self.latency = Durations()
        self._sent: dict[int, float] = {}
        self._rate = health.Rate()
        self._commanded_s: float | None = None
        self._faults = 0

    def sent(self, tick: int, now_s: float) -> None:
        """Note when the state of a tick was sent first."""
        self._sent.setdefault(tick, now_s)
        self._sent.pop(tick - _SENT, None)

    def commanded(self, tick: int | None, now_s: float) -> None:
        """Note that a command that answers a tick was accepted."""
        self._commanded_s = now_s
        if tick in self._sent:
            self.latency.add(now_s - self._sent[tick])

    def wall_figures(self) -> dict[str, Any]:
        """Return the values that depend on the wall clock: counts, latency and lateness."""
        return {**self._figures(), **self.latency.figures('latency')}

    def status(
        self, phase: str, unrecorded: bool, silent: str, doubled: Mapping[str, str]
    ) -> health.Health:
        """Return level, message and values.

        A warning while faults happen, or nodes are silent; an error while a topic has two
        publishers (`doubled`: topic -> their names).
        """
        plant, figures = self._plant, self.wall_figures()
        values: dict[str, Any] = {
            'tick': plant.tick,
            'tick_rate_hz': self._rate.per_s(plant.tick),
            **figures,
            **{f'ignored_{kind}': count for kind, count in sorted(plant.ignored.items())},
            'saturation_share': plant.saturated_ticks / max(1, plant.tick),
            'command_age_s': health.age_s(self._commanded_s),
        }
        if plant.openings is not None:
            values['openings'] = plant.openings
        if silent:
            values['silent'] = silent
        faults = sum(plant.ignored.values()) + sum(figures.get(name, 0) for name in _FAULTS)
        level = health.WARN if faults > self._faults or unrecorded or silent else health.OK
        self._faults = faults
        for topic, publishers in doubled.items():
            level, values[f'publishers_of_{topic.strip("/")}'] = health.ERROR, publishers
        return level, f'{phase}, the recorder is gone' if unrecorded else phase, values
