# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a log must have and has: messages of each topic, from the first tick to the last."""

from __future__ import annotations

from rpo_core.wire import interfaces
from rpo_log import events, topics
from rpo_log.read.decode import TickBlock
from rpo_log.read.stream import RunReader
from rpo_log.topics import Topic


class Completeness:
    """Counts the messages of a log, block by block."""

    def __init__(self, reader: RunReader) -> None:
        self.base = reader.base
        self.messages: dict[Topic, int] = dict.fromkeys(reader.topics, 0)
        self._may_miss = {t for t in reader.topics if not topics.is_due(t, reader.topics)}
        self._due = dict.fromkeys(reader.topics, 0)
        self.dropped: dict[str, int] = {}
        self.first = self.last = -1
        self.outcome: str | None = None

    def add(self, block: TickBlock) -> None:
        """Take the next block."""
        for event in block.events:
            if event.signal == interfaces.RUN_STATUS:
                self.outcome = event.values.get('phase', self.outcome)
                self.dropped.update(events.dropped(event.status))
        for topic in self.messages:
            if topic.is_event:
                self.messages[topic] += sum(e.signal == topic.signal for e in block.events)
            else:
                ticks = block.ticks[block.present[topic.signal]]
                self.messages[topic] += len(ticks)
                self._due[topic] += int((ticks < self._until(topic)).sum())
        if len(block.ticks):
            self.first = int(block.ticks[0]) if self.first < 0 else self.first
            self.last = int(block.ticks[-1])

    def _until(self, topic: Topic) -> int:
        """Return the tick from which a topic is expected no more."""
        return self.dropped.get(topic.signal, self.base.last_tick + 1)

    @property
    def missing(self) -> dict[str, int]:
        """Per topic, ticks without a message between the first and the last; none is left out.

        In free running an answer may be missing, and so may what the plant went on without.
        """
        found = {
            topic.name: min(self.last + 1, self._until(topic)) - max(self.first, 0) - count
            for topic, count in self._due.items()
            if topic not in self._may_miss
        }
        return {name: count for name, count in found.items() if count > 0}

    def gaps(self, damage: str) -> tuple[str, ...]:
        """Return why the log does not show a whole flight; empty if it does."""
        found = []
        if damage:
            found.append(f'it is cut short ({damage}); `rpo repair` makes a whole file of the rest')
        if self.first > 0:
            found.append(f'it begins at tick {self.first}')
        if self.last < self.base.last_tick:
            found.append(
                f'it ends at tick {self.last} of {self.base.last_tick}'
                + (f' ({self.outcome})' if self.outcome else '')
            )
        found += [f'{count} messages of {name} are missing' for name, count in self.missing.items()]
        return tuple(found)
