# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a log owes and has: messages of each topic, from the first tick to the last."""

from __future__ import annotations

from rpo_log import topics
from rpo_log.decode import Block
from rpo_log.stream import RunReader
from rpo_log.topics import Topic


class Completeness:
    """Counts the messages of a log, block by block."""

    def __init__(self, reader: RunReader) -> None:
        self.base = reader.base
        self.messages: dict[Topic, int] = dict.fromkeys(reader.topics, 0)
        self._free = {topics.STATUS}
        if topics.free_running(reader.topics):
            self._free |= set(topics.ANSWERS)
        self.first = self.last = -1
        self.outcome: str | None = None

    def add(self, block: Block) -> None:
        """Take the next block."""
        for topic in self.messages:
            if topic.role == topics.STATUS:
                self.messages[topic] += len(block.statuses)
            elif topic.role in block.present:
                self.messages[topic] += int(block.present[topic.role].sum())
        if len(block.ticks):
            self.first = int(block.ticks[0]) if self.first < 0 else self.first
            self.last = int(block.ticks[-1])
        for _, status in block.statuses:
            self.outcome = dict(status.values).get('phase', self.outcome)

    @property
    def missing(self) -> dict[str, int]:
        """Per topic, ticks without a message between the first and the last; none is left out.

        In free running an answer may lack.
        """
        owed = self.last - self.first + 1 if self.last >= 0 else 0
        return {
            topic.name: owed - count
            for topic, count in self.messages.items()
            if topic.role not in self._free and count < owed
        }

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
