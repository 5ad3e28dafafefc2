# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The plant in lockstep, without ROS: integer ticks, answers matched by stamp, exact steps."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from rpo_core import kernels
from rpo_core.scenario import Scenario
from rpo_ros.names import CONTROL_FORCE, DISTURBANCE_FORCE

ZERO = (0.0, 0.0, 0.0)

ACCEPTED = 'accepted'
LATE, EARLY, REPEATED = 'late', 'early', 'repeated'
FOREIGN, DROPPED = 'foreign_stamp', 'dropped_peer'
"""Why an answer is ignored: for a past tick, a future one, one already answered; with a stamp of no
tick at all; from a peer that the run flies on without."""


class LockstepPlant:
    """State k waits for the answers that carry stamp k, then steps.

    scenario : what flies
    expected : topics of the answers awaited each tick
    """

    def __init__(self, scenario: Scenario, expected: Sequence[str]) -> None:
        self.scenario = scenario
        self.expected = tuple(expected)
        self.tick = 0
        self.state: tuple[float, ...] = tuple(map(float, scenario.start))
        self.energy_n2s = 0.0
        self.saturated_ticks = 0
        self.ignored: Counter[str] = Counter()
        self._limit = float(scenario.max_force_n)
        self._answers: dict[str, tuple[float, float, float]] = {}
        self._stamp_ns = scenario.stamp_ns(0)

    @property
    def stamp_ns(self) -> int:
        """Stamp of the present state."""
        return self._stamp_ns

    @property
    def missing(self) -> list[str]:
        """The answers still awaited for the present state."""
        return [name for name in self.expected if name not in self._answers]

    @property
    def finished(self) -> bool:
        """Whether the last state has been reached and answered."""
        return self.tick == self.scenario.ticks and not self.missing

    def answer(self, name: str, stamp_ns: int, force_n: tuple[float, float, float]) -> str:
        """Take an answer; return ACCEPTED or why it changes nothing (counted in `ignored`).

        The force must be finite; the edge checks it.
        """
        awaited = name in self.expected and name not in self._answers
        if awaited and stamp_ns == self._stamp_ns:
            self._answers[name] = force_n
            return ACCEPTED
        return self.ignore(DROPPED if name not in self.expected else self._why_ignored(stamp_ns))

    def ignore(self, kind: str) -> str:
        """Count an answer that changes nothing; return its kind."""
        self.ignored[kind] += 1
        return kind

    def _why_ignored(self, stamp_ns: int) -> str:
        tick = self.scenario.tick_of(stamp_ns)
        if tick is None:
            return FOREIGN
        if tick == self.tick:
            return REPEATED
        return LATE if tick < self.tick else EARLY

    def drop_missing(self) -> list[str]:
        """Fly on without the peers that are missing, at zero force of theirs; return them."""
        dropped = self.missing
        self.expected = tuple(name for name in self.expected if name not in dropped)
        return dropped

    def advance(self) -> None:
        """Step to the next tick; all answers must be in and the run not finished."""
        command = self._answers.get(CONTROL_FORCE, ZERO)
        disturbance = self._answers.get(DISTURBANCE_FORCE, ZERO)
        self._account(command)
        self.state = kernels.plant_step(
            self.state, command, disturbance, self._limit, self.scenario.step
        )
        self._answers.clear()
        self.tick += 1
        self._stamp_ns = self.scenario.stamp_ns(self.tick)

    def _account(self, command: tuple[float, float, float]) -> None:
        limit = self._limit
        x, y, z = (kernels.saturate(force, limit) for force in command)
        self.saturated_ticks += (x, y, z) != command
        # Neither sum() nor hypot(): they round differently from one Python to another.
        self.energy_n2s += (x * x + y * y + z * z) * self.scenario.dt_s

    def figures(self) -> dict[str, float | int]:
        """Return the run's figures so far: simulated facts only."""
        x, y, z, vx, vy, vz = self.state
        return {
            'tick': self.tick,
            'time_s': self.scenario.time_s(self.tick),
            'energy_n2s': self.energy_n2s,
            'distance_m': math.sqrt(x * x + y * y + z * z),
            'speed_m_s': math.sqrt(vx * vx + vy * vy + vz * vz),
            'saturated_ticks': self.saturated_ticks,
        }
