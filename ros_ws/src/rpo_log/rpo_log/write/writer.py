# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The writer of a run's log: `run.mcap` and `metadata.yaml`, the same bytes for the same run.

When the process dies (`kill -9`), the open chunk and the ticks that wait for a message are lost,
nothing else. A chunk holds at most 1/25 of the ticks before it and at most one second of simulated
time: 4 % of the run so far, one second in real time. Chunks are cut by ticks alone, never by the
wall clock; the wall clock only paces `fsync`, about once a second, in case the machine dies.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rpo_core.wire import cdr
from rpo_core.wire.interfaces import RELATIVE_STATE, RUN_STATUS
from rpo_log import topics
from rpo_log.errors import LogError, cannot_write
from rpo_log.format import rosbag2
from rpo_log.format.rosbag2 import BagFile
from rpo_log.format.run import DIFFERING, RunSummary, TimeBase, prepare_folder
from rpo_log.topics import Topic
from rpo_log.write.mcap_file import BagFileWriter
from rpo_log.write.orderer import TickOrderer

SYNC_INTERVAL_S = 1.0

_NS = 1_000_000_000


class RunLogWriter:
    """Writes one run; takes messages in any order, never raises into the flight.

    folder : created if it is not there
    base : the ticks of the run
    names : full topic names; the last part of each is its signal (`rpo_core.wire.interfaces`), or
        it is a Topic
    attachments : file name to bytes: scenario.yaml, controller.yaml, parameters.yaml
    split_s, split_bytes : begin a new file (run_0.mcap, run_1.mcap, ...) after so much simulated
        time or so many bytes; 0 and 0 for one file, run.mcap
    overwrite : clear a log that is there; otherwise that is a LogError
    orderer : of its messages
    ignored : messages that the plant ignores too, by reason

    Raises LogError if the log cannot be begun. After that a fault of the disk ends the log, not the
    flight: `failure` says why, `summary` counts what is lost.
    """

    def __init__(
        self,
        folder: str | Path,
        base: TimeBase,
        names: Iterable[str | Topic],
        attachments: Mapping[str, bytes],
        *,
        split_s: float = 0.0,
        split_bytes: int = 0,
        overwrite: bool = False,
    ) -> None:
        self.folder = Path(folder)
        self.base = base
        self.topics = topics.resolve(names, str(folder))
        self.failure: str | None = None
        self._intake = {
            topic.name: (index, None if topic.is_event else topic.row.layout)
            for index, topic in enumerate(self.topics)
        }
        self._attachments = dict(sorted(attachments.items()))
        self._split_ticks = round(split_s * _NS) // base.dt_ns
        self._split_bytes = split_bytes
        self._finished: list[BagFile] = []
        self._foreign = self._unwanted = 0
        self.ignored: Counter[str] = Counter()
        self._closed = False
        self._synced_s = time.monotonic()
        self._index = {topic.signal: index for index, topic in enumerate(self.topics)}
        self._status = self._index.get(RUN_STATUS)
        events = frozenset(i for i, topic in enumerate(self.topics) if topic.is_event)
        leader = self._index.get(RELATIVE_STATE, 0)
        plain = frozenset(i for i, topic in enumerate(self.topics) if not topic.row.columns)
        self.orderer = TickOrderer(
            len(self.topics), events, self._status, self._write_tick, leader, plain
        )
        prepare_folder(self.folder, overwrite)
        try:
            self._file = self._begin_file(0, 0)
        except OSError as error:
            raise cannot_write(self.folder, error) from None

    def pass_over(self) -> None:
        """Wait no more for what is missing, see `TickOrderer.pass_over`; never raises."""
        self._try(self.orderer.pass_over)

    def attach(self, name: str, data: bytes) -> None:
        """Attach one more file in flight; never raises."""
        self._attachments[name] = data
        self._try(self._file.attach, name, data)

    def end(self, tick: int) -> None:
        """Take the last tick of the flight; never raises."""
        self._try(self.orderer.end, tick)

    def record(self, name: str, data: bytes) -> None:
        """Take the CDR of a message as it came; never raises.

        Its tick is that of its stamp; of an event, its value `tick`. What the plant does not
        accept is ignored here too: both ask `Layout.use`.
        """
        layout = self._intake[name][1] if name in self._intake else None
        if layout is None:
            self.write(name, _tick_of_event(data), data)
            return
        fault, stamp_ns, _ = layout.use(data)
        if fault:
            self.ignored[fault] += 1
            return
        tick = self.base.tick_of(stamp_ns)
        if tick is not None and not layout.columns and not data.startswith(cdr.HEADER):
            data = layout.encode(stamp_ns, ())  # a clock: its bytes follow from its tick
        self.write(name, -1 if tick is None else tick, data)

    def write(self, name: str, tick: int, data: bytes) -> None:
        """Take one message of a tick, in any order; never raises.

        Repeated ones are dropped. Those of no tick of this run, not of their type, or of a topic
        that is not recorded, are foreign.
        """
        if self.failure is not None or self._closed:
            self._unwanted += 1
            return
        try:
            index, layout = self._intake[name]
            if layout is None or not layout.knows(data):
                data = cdr.canonical(self.topics[index].type, data)
        except (KeyError, cdr.CdrError):  # not recorded, or not of its type
            tick = -1
        if not 0 <= tick <= self.base.last_tick:
            self._foreign += 1
            return
        try:
            self.orderer.add(index, tick, data)
        except (OSError, LogError) as error:
            self._fail(error)
        if index == self._status:
            self._try(self._drop, data)

    def _drop(self, data: bytes) -> None:
        """Expect no more of the topics that the plant goes on without."""
        for signal, tick in topics.dropped(cdr.decode_status(data)).items():
            if signal in self._index:
                self.orderer.drop(self._index[signal], tick)

    def close(self) -> RunSummary:
        """End the log and return what it holds; never raises."""
        if not self._closed:
            self._try(self._finish)
            self._closed = True
            try:
                self._file.close()
            except OSError as error:
                self._fail(error)
        return self.summary

    def _finish(self) -> None:
        self.orderer.close(self.base.last_tick)
        if differing := self.summary.differing_lines():
            self._file.attach(DIFFERING, ''.join(f'- {line}\n' for line in differing).encode())
        self._file.finish()
        rosbag2.write_metadata(self.folder, self.topics, self._files())

    @property
    def latest(self) -> int:
        """Tick of the newest state."""
        return self.orderer.latest

    @property
    def next_tick(self) -> int:
        """The first tick that is not complete yet, or not yet given up."""
        return self.orderer.next_tick

    @property
    def summary(self) -> RunSummary:
        """What the log holds now."""
        counts = dict(zip((topic.name for topic in self.topics), self.orderer.counts, strict=True))
        due = {topic.name for topic in topics.due(self.topics)}
        files = self._files()
        logged = [sum(file.counts[index] for file in files) for index in range(len(counts))]
        taken = sum(c.written for c in counts.values()) + self.orderer.waiting
        owed = {name: count for name, count in counts.items() if name in due}
        return RunSummary(
            files=tuple(file.path for file in files),
            messages=dict(zip(counts, logged, strict=True)),
            missing={n: (c.missing, c.first_missing or 0) for n, c in owed.items() if c.missing},
            duplicates={name: c.duplicates for name, c in counts.items() if c.duplicates},
            differing={
                name: (c.differing, c.first_differing or 0)
                for name, c in counts.items()
                if c.differing
            },
            foreign=self._foreign,
            ignored={**self.ignored, **{n: c.ignored for n, c in counts.items() if c.ignored}},
            lost=self._unwanted + (taken - sum(logged) if self.failure else 0),
            failure=self.failure,
        )

    def _files(self) -> list[BagFile]:
        return [*self._finished, self._file.entry]

    def _begin_file(self, number: int, ticks_before: int) -> BagFileWriter:
        split = self._split_ticks > 0 or self._split_bytes > 0
        name = f'run_{number}.mcap' if split else 'run.mcap'
        self._file_tick = ticks_before
        parts = self.topics, self.base, self._attachments
        return BagFileWriter(self.folder / name, *parts, ticks_before)

    def _write_tick(self, tick: int, messages: Sequence[tuple[int, bytes]]) -> None:
        file = self._file
        if tick > file.newest_tick and (
            0 < self._split_ticks <= file.ticks - self._file_tick
            or 0 < self._split_bytes <= file.size
        ):
            file.finish()
            file.close()
            following = self._begin_file(len(self._finished) + 1, file.ticks)
            self._finished.append(file.entry)
            self._file = file = following
        file.add_tick(tick, messages)
        now_s = time.monotonic()
        if now_s - self._synced_s >= SYNC_INTERVAL_S:
            self._synced_s = now_s
            file.sync()

    def _try(self, write: Callable[..., None], *arguments: Any) -> None:
        """Write, unless the log is closed or has failed; an error is its failure."""
        try:
            if self.failure is None and not self._closed:
                write(*arguments)
        except (OSError, LogError) as error:
            self._fail(error)

    def _fail(self, error: OSError | LogError) -> None:
        self.failure = getattr(error, 'strerror', None) or str(error)


def _tick_of_event(data: bytes) -> int:
    """Return the tick that an event names; -1 if it names none, or is no event."""
    try:
        tick = topics.tick_of(cdr.decode_status(data))
    except cdr.CdrError:
        return -1
    return -1 if tick is None else tick
