# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The decisions of a run, decisions.mcap: why the controller commanded what it commanded.

A file beside run.mcap, because it speaks now and then: the log proper holds the same messages every
tick, and is read many ticks at once for it. The same run leaves the same bytes here too.
"""

from __future__ import annotations

from pathlib import Path

from rpo_core import cdr, interfaces
from rpo_core.decimation import Decimation
from rpo_log.format.run import DECISIONS_FILE, TimeBase
from rpo_log.write.bag_file import CHUNK_SHARE
from rpo_log.write.side_file import SideFile

CHUNK_DECISIONS, MOST_CHUNK_DECISIONS = 10, 600
"""A chunk holds a 25th of the decisions before it, within these bounds: its index stays in memory
until the file is closed."""


class DecisionLogWriter(SideFile):
    """Writes the decisions that are due, each once, in the order of ticks; never raises.

    A controller that is started anew in flight explains its first state out of turn: that is no
    part of the run's log.
    """

    def __init__(self, folder: str | Path, name: str, base: TimeBase, rate_hz: float) -> None:
        super().__init__(Path(folder) / DECISIONS_FILE, name, interfaces.LOCKSTEP)
        self._base, self._decimation = base, Decimation(rate_hz)
        self._last = -1
        self._chunked = 0

    def record(self, data: bytes) -> None:
        """Take the CDR of a decision as it came."""
        try:
            tick = self._base.tick_of(cdr.stamp_ns(data))
            if tick is None or tick <= self._last or not self.due(tick):
                return
            data = cdr.canonical(interfaces.ARRAY_TYPE, data)
        except cdr.CdrError:
            return
        self._last = tick
        self.write(self._base.stamp_ns(tick), data)

    def due(self, tick: int) -> bool:
        """Return whether a decision is due at a tick."""
        before = self._base.stamp_ns(tick - 1) if tick else None
        return self._decimation.due(self._base.stamp_ns(tick), before)

    def expects(self, tick: int) -> bool:
        """Return whether a decision up to a tick, the last of the flight, is still to come."""
        return self.failure is None and any(self.due(k) for k in range(self._last + 1, tick + 1))

    def chunk_is_full(self) -> bool:
        """Count decisions: the wall clock would leave other bytes each time."""
        share = self.messages // CHUNK_SHARE
        wanted = min(max(CHUNK_DECISIONS, share), MOST_CHUNK_DECISIONS)
        full = self.messages - self._chunked >= wanted
        if full:
            self._chunked = self.messages
        return full
