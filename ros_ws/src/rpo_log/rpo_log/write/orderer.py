# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages in any order of arrival to ticks in order: two logs of one run are the same bytes.

One topic, the true state, leads: its newest tick is where the run is. Whatever else is stamped with
a tick after it waits for the state of that tick and moves nothing. States come one after another:
one that is ahead waits, and is ignored unless `LINE` states follow each other there before the next
one comes here.

A tick is let go when it is complete. While it is not, the ticks after it wait, until one of these:

- each topic that is missing has delivered a tick at least `REORDER` later: a publisher's messages
  arrive in order, so the missing message will not arrive;
- the states are `WINDOW` ticks ahead: the topics that are missing are then silent, and are not
  waited for until their next message;
- the log is closed.

A tick with several different messages of one topic, or with a message that came before its state,
waits `reach` ticks: what follows shows which message acted (`judge`). The others are ignored. From
then on (`wary`), a state leads only once it follows from the one before it.

Events are rare, and are not waited for; only the first run_status is, before tick 1. An event
whose tick is written already is passed on by itself with the last tick written: none is lost. A
topic that the plant has dropped (`drop`) is neither waited for nor missing. The wall clock has no
part in it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from rpo_log.write.tick_messages import (
    HOLD,
    LINE,
    MOST_CANDIDATES,
    MOST_EARLY,
    MOST_HELD,
    MOST_HOLES,
    NEVER,
    REORDER,
    WINDOW,
    Candidates,
    Counts,
    TickMessages,
    no_judge,
)


@dataclass
class TickOrderer:
    """Orders the messages of topics with one message a tick; topic i is the i-th of a tick.

    width : number of topics; events : indices of the event topics
    awaited : index of the event topic whose first message is waited for; None: of none
    release : called with (tick, [(index, message), ...]) in the order of ticks. A second call with
        the same tick brings an event alone.
    leader : index of the topic of true states
    plain : indices of the topics whose messages hold their stamp only, so that none differ
    judge : returns which message of a topic acted at a tick; None if that is not known
    tells : whether `judge` knows which state follows; else the first one that comes leads
    reach : ticks after one that show which of its messages acted
    """

    width: int
    events: frozenset[int]
    awaited: int | None
    release: Callable[[int, Sequence[tuple[int, bytes]]], None]
    leader: int = 0
    plain: frozenset[int] = frozenset()
    judge: Callable[[int, int, Candidates], bytes | None] = no_judge
    tells: bool = False
    reach: int = HOLD
    counts: list[Counts] = field(init=False)

    def __post_init__(self) -> None:
        self.counts = [Counts() for _ in range(self.width)]
        self.next_tick = 0
        self.wary = False
        self._regular = [i for i in range(self.width) if i not in self.events]
        self._pending: dict[int, TickMessages] = {}
        self._released: dict[int, list[bytes | None]] = {}
        self._known_events: dict[tuple[int, int, bytes], None] = {}
        self._dropped: dict[int, int] = {}
        self._newest = [-1] * self.width
        self._silent = [False] * self.width
        self._holes: list[set[int]] = [set() for _ in range(self.width)]
        self._far: dict[int, bytes] = {}
        self._latest, self._last = -1, NEVER
        self._event_due = self.awaited is not None

    @property
    def waiting(self) -> int:
        """Number of messages of ticks that are not let go yet."""
        return sum(tick.waiting for tick in self._pending.values())

    @property
    def latest(self) -> int:
        """Tick of the newest state."""
        return self._latest

    def candidates(self, index: int, tick: int) -> Sequence[bytes]:
        """Return the messages of a topic at a tick; one at most if the tick was let go."""
        entry = self._pending.get(tick)
        known = entry.messages if entry is not None else self._released.get(tick)
        first = known[index] if known is not None else None
        if first is None:
            return ()
        return (first, *entry.others.get(index, ())) if entry is not None else (first,)

    def drop(self, index: int, tick: int) -> None:
        """Expect no more messages of a topic from a tick on."""
        self._dropped.setdefault(index, tick)
        self._advance()

    def end(self, tick: int) -> None:
        """Take the last tick of the flight: none follows, and nothing waits for more."""
        self._last = tick
        self._advance()

    def add(self, index: int, tick: int, data: bytes) -> None:
        """Take one message; releases the ticks that it completes."""
        if index in self.events:
            self._add_event(index, tick, data)
        elif index == self.leader:
            self._lead(tick, data)
        else:
            self._take(index, tick, data)
        if self.wary:
            self._follow()
        self._advance()

    def _lead(self, tick: int, data: bytes) -> None:
        """Take a state: the next one moves the line, one ahead waits until others follow it."""
        if self.wary and tick <= self._latest + WINDOW:
            self._take(self.leader, tick, data)
        elif tick <= self._latest + 1:
            self._ignore_far()
            self._latest = max(self._latest, tick)
            self._take(self.leader, tick, data)
        elif len(self._far) < MOST_HELD:
            self._far[tick] = data
            if all(tick - back in self._far for back in range(LINE)):
                self._follow_far(tick - LINE + 1)

    def _ignore_far(self) -> None:
        self.counts[self.leader].ignored += len(self._far)
        self._far.clear()

    def _follow_far(self, first: int) -> None:
        """Go on from a state ahead of the line."""
        for tick in sorted(self._far):
            if tick >= first:
                data = self._far.pop(tick)
                self._latest = tick
                self._take(self.leader, tick, data)
        self._ignore_far()

    def _follow(self) -> None:
        """In doubt, go on to the next state once it follows from the one before it.

        Or once a whole window of states came: then a message is missing that would show it.
        """
        while self.candidates(self.leader, self._latest + 1) and (
            self._follows(self._latest + 1)
            or all(
                self.candidates(self.leader, self._latest + ahead) for ahead in range(WINDOW, 1, -1)
            )
        ):
            self._latest += 1
            self._newest[self.leader] = self._latest
            self._silent[self.leader] = False

    def _follows(self, tick: int) -> bool:
        """Return whether a state follows from the one before; it becomes the first of its tick."""
        if not self.tells:
            return True
        state = self.judge(self.leader, tick, self.candidates)
        if state is not None:
            self._prefer(self._pending[tick], self.leader, state)
        return state is not None

    def _take(self, index: int, tick: int, data: bytes) -> None:
        entry, near = self._pending.get(tick), tick <= self._latest + WINDOW
        if entry is not None and near:  # nobody answers so far ahead
            self.counts[index].ignored += entry.forget_far(index)
        if entry is not None and entry.messages[index] is None:
            self._keep(entry, index, tick, data)
        elif self._fresh(index, tick, data):
            if not near and len(self._pending) >= MOST_HELD:
                self.counts[index].ignored += 1
                return
            entry = self._pending[tick] = TickMessages([None] * self.width, len(self._regular))
            self._keep(entry, index, tick, data)

    def _keep(self, entry: TickMessages, index: int, tick: int, data: bytes) -> None:
        entry.messages[index] = data
        entry.missing -= 1
        if index not in self.plain and index != self.leader and not entry.messages[self.leader]:
            entry.came_ahead(index, far=tick > self._latest + WINDOW)
        elif tick <= self._latest and tick > self._newest[index]:
            self._newest[index] = tick
            self._silent[index] = False

    def _add_event(self, index: int, tick: int, data: bytes) -> None:
        if (index, tick, data) in self._known_events:
            self.counts[index].duplicates += 1
            return
        if tick > self._latest + WINDOW and len(self._pending) >= MOST_HELD:
            self.counts[index].ignored += 1
            return
        self._known_events[(index, tick, data)] = None
        if len(self._known_events) > MOST_HELD:
            del self._known_events[next(iter(self._known_events))]
        self._event_due = self._event_due and index != self.awaited
        if tick < self.next_tick:
            self.counts[index].written += 1
            self.release(self.next_tick - 1, [(index, data)])
        else:
            entry = self._pending.setdefault(
                tick, TickMessages([None] * self.width, len(self._regular))
            )
            entry.events.append((index, data))

    def close(self, last_tick: int) -> None:
        """Release every tick that waits, complete or not.

        The flight ends in the newest tick: its answers are due only if it is the last of all.
        What is stamped with a later tick is no part of it.
        """
        for tick, data in self._far.items():
            if self._latest < 0 or tick <= self._last < NEVER:
                self._take(self.leader, tick, data)
        if self._latest < 0:
            self._latest = max(self._far, default=-1)
        self._far.clear()
        newest = self._last if self._last != NEVER else self._latest
        for tick in [tick for tick in self._pending if tick > newest]:
            entry = self._pending[tick]
            for index in self._regular:
                self.counts[index].ignored += entry.messages[index] is not None
            entry.messages, entry.missing = [None] * self.width, len(self._regular)
            entry.others.clear()
            if not entry.events or tick > newest + 1:
                for index, _ in entry.events:
                    self.counts[index].ignored += 1
                del self._pending[tick]
        while self._pending:
            self._skip(min(self._pending))
            self._let_go(due=self.next_tick < newest or self.next_tick == last_tick)

    def _fresh(self, index: int, tick: int, data: bytes) -> bool:
        """Return whether a message is the first of its tick, and count it if it is not."""
        counts = self.counts[index]
        if tick < self.next_tick - WINDOW:  # too old to be compared with anything
            counts.late += tick in self._holes[index]
            counts.ignored += tick not in self._holes[index]
            return False
        known = self.candidates(index, tick)
        if data in known:
            counts.duplicates += 1
            entry = self._pending.get(tick)
            if entry and entry.gives_way(index, self.leader, self._latest - tick):
                self._prefer(entry, index, data)
            return False
        if known:
            self._contradict(index, tick, data)
            return False
        if tick >= self.next_tick:
            return True
        counts.late += 1
        return False

    def _contradict(self, index: int, tick: int, data: bytes) -> None:
        """Take a message that differs from the one before."""
        self.wary = True
        entry = self._pending.get(tick)
        if entry is None:  # one is written already
            known = self.candidates(index, tick)
            both = {(index, tick): (*known, data)}
            acted = self.judge(index, tick, lambda i, k: both.get((i, k)) or self.candidates(i, k))
            self._settle(index, tick, known[0], acted)
            return
        others = entry.others.setdefault(index, [])
        early = index != self.leader and entry.messages[self.leader] is None
        if len(others) >= (MOST_EARLY if early else MOST_CANDIDATES):
            self.counts[index].ignored += 1
            return
        others.append(data)
        if entry.gives_way(index, self.leader, self._latest - tick):
            self._prefer(entry, index, data)

    def _prefer(self, entry: TickMessages, index: int, data: bytes) -> None:
        """Put a message before those that came ahead of the state: they can be no answer to it."""
        first = entry.messages[index]
        entry.early.discard(index)
        if first is not None and first != data:
            others = entry.others[index]
            others.remove(data)
            others.append(first)
            entry.messages[index] = data

    def _settle(self, index: int, tick: int, kept: bytes | None, acted: bytes | None) -> None:
        """Count a contradiction: ignored if the message that is kept is known to have acted."""
        counts = self.counts[index]
        after = tick >= self._last - (self.reach - HOLD)  # its force would act after the end
        nothing_acts = acted is None and after and self.judge is not no_judge
        if nothing_acts or (acted is not None and acted == kept):
            counts.ignored += 1
            return
        counts.conflicts += 1
        if counts.first_conflict is None:
            counts.first_conflict = tick

    def _advance(self) -> None:
        while self._latest >= self.next_tick and self._settled():
            if self.next_tick not in self._pending:
                ahead = min(min(self._pending, default=NEVER), self._latest - WINDOW + 1)
                self._skip(max(ahead, self.next_tick + 1) - 1)
            self._let_go()

    def _settled(self) -> bool:
        """Return whether nothing more is waited for at the next tick."""
        entry = self._pending.get(self.next_tick)
        ahead = self._latest - self.next_tick
        if self._event_due and self.next_tick > 0:
            self._event_due = ahead < WINDOW
            if self._event_due:
                return False
        doubt = self.wary or (entry is not None and (entry.others or entry.early))
        if doubt and self._latest < min(self.next_tick + self.reach, self._last):
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

    def _missing(self, entry: TickMessages | None) -> list[int]:
        """Return the topics whose message of the next tick is still expected."""
        return [
            index
            for index in self._regular
            if (entry is None or entry.messages[index] is None)
            and not (self._dropped and self.next_tick >= self._dropped.get(index, NEVER))
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
        entry = self._pending.get(tick)
        if entry is not None and entry.others:
            self._choose(tick, entry)
        if due and (entry is None or entry.missing):
            for index in self._missing(entry):
                self._miss(index, tick, tick + 1)
        self._pending.pop(tick, None)
        self.next_tick = tick + 1
        self._released.pop(tick - WINDOW - self.reach, None)
        if entry is not None:
            found = [(i, data) for i, data in enumerate(entry.messages) if data is not None]
            found += entry.events
            for index, _ in found:
                self.counts[index].written += 1
            self._released[tick] = entry.messages
            self.release(tick, found)

    def _choose(self, tick: int, entry: TickMessages) -> None:
        """Keep of several messages of a topic the one that acted, as far as that is known."""
        for index in sorted(entry.others):
            acted = self.judge(index, tick, self.candidates)
            kept = acted if acted is not None else entry.messages[index]
            for other in self.candidates(index, tick):
                if other != kept:
                    self._settle(index, tick, kept, acted)
            entry.messages[index] = kept
            del entry.others[index]
