# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The decisions of a run, read back from decisions.mcap."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from mcap.records import Chunk, McapRecord

from rpo_core.wire import cdr
from rpo_log.format.run import DECISIONS_FILE
from rpo_log.read.records import FileRecords, RawMessage, message_at


class LoggedDecision(NamedTuple):
    """Why the controller commanded its force in one state.

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
    for message in messages_of(FileRecords(path), lambda _: None):
        yield LoggedDecision(*cdr.decode_array(message.data))


def messages_of(records: FileRecords, take: Callable[[McapRecord], None]) -> Iterator[RawMessage]:
    """Yield the messages of a file beside a log; `take` gets its other records."""
    for record in records:
        if not isinstance(record, Chunk):
            take(record)
            continue
        data = records.content_of(record)
        for at in records.messages_in(data, take):
            yield message_at(data, at)


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
