# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The messages of one tick on their way to the log, and what is counted of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

REORDER = 3
"""A topic that is so many ticks further brings no message of a tick any more."""
WINDOW = 100
"""Most ticks that wait for a topic; contradictions to older ones are not looked for."""
LINE = 5
"""States that follow each other where the plant went on unheard."""
HOLD = 8
"""Ticks after one by which all its messages are there."""
MOST_HELD = 10_000
"""Ticks after the newest state whose messages are kept."""
MOST_CANDIDATES, MOST_EARLY = 32, 4
"""Further messages of one topic and tick that are kept; those that come before its state."""
MOST_HOLES = 100_000
"""Ticks without a message that are remembered for each topic."""
NEVER = 1 << 62

Candidates = Callable[[int, int], Sequence[bytes]]
"""Returns the messages of a topic, by its index, at a tick."""


def no_judge(index: int, tick: int, candidates: Candidates) -> bytes | None:
    """Know of no message whether it acted."""
    return None


@dataclass
class Counts:
    """What happened to the messages of one topic."""

    written: int = 0
    missing: int = 0
    first_missing: int | None = None
    duplicates: int = 0
    conflicts: int = 0
    first_conflict: int | None = None
    late: int = 0
    ignored: int = 0


@dataclass
class TickMessages:
    """Messages of a tick: the first of each topic, and others.

    early, far : topics whose messages came before the state, and more than `WINDOW` ticks before
    """

    messages: list[bytes | None]
    missing: int
    events: list[tuple[int, bytes]] = field(default_factory=list)
    others: dict[int, list[bytes]] = field(default_factory=dict)
    early: set[int] = field(default_factory=set)
    far: set[int] = field(default_factory=set)

    @property
    def waiting(self) -> int:
        """Number of messages."""
        return len(self.events) + sum(data is not None for data in self.messages)

    def came_ahead(self, index: int, far: bool) -> None:
        """Note that the message of a topic came before the state."""
        self.early.add(index)
        if far:
            self.far.add(index)

    def gives_way(self, index: int, leader: int, behind: int) -> bool:
        """Return whether the message that came before its state gives way to one that comes now.

        behind : ticks from its own to the newest state; what comes late is no answer either
        """
        return index in self.early and self.messages[leader] is not None and behind < REORDER

    def forget_far(self, index: int) -> int:
        """Forget the messages of a topic that came far before the state; return how many."""
        if index not in self.far:
            return 0
        self.far.discard(index)
        self.early.discard(index)
        self.messages[index] = None
        self.missing += 1
        return 1 + len(self.others.pop(index, ()))
