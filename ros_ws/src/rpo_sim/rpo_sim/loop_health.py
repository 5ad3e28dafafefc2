# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Health of the loop: for /diagnostics, and for the last run_status of free running."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rpo_ros import health
from rpo_sim.plant import Plant
from rpo_sim.timing import Histogram

_FAULTS = ('resends', 'overruns', 'stalls', 'stale_ticks')
"""Counts that cause a warning while they grow, as ignored answers do."""
_SENT = 1024
"""Number of sent states whose times are kept."""


class LoopHealth:
    """Health of one run.

    plant : of the run
    figures : returns counts of the loop that depend on the wall clock
    latency : time from a sent state to the received command, of the whole run
    """

    def __init__(self, plant: Plant, figures: Callable[[], dict[str, Any]]) -> None:
        self._plant, self._figures = plant, figures
        self.latency, self._recent = Histogram(), Histogram()
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
            self._recent.add(now_s - self._sent[tick])

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
        plant, recent, self._recent = self._plant, self._recent, Histogram()
        figures = self.wall_figures()
        values: dict[str, Any] = {
            'tick': plant.tick,
            'tick_rate_hz': self._rate.per_s(plant.tick),
            **figures,
            **recent.figures('recent_latency'),
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
