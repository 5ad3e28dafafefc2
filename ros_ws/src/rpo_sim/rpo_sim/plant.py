# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The plant without ROS: what lockstep and free running have in common."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from rpo_core import interfaces, kernels
from rpo_core.chain import Chain, Signals
from rpo_core.interfaces import (
    DUE_FORCE,
    RELATIVE_STATE,
    SATURATED_FORCE,
)
from rpo_core.scenario import Scenario
from rpo_core.stage import Place, Signal

Force = tuple[float, float, float]
"""Force [N], target LVLH."""

ZERO: Force = (0.0, 0.0, 0.0)

ACCEPTED = 'accepted'
LATE, EARLY, REPEATED = 'late', 'early', 'repeated'
FOREIGN, DROPPED = 'foreign_stamp', 'dropped_peer'
"""Why an answer is ignored: for a past tick, a future one, one already answered; with a stamp of no
tick at all; from a peer that the run flies on without."""


PLACES = (Place.LINK, Place.THRUSTERS, Place.DYNAMICS)
"""Stages that the plant runs."""


def topics_of(scenario: Scenario) -> tuple[list[str], list[str]]:
    """Return the signals that a plant waits for at each state, and the topics that its stages make.

    The dynamics' own topic, the true state, is not among them.
    """
    chain = Chain.of(scenario).part(*PLACES)
    made = [name for name in chain.outputs if interfaces.row_of(name).type]
    return [n for n in chain.inputs if n != RELATIVE_STATE], [
        n for n in made if n != RELATIVE_STATE
    ]


class Plant:
    """The chaser at an integer tick, what it has spent, and which answers changed nothing.

    scenario : of the run
    expected : topics of the answers to each state
    """

    def __init__(self, scenario: Scenario, expected: Sequence[str]) -> None:
        self.scenario = scenario
        self.expected = tuple(expected)
        self.tick = 0
        self.energy_n2s = 0.0
        self.saturated_ticks = 0
        self.ignored: Counter[str] = Counter()
        self._chain = Chain.of(scenario).part(*PLACES)
        self._chain.reset()
        self.inputs = tuple(name for name in self._chain.inputs if name != RELATIVE_STATE)
        self.signals: Signals = {RELATIVE_STATE: tuple(map(float, scenario.start))}
        self._limit = float(scenario.max_force_n)
        self._stamp_ns = scenario.stamp_ns(0)

    @property
    def state(self) -> Signal:
        """True state (x, y, z, vx, vy, vz) [m, m/s], target LVLH."""
        return self.signals[RELATIVE_STATE]

    @property
    def stamp_ns(self) -> int:
        """Stamp of the present state."""
        return self._stamp_ns

    def ignore(self, kind: str) -> str:
        """Count an answer that changes nothing; return its kind."""
        self.ignored[kind] += 1
        return kind

    def saturated(self, command: Force) -> Force:
        """Return what the thrusters can give of a command."""
        x, y, z = (kernels.saturate(force, self._limit) for force in command)
        return x, y, z

    def fly(self, answers: Mapping[str, Force]) -> None:
        """Step to the next tick under answers by topic; zero force where there is none."""
        signals = self.signals
        for name in self.inputs:
            signals[name] = answers.get(name, ZERO)
        self._chain.step(self.tick, signals)
        x, y, z = signals[SATURATED_FORCE]
        self.saturated_ticks += signals[SATURATED_FORCE] != signals[DUE_FORCE]
        # Neither sum() nor hypot(): they round differently from one Python to another.
        self.energy_n2s += (x * x + y * y + z * z) * self.scenario.dt_s
        self.tick += 1
        self._stamp_ns = self.scenario.stamp_ns(self.tick)

    def last_signals(self, answers: Mapping[str, Force]) -> Signals:
        """Return the signals of the last tick, whose answers move nothing any more."""
        signals = {**self.signals, **{name: answers.get(name, ZERO) for name in self.inputs}}
        self._chain.step(self.tick, signals)
        return signals

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
