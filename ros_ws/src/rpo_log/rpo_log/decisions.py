# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The decisions of a run, decisions.mcap: why the controller commanded what it commanded.

A file beside run.mcap, because it speaks now and then: the log proper holds the same messages every
tick, and is read many ticks at once for it. The same run leaves the same bytes here too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from mcap.opcode import Opcode

from rpo_core import cdr
from rpo_core.decimation import Decimation
from rpo_log.bag_file import CHUNK_SHARE
from rpo_log.run import DECISIONS_FILE, TimeBase
from rpo_log.scan import Scan, chunk_records, inner_records
from rpo_log.side_file import TYPE, SideFile
from rpo_log.topics import Qos

CHUNK_DECISIONS, MOST_CHUNK_DECISIONS = 10, 600
"""A chunk holds a 25th of the decisions before it, within these bounds: its index stays in memory
until the file is closed."""
_HEAD = 22
"""Bytes of a message record before its data: channel, sequence, two times."""


class DecisionLogWriter(SideFile):
    """Writes the decisions that are due, each once, in the order of ticks; never raises.

    A controller that is started anew in flight explains its first state out of turn: that is no
    part of the run's log.
    """

    def __init__(self, folder: str | Path, name: str, base: TimeBase, rate_hz: float) -> None:
        super().__init__(Path(folder) / DECISIONS_FILE, name, Qos())
        self._base, self._decimation = base, Decimation(rate_hz)
        self._last = -1
        self._chunked = 0

    def record(self, data: bytes) -> None:
        """Take the CDR of a decision as it came."""
        try:
            tick = self._base.tick_of(cdr.stamp_ns(data))
            if tick is None or tick <= self._last or not self.due(tick):
                return
            data = cdr.canonical(TYPE, data)
        except cdr.CdrError:
            return
        self._last = tick
        self.write(self._base.stamp_ns(tick), data)

    def due(self, tick: int) -> bool:
        """Return whether a tick owes a decision."""
        before = self._base.stamp_ns(tick - 1) if tick else None
        return self._decimation.due(self._base.stamp_ns(tick), before)

    def owes(self, tick: int) -> bool:
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


class LoggedDecision(NamedTuple):
    """What the controller said of one state.

    stamp_ns : of the state
    axes : x, y, z; level, sentence and numbers as texts
    """

    stamp_ns: int
    axes: tuple[cdr.Status, ...]

    @property
    def numbers(self) -> tuple[Mapping[str, str], ...]:
        """Per axis, name to number as text."""
        return tuple(dict(status.values) for status in self.axes)


def decisions_file(run: str | Path) -> Path:
    """Return where the decisions of a run folder, or of the folder of a .mcap file, would be."""
    path = Path(run)
    return (path if path.is_dir() else path.parent) / DECISIONS_FILE


def read_decisions(path: Path) -> Iterator[LoggedDecision]:
    """Yield the decisions of a file in order, as far as it is whole; raises LogError, CdrError."""
    for record in Scan(path):
        if record.opcode != Opcode.CHUNK:
            continue
        for inner in inner_records(path, record, chunk_records(path, record)):
            if inner.opcode == Opcode.MESSAGE:
                yield LoggedDecision(*cdr.decode_array(inner.content[_HEAD:]))


def decision_at(run: str | Path, stamp_ns: int) -> LoggedDecision | None:
    """Return the last decision of a run at or before a stamp; None if there is none."""
    path = decisions_file(run)
    found = None
    if path.exists():
        for decision in read_decisions(path):
            if decision.stamp_ns > stamp_ns:
                break
            found = decision
    return found
