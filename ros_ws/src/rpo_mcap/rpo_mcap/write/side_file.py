# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Files beside a run's log, each of one topic of DiagnosticArrays: its health, its decisions.

They are apart from run.mcap because their messages are rare: run.mcap holds the same messages every
tick, and is therefore read many ticks at once.
"""

from __future__ import annotations

import time
from pathlib import Path

from rpo_core.wire import cdr
from rpo_core.wire.interfaces import ARRAY_TYPE, LOCKSTEP, Decimation
from rpo_mcap.errors import cannot_write
from rpo_mcap.format.rosbag2 import BagTopic
from rpo_mcap.format.run import DECISIONS_FILE, HEALTH_FILE, TimeBase
from rpo_mcap.write.mcap_file import CHUNK_SHARE, BagFileWriter
from rpo_mcap.write.orderer import NEVER, REORDER

CHUNK_S = 2.0
"""Wall time after which a chunk of the health is closed: a crash loses no more."""

CHUNK_DECISIONS, MOST_CHUNK_DECISIONS = 10, 600
"""A chunk holds a 25th of the decisions before it, within these bounds: its index stays in memory
until the file is closed."""


class SideFile:
    """Writes one topic to an MCAP file; never raises once open.

    path : in the folder of the run, which is prepared (`rpo_mcap.format.run.prepare_folder`)
    name : full name of the topic
    failure : why the file ended early; None if it did not
    """

    def __init__(self, path: Path, name: str) -> None:
        self.failure: str | None = None
        self.messages = 0
        self._closed = False
        self.name = path.name
        try:
            self._file = BagFileWriter(path, [BagTopic.of(name, ARRAY_TYPE, LOCKSTEP)])
        except OSError as error:
            raise cannot_write(path, error) from None

    def write(self, stamp_ns: int, data: bytes) -> None:
        """Log the CDR of one DiagnosticArray under a stamp (UTC since 1970)."""
        if self.failure is not None or self._closed:
            return
        try:
            self._file.add(stamp_ns, self.messages, [(0, data)])
            self.messages += 1
            if self.chunk_is_full():
                self._file.close_chunk()
        except OSError as error:
            self.failure = error.strerror or str(error)

    def chunk_is_full(self) -> bool:
        """Return whether the messages of the open chunk must be written now."""
        raise NotImplementedError

    def close(self) -> None:
        """End the file; what comes after is dropped. Never raises."""
        if self._closed:
            return
        self._closed = True
        for step in (self._file.close,) if self.failure else (self._file.finish, self._file.close):
            try:
                step()
            except OSError as error:
                self.failure = error.strerror or str(error)


class HealthLogWriter(SideFile):
    """Writes `/diagnostics` to health.mcap, stamped with the wall clock."""

    def __init__(self, folder: str | Path, name: str = '/diagnostics') -> None:
        super().__init__(Path(folder) / HEALTH_FILE, name)
        self._closed_s = time.monotonic()

    def chunk_is_full(self) -> bool:
        """Return whether the chunk is `CHUNK_S` of wall time old."""
        full = time.monotonic() - self._closed_s >= CHUNK_S
        self._closed_s = time.monotonic() if full else self._closed_s
        return full


class DecisionLogWriter(SideFile):
    """Writes the decisions that are due to decisions.mcap, each once, in the order of ticks.

    The same run leaves the same bytes. A controller that is started anew in flight explains its
    first state when no decision is due: that decision is not logged.
    """

    def __init__(self, folder: str | Path, name: str, base: TimeBase, rate_hz: float) -> None:
        super().__init__(Path(folder) / DECISIONS_FILE, name)
        self._base, self._decimation = base, Decimation(rate_hz)
        self._last = -1
        self._chunked = 0

    def record(self, data: bytes, newest: int = NEVER) -> None:
        """Take the CDR of a decision as it came; not one far ahead of the newest tick."""
        try:
            tick = self._base.tick_of(cdr.stamp_ns(data))
            if tick is None or not self._last < tick <= newest + REORDER or not self.due(tick):
                return
            data = cdr.canonical(ARRAY_TYPE, data)
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
