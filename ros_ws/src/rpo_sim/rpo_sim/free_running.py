# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The plant in free running, without ROS: it waits for no peer and holds the last force.

A tick ends when the next one is due. Its force is the newest that has come by then: the answer to
its own state, of age 0, or an older one. So a lost or late answer counts in whole ticks, a latency
within the tick changes nothing, and without faults the flight equals that of lockstep.
"""

from __future__ import annotations

from collections.abc import Sequence

from rpo_core.files.scenario import Scenario
from rpo_core.wire import interfaces
from rpo_sim.plant import ACCEPTED, EARLY, FOREIGN, LATE, REPEATED, ZERO, Force, Plant


class FreeRunningPlant(Plant):
    """Holds the newest force of each peer, for some ticks.

    stale_after_ticks : an older force counts as zero
    """

    def __init__(self, scenario: Scenario, expected: Sequence[str], stale_after_ticks: int) -> None:
        super().__init__(scenario, expected)
        self.stale_after_ticks = self.settled_after_ticks = stale_after_ticks
        self.held_ticks = 0
        self.stale_ticks = 0
        self._held: dict[str, tuple[int, Force]] = {}

    @property
    def missing(self) -> list[str]:
        """The peers that have never answered."""
        return [name for name in self.expected if name not in self._held]

    @property
    def finished(self) -> bool:
        """Whether the last state has been reached."""
        return self.tick == self.scenario.ticks

    def answer(self, name: str, stamp_ns: int, force_n: Force) -> str:
        """Take an answer; return ACCEPTED or why it is ignored (counted in `ignored`).

        Only an answer to a newer state replaces the one before. The force must be finite.
        """
        tick = self.scenario.tick_of(stamp_ns)
        if tick is None:
            return self.ignore(FOREIGN)
        if tick > self.tick:
            return self.ignore(EARLY)
        newest = self._held[name][0] if name in self._held else -1
        if tick <= newest:
            return self.ignore(REPEATED if tick == newest else LATE)
        self._held[name] = (tick, force_n)
        self.taken.get(tick, {})[name] = force_n
        return ACCEPTED

    def age_ticks(self, name: str) -> int | None:
        """Return the age of the newest force of a peer: ticks since its state."""
        return self.tick - self._held[name][0] if name in self._held else None

    @property
    def stale(self) -> tuple[str, ...]:
        """The peers whose force is too old to act."""
        return tuple(name for name in self.expected if self._is_stale(name))

    def _is_stale(self, name: str) -> bool:
        age = self.age_ticks(name)
        return age is None or age > self.stale_after_ticks

    def applied(self, name: str) -> Force:
        """Return the force of a peer that acts in the current tick, and the torque in it if any."""
        row = interfaces.row_of(name)
        if name not in self.expected or self._is_stale(name):
            return ZERO + ZERO if row.rider else ZERO
        force = self._held[name][1]
        commanded = row.carries == interfaces.COMMAND
        return (*self.saturated(force[:3]), *force[3:]) if commanded else force

    def advance(self) -> None:
        """Step to the next tick with the forces held; the run must not be finished."""
        self.stale_ticks += bool(self.stale)
        self.held_ticks += any(self.age_ticks(name) for name in self.expected)
        self.fly(self.answers)

    @property
    def answers(self) -> dict[str, Force]:
        """The forces held, by topic, without the stale ones."""
        return {name: self._held[name][1] for name in self.expected if not self._is_stale(name)}
