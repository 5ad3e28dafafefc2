# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in any order of arrival to ticks in order: two logs of one run are the same bytes.

A tick is let go when it is complete. While it is not, the ticks after it wait, until one of these:

- each topic that lacks has delivered a tick at least `REORDER` later: a publisher's messages
  arrive in order, so what lacks will not come;
- some topic is `WINDOW` ticks ahead: the topics that lack are then silent, and nobody waits for
  them until they speak again;
- the log is closed.

The event topic (run_status) speaks at tick 0 and then rarely. Its first message is waited for
before tick 1, later ones are not; one of the tick let go last is passed on by itself.

The wall clock has no part in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

REORDER = 3
WINDOW = 100


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


@dataclass
class _Tick:
    messages: list[bytes | None]
    lacks: int


@dataclass
class TickOrderer:
    """Orders the messages of topics that speak once a tick; topic i is the i-th of a tick.

    width : number of topics
    event : index of the event topic, None if there is none
    release : called with (tick, messages) in the order of ticks; None where a message lacks. A
        second call with the same tick brings an event alone.
    """

    width: int
    event: int | None
    release: Callable[[int, Sequence[bytes | None]], None]
    counts: list[Counts] = field(init=False)

    def __post_init__(self) -> None:
        self.counts = [Counts() for _ in range(self.width)]
        self.next_tick = 0
        self._pending: dict[int, _Tick] = {}
        self._released: dict[int, list[bytes | None]] = {}
        self._newest = [-1] * self.width
        self._silent = [False] * self.width
        self._latest = -1
        self._event_due = self.event is not None

    @property
    def waiting(self) -> int:
        """Number of messages of ticks that are not let go yet."""
        return sum(data is not None for tick in self._pending.values() for data in tick.messages)

    def add(self, index: int, tick: int, data: bytes) -> None:
        """Take one message; releases the ticks that it completes."""
        if not self._fresh(index, tick, data):
            return
        if index == self.event:
            self._event_due = False
        if tick < self.next_tick:
            self._release_event(index, tick, data)
        else:
            self._keep(index, tick, data)
        self._advance()

    def _keep(self, index: int, tick: int, data: bytes) -> None:
        entry = self._pending.get(tick)
        if entry is None:
            lacks = self.width - (self.event is not None)
            entry = self._pending[tick] = _Tick([None] * self.width, lacks)
        entry.messages[index] = data
        entry.lacks -= index != self.event
        if tick > self._newest[index]:
            self._newest[index] = tick
            self._silent[index] = False
            self._latest = max(self._latest, tick)

    def close(self, last_tick: int) -> None:
        """Release every tick that waits, complete or not.

        The flight ends in the newest tick: its answers are owed only if it is the last of all.
        """
        while self._pending:
            self._let_go(owed=self.next_tick < self._latest or self.next_tick == last_tick)

    def _fresh(self, index: int, tick: int, data: bytes) -> bool:
        """Return whether a message is the first of its tick, and count it if it is not."""
        entry = self._pending.get(tick)
        known = entry.messages if entry is not None else self._released.get(tick)
        before = known[index] if known is not None else None
        counts = self.counts[index]
        if before is None:
            if tick >= self.next_tick or (index == self.event and tick == self.next_tick - 1):
                return True
            counts.late += 1
        elif before == data:
            counts.duplicates += 1
        else:
            counts.conflicts += 1
            if counts.first_conflict is None:
                counts.first_conflict = tick
        return False

    def _advance(self) -> None:
        while self._latest >= self.next_tick and self._settled():
            self._let_go()

    def _settled(self) -> bool:
        """Return whether nothing more is waited for at the next tick."""
        entry = self._pending.get(self.next_tick)
        ahead = self._latest - self.next_tick
        if self._event_due and self.next_tick > 0:
            self._event_due = ahead < WINDOW
            if self._event_due:
                return False
        if entry is not None and entry.lacks == 0:
            return True
        if ahead < 1:  # the newest tick of all may still be completed
            return False
        lacking = self._lacking(entry)
        if ahead >= WINDOW:
            for i in lacking:
                self._silent[i] = self._newest[i] < self.next_tick
            return True
        return all(self._silent[i] or self._newest[i] >= self.next_tick + REORDER for i in lacking)

    def _lacking(self, entry: _Tick | None) -> list[int]:
        return [
            index
            for index in range(self.width)
            if index != self.event and (entry is None or entry.messages[index] is None)
        ]

    def _let_go(self, owed: bool = True) -> None:
        """Release the next tick; one of which nothing came is counted and passed over."""
        tick = self.next_tick
        self.next_tick = tick + 1
        self._released.pop(tick - WINDOW, None)
        entry = self._pending.pop(tick, None)
        for index in self._lacking(entry) if owed else ():
            counts = self.counts[index]
            counts.missing += 1
            if counts.first_missing is None:
                counts.first_missing = tick
        if entry is not None:
            for counts, data in zip(self.counts, entry.messages, strict=True):
                counts.written += data is not None
            self._released[tick] = entry.messages
            self.release(tick, entry.messages)

    def _release_event(self, index: int, tick: int, data: bytes) -> None:
        known = self._released.setdefault(tick, [None] * self.width)
        known[index] = data
        self.counts[index].written += 1
        self.release(tick, [data if i == index else None for i in range(self.width)])
