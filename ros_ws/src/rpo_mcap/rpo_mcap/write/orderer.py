# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in any order of arrival to ticks in order: two logs of one run are the same bytes.

One topic, the true state, leads: its newest tick is where the run is. Whatever else is stamped with
a tick after it waits for the state of that tick and moves nothing. States come one after another:
one that is ahead waits, and is ignored unless `LINE` states follow each other there before the next
one comes here. Another message more than `WINDOW` ticks ahead waits too, and is used for its tick
if no other one comes until then.

A tick is let go when it is complete. While it is not, the ticks after it wait, until one of these:

- each topic that is missing has delivered a tick at least `REORDER` later: a publisher's messages
  arrive in order, so the missing message will not arrive;
- the states are `WINDOW` ticks ahead: the topics that are missing are then silent, and are not
  waited for until their next message;
- the log is closed.

A tick with a message that came before its state waits `HOLD` ticks for another one. Where several
messages of one topic and tick differ, the plant is asked (`ask`): from then on each tick waits for
what the plant reports of it (`report`), and a state leads once the plant has reported the tick
before it. The message that the plant published or took is let go, and the others are ignored. What
the plant does not report, nobody knows: the first message stays, and the tick has a conflict.

A plant that waits for the log brings none of these about: then nothing more is waited for
(`pass_over`).

Events are rare, and are not waited for; only the first run_status is, before tick 1. An event
whose tick is written already is passed on by itself with the last tick written: none is lost. A
topic that the plant has dropped (`drop`) is neither waited for nor missing. The wall clock has no
part in it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

REORDER = 3
"""A topic that is so many ticks further brings no message of a tick any more."""
WINDOW = 100
"""Most ticks that wait for a message, or for the plant; older ticks are not compared any more."""
LINE = 5
"""States that follow each other where the plant went on unheard."""
HOLD = 8
"""Ticks after one by which all its messages are there."""
MOST_AHEAD = 10_000
"""Messages stamped more than `WINDOW` ticks ahead that are kept, and events."""
MOST_MESSAGES = 32
"""Different messages of one topic and tick that are kept."""
MOST_HOLES = 100_000
"""Ticks without a message that are remembered for each topic."""
NEVER = 1 << 62

NOTHING = ''
"""Reported of a topic of whose messages the plant took none."""


@dataclass(slots=True)
class Counts:
    """What happened to the messages of one topic."""

    written: int = 0
    missing: int = 0
    first_missing: int | None = None
    duplicates: int = 0
    conflicts: int = 0
    late: int = 0
    ignored: int = 0


@dataclass(slots=True)
class _Tick:
    """The different messages of a tick, by topic, in the order in which they came.

    missing : number of topics with a message each tick that have none yet
    early : whether a message came before the state
    """

    messages: list[list[bytes]]
    missing: int
    events: list[tuple[int, bytes]] = field(default_factory=list)
    early: bool = False


@dataclass
class TickOrderer:
    """Orders the messages of topics with one message a tick; topic i is the i-th of a tick.

    width : number of topics; events : indices of the event topics
    awaited : index of the event topic whose first message is waited for; None: of none
    release : called with (tick, [(index, message), ...]) in the order of ticks. A second call with
        the same tick brings an event alone.
    read : returns the numbers of a message as a text, and whether it holds nothing else
    leader : index of the topic of true states
    plain : indices of the topics whose messages hold their stamp only, so that none differ
    asks_from : first tick for which the plant is asked; None: for none
    latest : tick of the newest state
    """

    width: int
    events: frozenset[int]
    awaited: int | None
    release: Callable[[int, Sequence[tuple[int, bytes]]], None]
    read: Callable[[int, bytes], tuple[str, bool]]
    leader: int = 0
    plain: frozenset[int] = frozenset()
    counts: list[Counts] = field(init=False)
    asks_from: int | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self.counts = [Counts() for _ in range(self.width)]
        self.next_tick = 0
        self._regular = [i for i in range(self.width) if i not in self.events]
        self._pending: dict[int, _Tick] = {}
        self._released: dict[int, _Tick] = {}
        self._reports: dict[int, Mapping[int, str]] = {}
        self._states_ahead: dict[int, bytes] = {}
        self._ahead: dict[tuple[int, int], bytes] = {}  # of other topics
        self._known_events: dict[tuple[int, int, bytes], None] = {}
        self._dropped: dict[int, int] = {}
        self._newest = [-1] * self.width
        self._silent = [False] * self.width
        self._holes: list[set[int]] = [set() for _ in range(self.width)]
        self.latest, self._last = -1, NEVER
        self._in_vain = False  # asked
        self._event_due = self.awaited is not None

    @property
    def waiting(self) -> int:
        """Number of messages of ticks that are not let go yet."""
        ticks = self._pending.values()
        return sum(len(tick.events) + sum(map(bool, tick.messages)) for tick in ticks)

    @property
    def reached(self) -> int:
        """The last of the states that follow the newest one: a plant that is asked is ahead."""
        tick = self.latest
        while self.messages(self.leader, tick + 1):
            tick += 1
        return tick

    @property
    def furthest(self) -> int:
        """The last tick of which something waits; -1 if nothing does."""
        return max(self._pending, default=-1)

    def messages(self, index: int, tick: int) -> Sequence[bytes]:
        """Return the different messages of a topic at a tick, as far as they are still known."""
        entry = self._pending.get(tick) or self._released.get(tick)
        return entry.messages[index] if entry is not None else ()

    def drop(self, index: int, tick: int) -> None:
        """Expect no more messages of a topic from a tick on."""
        self._dropped.setdefault(index, tick)
        self._advance()

    def end(self, tick: int) -> None:
        """Take the last tick of the flight: none follows."""
        self._last = tick
        self._advance()

    def ask(self, tick: int) -> None:
        """Let each tick from one on wait for what the plant reports of it."""
        self.asks_from = tick if self.asks_from is None else min(self.asks_from, tick)

    def report(self, tick: int, taken: Mapping[int, str]) -> None:
        """Take what the plant published or took at a tick: the numbers by topic, as `read` does.

        Two reports that differ say nothing.
        """
        if not self.next_tick - WINDOW <= tick <= self.latest + WINDOW:
            return
        self._in_vain = False
        if self._reports.setdefault(tick, taken) != taken:
            self._reports[tick] = {}
        for past in [t for t in self._reports if t < self.next_tick - WINDOW]:
            del self._reports[past]
        released = self._released.get(tick)
        if released is not None:
            self._choose(tick, released)
        self._go_on()

    def pass_over(self) -> None:
        """Wait no more for what is missing at the next tick, nor for a plant that reports nothing.

        A topic that is missing is silent until its next message.
        """
        if self._asks and not self._reports:
            self._in_vain = True
            self.latest = self.reached
        if self.latest > self.next_tick:
            for index in self._missing(self._pending.get(self.next_tick)):
                self._silent[index] = True
        self._advance()

    def add(self, index: int, tick: int, data: bytes) -> None:
        """Take one message; releases the ticks that it completes."""
        awaits = self._awaits_reports
        if index in self.events:
            self._add_event(index, tick, data)
        elif index == self.leader and tick > self.latest + (WINDOW if awaits else 1):
            self._keep_state_ahead(tick, data)
        elif tick > self.latest + WINDOW:
            self._keep_ahead(index, tick, data)
        else:
            if index == self.leader and not awaits:
                self._lead(tick)
            self._take(index, tick, data)
        self._go_on()

    def _go_on(self) -> None:
        if self._awaits_reports:
            self._follow()
        self._advance()

    @property
    def _asks(self) -> bool:
        """Whether the plant is asked what it took, from some tick on."""
        return self.asks_from is not None

    @property
    def _awaits_reports(self) -> bool:
        """Whether it is asked and not in vain: then a tick waits for what is reported of it."""
        return self._asks and not self._in_vain

    def _lead(self, tick: int) -> None:
        """Go on to a state, where it is the next one; no state ahead is of this flight."""
        if self._states_ahead:
            self.counts[self.leader].ignored += len(self._states_ahead)
            self._states_ahead.clear()
        self.latest = max(self.latest, tick)

    def _keep_state_ahead(self, tick: int, data: bytes) -> None:
        """Keep a state ahead, until states follow each other there or the next one comes."""
        if len(self._states_ahead) >= MOST_AHEAD:
            self.counts[self.leader].ignored += 1
            return
        self._states_ahead.setdefault(tick, data)
        if all(tick - back in self._states_ahead for back in range(LINE)):
            self._go_ahead(tick - LINE + 1)

    def _keep_ahead(self, index: int, tick: int, data: bytes) -> None:
        """Keep a message far ahead, until its tick is let go."""
        if len(self._ahead) >= MOST_AHEAD:
            self.counts[index].ignored += 1
        else:
            self._ahead.setdefault((index, tick), data)

    def _go_ahead(self, first: int) -> None:
        """Go on from a state ahead."""
        states = {tick: data for tick, data in self._states_ahead.items() if tick >= first}
        for tick in states:
            del self._states_ahead[tick]
        self._lead(max(states, default=self.latest))
        for tick, data in sorted(states.items()):
            self._take(self.leader, tick, data)

    def _follow(self) -> None:
        """While the plant is asked, go on to each state that it has passed on to.

        Or once a whole window of states came: then the plant reports nothing.
        """
        while self.messages(self.leader, self.latest + 1) and (
            self.latest in self._reports
            or self.latest < (self.asks_from or 0)
            or all(self.messages(self.leader, self.latest + n) for n in range(2, WINDOW + 1))
        ):
            self._lead(self.latest + 1)
            self._newest[self.leader] = self.latest
            self._silent[self.leader] = False

    def _take(self, index: int, tick: int, data: bytes) -> None:
        counts = self.counts[index]
        if tick < self.next_tick - WINDOW:  # too old to be compared with anything
            counts.late += tick in self._holes[index]
            counts.ignored += tick not in self._holes[index]
            return
        entry = self._pending.get(tick) or self._released.get(tick)
        if entry is not None and entry.messages[index]:
            if data in entry.messages[index]:
                counts.duplicates += 1
            else:
                self._add_different(index, tick, data, entry)
        elif tick < self.next_tick:
            counts.late += 1
        else:
            self._add_first(index, tick, data, entry or self._entry(tick))

    def _add_first(self, index: int, tick: int, data: bytes, entry: _Tick) -> None:
        entry.messages[index].append(data)
        entry.missing -= 1
        if index not in self.plain and index != self.leader and not entry.messages[self.leader]:
            entry.early = True
        elif tick <= self.latest:
            self._newest[index] = max(tick, self._newest[index])
            self._silent[index] = False

    def _add_different(self, index: int, tick: int, data: bytes, entry: _Tick) -> None:
        """Take a message that differs from another one of its topic and tick."""
        if len(entry.messages[index]) >= MOST_MESSAGES:
            self.counts[index].ignored += 1
            return
        entry.messages[index].append(data)
        self.ask(tick)
        if tick < self.next_tick and tick in self._reports:
            self._choose(tick, entry)

    def _entry(self, tick: int) -> _Tick:
        entry = self._pending.get(tick)
        if entry is None:
            empty: list[list[bytes]] = [[] for _ in range(self.width)]
            entry = self._pending[tick] = _Tick(empty, len(self._regular))
        return entry

    def _add_event(self, index: int, tick: int, data: bytes) -> None:
        if (index, tick, data) in self._known_events:
            self.counts[index].duplicates += 1
            return
        if tick > self.latest + WINDOW and len(self._pending) >= MOST_AHEAD:
            self.counts[index].ignored += 1
            return
        self._known_events[(index, tick, data)] = None
        if len(self._known_events) > MOST_AHEAD:
            del self._known_events[next(iter(self._known_events))]
        self._event_due = self._event_due and index != self.awaited
        if tick < self.next_tick:
            self.counts[index].written += 1
            self.release(self.next_tick - 1, [(index, data)])
        else:
            self._entry(tick).events.append((index, data))

    def close(self, last_tick: int) -> None:
        """Release every tick that waits, complete or not.

        The flight ends in the newest tick: its answers are due only if it is the last of all.
        What is stamped with a later tick is no part of it.
        """
        if self.latest < 0:
            self._go_ahead(0)
        elif self._asks and not self._reports:  # of a plant that reports nothing
            self.latest = self.reached
        for tick, data in self._states_ahead.items():
            self._take(self.leader, tick, data)
        newest = self._last if self._last != NEVER else self.latest
        for tick in [tick for tick in self._pending if tick > newest]:
            entry = self._pending[tick]
            for index, found in enumerate(entry.messages):
                self.counts[index].ignored += len(found)
                found.clear()
            entry.missing = len(self._regular)
            if not entry.events or tick > newest + 1:
                for index, _ in entry.events:
                    self.counts[index].ignored += 1
                del self._pending[tick]
        while self._pending:
            self._skip(min(self._pending))
            self._let_go(due=self.next_tick < newest or self.next_tick == last_tick)
        for tick in list(self._released):
            self._forget(tick)
        for index, _ in self._ahead:
            self.counts[index].ignored += 1

    def _choose(self, tick: int, entry: _Tick) -> None:
        """Leave one of several messages of a topic, the one that the plant reports.

        Of messages with the same numbers it is the one that holds nothing else. A tick that is
        written keeps its message.
        """
        report, written = self._reports.get(tick, {}), tick < self.next_tick
        for index, found in enumerate(entry.messages):
            numbers = report.get(index)
            if not found or (len(found) == 1 and (numbers is None or written)):
                continue
            read = {data: self.read(index, data) for data in found}
            first = read[found[0]][0]
            alike = all(text == first for text, _ in read.values())
            if numbers == NOTHING or (numbers is None and alike):
                numbers = first
            right = [data for data in found if read[data][0] == numbers]
            if not right or (written and found[0] not in right):
                self.counts[index].conflicts += max(1, len(found) - 1)
            else:
                self.counts[index].ignored += len(found) - 1
            if right and not written:
                found[0] = next((data for data in right if read[data][1]), right[0])
            del found[1:]

    def _advance(self) -> None:
        while self.latest >= self.next_tick and self._settled():
            if self.next_tick not in self._pending:
                ahead = min(min(self._pending, default=NEVER), self.latest - WINDOW + 1)
                self._skip(max(ahead, self.next_tick + 1) - 1)
            self._let_go()

    def _settled(self) -> bool:
        """Return whether nothing more is waited for at the next tick."""
        tick, entry = self.next_tick, self._pending.get(self.next_tick)
        ahead = self.latest - tick
        if ahead < 1 and entry is not None and entry.missing and not self._dropped:
            return False
        if self._event_due and tick > 0:
            self._event_due = ahead < WINDOW
            if self._event_due:
                return False
        if self._awaits_reports and tick >= (self.asks_from or 0):
            if tick not in self._reports and ahead < WINDOW:
                return False
        elif entry is not None and entry.early and self.latest < min(tick + HOLD, self._last):
            return False
        missing = self._missing(entry) if entry is None or entry.missing else []
        if entry is not None and not missing:
            missing = self._wrong(tick, entry) if tick in self._reports else []
            if not missing:
                return True
        if ahead < 1:  # the newest tick of all may still be completed
            return False
        if ahead >= WINDOW:
            for i in missing:
                self._silent[i] = self._newest[i] < tick
            return True
        return all(self._silent[i] or self._newest[i] >= tick + REORDER for i in missing)

    def _missing(self, entry: _Tick | None) -> list[int]:
        """Return the topics whose message of the next tick is still expected."""
        return [
            index
            for index in self._regular
            if (entry is None or not entry.messages[index])
            and not (self._dropped and self.next_tick >= self._dropped.get(index, NEVER))
        ]

    def _wrong(self, tick: int, entry: _Tick) -> list[int]:
        """Return the topics of a tick whose message is not yet the one that the plant reports."""
        return [
            index
            for index, numbers in self._reports[tick].items()
            if numbers != NOTHING
            and all(self.read(index, data)[0] != numbers for data in entry.messages[index])
        ]

    def _skip(self, tick: int) -> None:
        """Pass over the ticks before one, of which nothing came."""
        for index in self._missing(None) if tick > self.next_tick else ():
            self._miss(index, self.next_tick, tick)
        self.next_tick = max(self.next_tick, tick)

    def _miss(self, index: int, first: int, end: int) -> None:
        """Count the ticks of which a topic has no message."""
        counts = self.counts[index]
        counts.missing += end - first
        if counts.first_missing is None:
            counts.first_missing = first
        room = MOST_HOLES - len(self._holes[index])
        self._holes[index].update(range(first, min(end, first + room)))

    def _let_go(self, due: bool = True) -> None:
        """Release the next tick; one of which nothing came is counted and passed over."""
        tick = self.next_tick
        entry = self._pending.pop(tick, None)
        if entry is not None and self._ahead:
            self._fill(tick, entry)
        if due and (entry is None or entry.missing):
            for index in self._missing(entry):
                self._miss(index, tick, tick + 1)
        if entry is not None and self._asks:
            self._choose(tick, entry)
        self.next_tick = tick + 1
        self._forget(tick - WINDOW)
        if entry is not None:
            found = [(i, data) for i, messages in enumerate(entry.messages) for data in messages]
            found += entry.events
            for index, _ in found:
                self.counts[index].written += 1
            self._released[tick] = entry
            self.release(tick, found)

    def _fill(self, tick: int, entry: _Tick) -> None:
        """Put a message that came far ahead where no other one came."""
        for index in self._regular:
            data = self._ahead.pop((index, tick), None)
            if data is not None and entry.messages[index]:
                self.counts[index].ignored += 1
            elif data is not None:
                entry.messages[index].append(data)
                entry.missing -= 1

    def _forget(self, tick: int) -> None:
        """Forget a tick that was let go; nobody reports what came of it later any more."""
        entry = self._released.pop(tick, None)
        if entry is not None and self._asks:
            self._choose(tick, entry)
