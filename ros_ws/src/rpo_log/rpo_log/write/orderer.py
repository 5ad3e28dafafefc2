# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in any order of arrival to ticks in order: two logs of one run are the same bytes.

A tick is let go when it is complete. While it is not, the ticks after it wait, until one of these:

- each topic that is missing has delivered a tick at least `REORDER` later: a publisher's messages
  arrive in order, so the missing message will not arrive;
- some topic is `WINDOW` ticks ahead: the topics that are missing are then silent, and are not
  waited for until their next message;
- the log is closed.

Events are rare, and are not waited for; only the first run_status is, before tick 1. An
event whose tick is written already is passed on by itself with the last tick written: none is lost.
A topic that the plant has dropped (`drop`) is neither waited for nor missing.

The wall clock has no part in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

REORDER = 3
WINDOW = 100
NEVER = 1 << 62


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
    missing: int
    events: list[tuple[int, bytes]]


@dataclass
class TickOrderer:
    """Orders the messages of topics with one message a tick; topic i is the i-th of a tick.

    width : number of topics
    events : indices of the event topics
    awaited : index of the event topic whose first message is waited for; None: of none
    release : called with (tick, [(index, message), ...]) in the order of ticks. A second call with
        the same tick brings an event alone.
    """

    width: int
    events: frozenset[int]
    awaited: int | None
    release: Callable[[int, Sequence[tuple[int, bytes]]], None]
    counts: list[Counts] = field(init=False)

    def __post_init__(self) -> None:
        self.counts = [Counts() for _ in range(self.width)]
        self.next_tick = 0
        self._regular = [i for i in range(self.width) if i not in self.events]
        self._pending: dict[int, _Tick] = {}
        self._released: dict[int, list[bytes | None]] = {}
        self._known_events: set[tuple[int, int, bytes]] = set()
        self._dropped: dict[int, int] = {}
        self._newest = [-1] * self.width
        self._silent = [False] * self.width
        self._latest = -1
        self._event_due = self.awaited is not None

    @property
    def waiting(self) -> int:
        """Number of messages of ticks that are not let go yet."""
        return sum(
            len(tick.events) + sum(data is not None for data in tick.messages)
            for tick in self._pending.values()
        )

    def drop(self, index: int, tick: int) -> None:
        """Expect no more messages of a topic from a tick on."""
        self._dropped.setdefault(index, tick)
        self._advance()

    def add(self, index: int, tick: int, data: bytes) -> None:
        """Take one message; releases the ticks that it completes."""
        if index in self.events:
            self._add_event(index, tick, data)
        else:
            entry = self._pending.get(tick)
            if entry is not None and entry.messages[index] is None:
                self._keep(entry, index, tick, data)
            elif self._fresh(index, tick, data):
                self._keep(self._entry(tick), index, tick, data)
            else:
                return
        self._advance()

    def _entry(self, tick: int) -> _Tick:
        entry = self._pending.get(tick)
        if entry is None:
            entry = self._pending[tick] = _Tick([None] * self.width, len(self._regular), [])
        return entry

    def _keep(self, entry: _Tick, index: int, tick: int, data: bytes) -> None:
        entry.messages[index] = data
        entry.missing -= 1
        if tick > self._newest[index]:
            self._newest[index] = tick
            self._silent[index] = False
            if tick > self._latest:
                self._latest = tick

    def _add_event(self, index: int, tick: int, data: bytes) -> None:
        if (index, tick, data) in self._known_events:
            self.counts[index].duplicates += 1
            return
        self._known_events.add((index, tick, data))
        self._event_due = self._event_due and index != self.awaited
        if tick < self.next_tick:
            self.counts[index].written += 1
            self.release(self.next_tick - 1, [(index, data)])
        else:
            self._entry(tick).events.append((index, data))
            self._latest = max(self._latest, tick)

    def close(self, last_tick: int) -> None:
        """Release every tick that waits, complete or not.

        The flight ends in the newest tick: its answers are due only if it is the last of all.
        """
        while self._pending:
            self._let_go(due=self.next_tick < self._latest or self.next_tick == last_tick)

    def _fresh(self, index: int, tick: int, data: bytes) -> bool:
        """Return whether a message is the first of its tick, and count it if it is not."""
        entry = self._pending.get(tick)
        known = entry.messages if entry is not None else self._released.get(tick)
        before = known[index] if known is not None else None
        counts = self.counts[index]
        if before is None:
            if tick >= self.next_tick:
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
        if entry is not None and entry.missing == 0:
            return True
        missing = self._missing(entry)
        if entry is not None and not missing:
            return True
        if ahead < 1:  # the newest tick of all may still be completed
            return False
        if ahead >= WINDOW:
            for i in missing:
                self._silent[i] = self._newest[i] < self.next_tick
            return True
        return all(self._silent[i] or self._newest[i] >= self.next_tick + REORDER for i in missing)

    def _missing(self, entry: _Tick | None) -> list[int]:
        """Return the topics whose message of the next tick is still expected."""
        return [
            index
            for index in self._regular
            if (entry is None or entry.messages[index] is None)
            and not (self._dropped and self.next_tick >= self._dropped.get(index, NEVER))
        ]

    def _let_go(self, due: bool = True) -> None:
        """Release the next tick; one of which nothing came is counted and passed over."""
        tick = self.next_tick
        entry = self._pending.pop(tick, None)
        if due and (entry is None or entry.missing):
            for index in self._missing(entry):
                counts = self.counts[index]
                counts.missing += 1
                if counts.first_missing is None:
                    counts.first_missing = tick
        self.next_tick = tick + 1
        self._released.pop(tick - WINDOW, None)
        if entry is not None:
            found = [(i, data) for i, data in enumerate(entry.messages) if data is not None]
            found += entry.events
            for index, _ in found:
                self.counts[index].written += 1
            self._released[tick] = entry.messages
            self.release(tick, found)
