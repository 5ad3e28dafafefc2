# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The plant in lockstep, without ROS: integer ticks, answers matched by stamp, exact steps."""

from __future__ import annotations

from rpo_sim.plant import ACCEPTED, DROPPED, EARLY, FOREIGN, LATE, REPEATED, Force, Plant


class LockstepPlant(Plant):
    """State k waits for the answers with stamp k, then steps."""

    @property
    def answers(self) -> dict[str, Force]:
        """The answers to the current state, by topic."""
        return self.taken[self.tick]

    @property
    def missing(self) -> list[str]:
        """The missing answers to the current state."""
        answers = self.answers
        return [name for name in self.expected if name not in answers]

    @property
    def finished(self) -> bool:
        """Whether the last state has been reached and answered."""
        return self.tick == self.scenario.ticks and not self.missing

    def answer(self, name: str, stamp_ns: int, force_n: Force) -> str:
        """Take an answer; return ACCEPTED or why it is ignored (counted in `ignored`).

        The force must be finite; `signals.listen` checks it.
        """
        awaited = name in self.expected and name not in self.answers
        if awaited and stamp_ns == self._stamp_ns:
            self.answers[name] = force_n
            return ACCEPTED
        return self.ignore(DROPPED if name not in self.expected else self._why_ignored(stamp_ns))

    def _why_ignored(self, stamp_ns: int) -> str:
        tick = self.scenario.tick_of(stamp_ns)
        if tick is None:
            return FOREIGN
        if tick == self.tick:
            return REPEATED
        return LATE if tick < self.tick else EARLY

    def drop_missing(self) -> list[str]:
        """Go on without the missing peers, whose force is zero from now on; return them."""
        dropped = self.missing
        self.expected = tuple(name for name in self.expected if name not in dropped)
        return dropped

    def advance(self) -> None:
        """Step to the next tick; all answers must be there and the run not finished."""
        self.fly(self.answers)
