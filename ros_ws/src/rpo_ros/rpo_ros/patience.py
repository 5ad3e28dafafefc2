# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""For how long a node waits for an input of a tick, and when it goes on without it."""

from __future__ import annotations

import time
from collections.abc import Sequence

from rpo_core.chain.chain import Chain
from rpo_core.stage import Stage
from rpo_core.wire.interfaces import current

MOST_REPEATS = 3
"""Without a command, of this tick or before, a state that was repeated so often is answered; in
free running, one that is so many ticks newer than the last answer."""

LEAST_WAIT_S = 0.6
"""But not so soon after it first came, by the node's own clock: anybody can send copies of a state,
and the plant needs 0.75 s for so many."""

FAR_TICKS = 100
"""An input so many ticks ahead of the last answer is somebody else's, unless a row begins there."""

ROW = 3
"""So many inputs, each of them one to `ROW` ticks after the one before, are a row."""

LONELY_S = 3.0
"""A plant that stands repeats its state more often than this."""

LOST_TICKS = 5
"""A peer whose commands are missing at so many ticks in a row is lost."""


class Patience:
    """Counts how often a state comes again while something is missing.

    may_miss : signal -> the stage that goes on without it
    """

    def __init__(self) -> None:
        self.may_miss: dict[str, Stage] = {}
        self.forget()

    def forget(self) -> None:
        """Begin a run."""
        self._stamp_ns, self._repeats, self._came_s = -1, 0, 0.0
        self._newest_ns, self._dt_ns, self._near_s = -1, 0, 0.0
        self._row: list[int] = []
        self._gone_on, self._in_a_row = -1, 0  # newest tick without something, and how many

    def answered(self, stamp_ns: int, dt_ns: int) -> None:
        """Note the stamp of an answer."""
        self._newest_ns, self._dt_ns = max(stamp_ns, self._newest_ns), dt_ns

    def is_stray(self, stamp_ns: int) -> bool:
        """Return whether an input is to be ignored: it is far ahead of the newest answer.

        A stage with memory that took it could answer no tick before it any more. It is not ignored
        where a row of inputs begins, or where it comes again and for LONELY_S nothing else came.
        """
        if self._newest_ns < 0 or stamp_ns <= self._newest_ns + FAR_TICKS * self._dt_ns:
            self._near_s, self._row = time.monotonic(), []
            return False
        follows = self._row and 0 <= stamp_ns - self._row[-1] <= ROW * self._dt_ns
        self._row = [*self._row[1 - ROW :], stamp_ns] if follows else [stamp_ns]
        lonely = time.monotonic() - self._near_s > LONELY_S
        return len(self._row) < ROW or (len(set(self._row)) < ROW and not lonely)

    @property
    def calm(self) -> bool:
        """Whether nothing came again, and no tick of the run missed anything."""
        return not (self._repeats or self._in_a_row)

    def hear(self, chain: Chain) -> None:
        """Take the stages whose inputs are waited for."""
        self.may_miss = {
            read: link.stage
            for link in chain.links
            for name, read in zip(link.stage.inputs, link.reads, strict=True)
            if name in link.stage.may_miss and read in chain.inputs
        }

    def came(self, stamp_ns: int, again: bool) -> None:
        """Note when an input of a tick first came, and count how often it came again."""
        if self._stamp_ns != stamp_ns:
            self._stamp_ns, self._repeats, self._came_s = stamp_ns, 0, time.monotonic()
        self._repeats += again

    def is_over(
        self, missing: Sequence[str], tick: int, last_tick: int, stamp_ns: int, late: bool
    ) -> bool:
        """Return whether to go on with zero for what is missing.

        Where nobody would read it, the node waits at LOST_TICKS ticks and not at those that follow:
        a peer that lives stays in step, and one that is lost costs no time.

        last_tick : that was answered; -1: none yet, and commands of this tick may still begin
        late : in free running, whether the state is too new to wait
        """
        now = [name for name in missing if current(name) == name]
        if not self.may_miss.keys() >= set(now) or (now and last_tick < 0):
            return False
        unread = all(self.may_miss[name].goes_without(tick) for name in now)
        waited = self._stamp_ns == stamp_ns and time.monotonic() - self._came_s >= LEAST_WAIT_S
        over = last_tick < 0 or (waited and self._repeats >= MOST_REPEATS) or late
        follows = self._gone_on == tick - 1
        if over or (now and unread and follows and self._in_a_row >= LOST_TICKS):
            self._in_a_row = self._in_a_row + 1 if follows else 1
            self._gone_on = tick
            return True
        return False
