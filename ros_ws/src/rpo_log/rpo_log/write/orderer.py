# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in any order of arrival to ticks in order: two logs of one run are the same bytes.

One topic, the true state, leads: its newest tick is where the run is. States come one after
another: one that is ahead waits, and is ignored unless `LINE` states follow each other there before
the next one comes here. The plant takes no answer to a state that it has not published. So another
message ahead of its state, the last of them, is used only if none comes with its state or later.

The first message of a topic and tick counts. One that differs from it is counted, up to `REORDER`
ticks after its state; the plant ignores a later one, and so does the log.

A tick is let go when it is complete. While it is not, the ticks after it wait, until one of these:

- each topic that is missing has delivered a tick at least `REORDER` later: a publisher's messages
  arrive in order, so the missing message will not arrive;
- the states are `WINDOW` ticks ahead: the topics that are missing are then silent, and are not
  waited for until their next message;
- a plant that waits for the log brings none of these about (`pass_over`);
- the log is closed.

Events are rare, and are not waited for; only the first run_status is, before tick 1. An event
whose tick is written already is passed on by itself with the last tick written: none is lost. A
topic that the plant has dropped (`drop`) is neither waited for nor missing. The wall clock has no
part in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

REORDER = 3
"""A topic that is so many ticks further brings no message of a tick any more."""
WINDOW = 100
"""Most ticks that wait for a message; repeated messages are known for as many."""
LINE = 5
"""States that follow each other where the plant went on unheard."""
MOST_AHEAD = 10_000
"""Messages stamped ahead that are kept, and events."""
NEVER = 1 << 62


@dataclass(slots=True)
class Counts:
    """What happened to the messages of one topic; `differing` and `missing` with the first tick."""

    written: int = 0
    missing: int = 0
    first_missing: int | None = None
    duplicates: int = 0
    differing: int = 0
    first_differing: int | None = None
    ignored: int = 0


class TickOrderer:
    """Orders the messages of topics with one message a tick; topic i is the i-th of a tick.

    width : number of topics; events : indices of the event topics
    awaited : index of the event topic whose first message is waited for; None: of none
    release : called with (tick, [(index, message), ...]) in the order of ticks. A second call with
        the same tick brings an event alone.
    leader : index of the topic of true states
    plain : indices of the topics whose messages hold their stamp only: they may be ahead
    latest : tick of the newest state
    next_tick : the first that is not let go
    """

    def __init__(
        self,
        width: int,
        events: frozenset[int],
        awaited: int | None,
        release: Callable[[int, Sequence[tuple[int, bytes]]], None],
        leader: int = 0,
        plain: frozenset[int] = frozenset(),
    ) -> None:
        self.events, self._awaited, self._release = events, awaited, release
        self._leader, self._plain = leader, plain
        self.counts = [Counts() for _ in range(width)]
        self.next_tick, self.latest, self._last = 0, -1, NEVER
        self._regular = [i for i in range(width) if i not in events]
        self._ticks: dict[int, dict[int, bytes]] = {}  # messages; of ticks let go, for a window
        self._early: set[tuple[int, int]] = set()  # tick and topic of those ahead of their state
        self._states_ahead: dict[int, bytes] = {}
        self._event_due = awaited is not None
        self._events: dict[int, list[tuple[int, bytes]]] = {}
        self._known_events: dict[tuple[int, int, bytes], None] = {}
        self._dropped: dict[int, int] = {}
        self._silent: set[int] = set()

    @property
    def waiting(self) -> int:
        """Number of messages of ticks that are not let go yet."""
        regular = sum(len(row) for tick, row in self._ticks.items() if tick >= self.next_tick)
        return regular + sum(map(len, self._events.values()))

    def drop(self, index: int, tick: int) -> None:
        """Expect no more messages of a topic from a tick on."""
        self._dropped.setdefault(index, tick)
        self._advance()

    def end(self, tick: int) -> None:
        """Take the last tick of the flight: none follows."""
        self._last = tick
        self._advance()

    def pass_over(self) -> None:
        """Wait no more for what is missing at the next tick, nor for the first run_status."""
        if self.latest > self.next_tick:
            self._event_due = False
            self._silent.update(self._missing())
        self._advance()

    def add(self, index: int, tick: int, data: bytes) -> None:
        """Take one message; releases the ticks that it completes."""
        if index in self.events:
            self._add_event(index, tick, data)
        elif index == self._leader and tick > self.latest:
            self._lead(tick, data)
        elif tick > self.latest + WINDOW and len(self._early) >= MOST_AHEAD:
            self.counts[index].ignored += 1
        else:
            self._take(index, tick, data)
        self._advance()

    def _lead(self, tick: int, data: bytes) -> None:
        """Go on to a state, if it is the next one or the last of a line."""
        ahead, first = self._states_ahead, tick
        if tick == self.latest + 1 or len(ahead) >= MOST_AHEAD:
            self.counts[self._leader].ignored += len(ahead)
            ahead.clear()
        ahead.setdefault(tick, data)
        if tick > self.latest + 1:
            first = tick - LINE + 1
            if not all(one in ahead for one in range(first, tick)):
                return
            self._let_go_before(first - WINDOW)
        for one in range(first, tick + 1):
            self.latest = one
            self._take(self._leader, one, ahead.pop(one))

    def _take(self, index: int, tick: int, data: bytes) -> None:
        """Take the first message of a tick, or of those before its state the last one."""
        counts, first = self.counts[index], self._ticks.get(tick, {}).get(index)
        if tick >= self.next_tick and (first is None or (tick, index) in self._early):
            counts.ignored += first not in (None, data)
            self._ticks.setdefault(tick, {})[index] = data
            if tick > self.latest + (WINDOW if index in self._plain else 0):
                self._early.add((tick, index))
            else:
                self._early.discard((tick, index))
                self._silent.discard(index)
        elif first == data:
            counts.duplicates += 1
        elif first is None or tick < self.latest - REORDER:
            counts.ignored += 1
        else:
            counts.differing += 1
            if counts.first_differing is None or tick < counts.first_differing:
                counts.first_differing = tick

    def _add_event(self, index: int, tick: int, data: bytes) -> None:
        if (index, tick, data) in self._known_events:
            self.counts[index].duplicates += 1
            return
        if tick > self.latest + WINDOW and len(self._events) >= MOST_AHEAD:
            self.counts[index].ignored += 1
            return
        self._known_events[(index, tick, data)] = None
        if len(self._known_events) > MOST_AHEAD:
            del self._known_events[next(iter(self._known_events))]
        self._event_due = self._event_due and index != self._awaited
        if tick < self.next_tick:
            self.counts[index].written += 1
            self._release(self.next_tick - 1, [(index, data)])
        else:
            self._events.setdefault(tick, []).append((index, data))

    def close(self, last_tick: int) -> None:
        """Release every tick that waits, complete or not.

        The flight ends in the newest tick: its answers are due only if it is the last of all.
        What is stamped with a later tick is no part of it.
        """
        begun, ended = self.latest >= 0, self._last != NEVER
        for tick, data in sorted(self._states_ahead.items()):
            if tick <= self._last and (ended or not begun):
                self.latest = tick
                self._take(self._leader, tick, data)
            else:
                self.counts[self._leader].ignored += 1
        newest = self._last if ended else self.latest
        self._let_go_before(newest)
        if newest >= self.next_tick:
            self._let_go(newest, due=newest == last_tick)
        for tick, events in sorted(self._events.items()):
            for index, _ in events:
                self.counts[index].written += tick == newest + 1
                self.counts[index].ignored += tick > newest + 1
            if tick == newest + 1:  # it holds from a tick on that was not flown
                self._release(tick, events)
        for _, index in self._early:
            self.counts[index].ignored += 1

    def _advance(self) -> None:
        while self.next_tick <= self.latest and self._settled():
            self._let_go(self.next_tick)

    def _settled(self) -> bool:
        """Return whether nothing more is waited for at the next tick."""
        tick, ahead = self.next_tick, self.latest - self.next_tick
        if self._event_due and tick > 0 and ahead < WINDOW:
            return False
        missing = self._missing()
        if ahead >= WINDOW:
            self._event_due = False
            self._silent.update(missing)
        ended, later = self.latest >= self._last, range(tick + REORDER, self.latest + 1)
        return all(
            (ended and (tick, index) in self._early)
            or (ahead > 0 and index in self._silent)
            or any(index in self._ticks.get(after, ()) for after in later)
            for index in missing
        )

    def _missing(self) -> list[int]:
        """Return the topics whose message of the next tick is still expected."""
        tick, early = self.next_tick, self._early
        messages = self._ticks.get(tick, {})
        return [
            index
            for index in self._regular
            if (index not in messages or (early and (tick, index) in early))
            and tick < self._dropped.get(index, NEVER)
        ]

    def _let_go_before(self, end: int) -> None:
        """Release all ticks before one, complete or not."""
        for tick in sorted({*self._ticks, *self._events, end - 1}):
            if self.next_tick <= tick < end:
                self._let_go(tick)

    def _let_go(self, tick: int, due: bool = True) -> None:
        """Release a tick, and count what is missing in it and in those before it."""
        messages = self._ticks.setdefault(tick, {})
        for index in self._regular:
            end = tick + (due and index not in messages)
            missing = min(end, self._dropped.get(index, NEVER)) - self.next_tick
            if missing > 0:
                counts = self.counts[index]
                counts.missing += missing
                if counts.first_missing is None:
                    counts.first_missing = self.next_tick
        self.next_tick = tick + 1
        self._ticks.pop(tick - WINDOW, None)
        released = [*sorted(messages.items()), *self._events.pop(tick, ())]
        for index, _ in released:
            self.counts[index].written += 1
            self._early.discard((tick, index))
        if released:
            self._release(tick, released)
