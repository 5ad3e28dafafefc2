# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A faulty link, without ROS: what becomes of each message that is sent over it.

`FaultyLink` applies faults; which message a fault hits is drawn apart. `SeededLink` draws from a
seed, a message at a time: the node `fault_injector` needs no ticks for it. Campaigns draw from
(key, tick), so that runs can be flown in any order (`rpo.montecarlo.faults`).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import partial
from random import Random
from typing import Annotated, Generic, TypeVar

from rpo_core.files.validation import Checked, InputError, real

Message = TypeVar('Message')

# Not 'nan' and 'infinity': rcl takes these for numbers on the command line.
NAN, INFINITY, WRONG_FRAME, WRONG_STAMP = 'not_a_number', 'infinite', 'wrong_frame', 'wrong_stamp'
CORRUPTIONS = (NAN, INFINITY, WRONG_FRAME, WRONG_STAMP)


Share = Annotated[float, partial(real, least=0.0, most=1.0)]


@dataclass(frozen=True)
class FaultRates(Checked):
    """Shares in [0, 1] of the messages that each fault hits; each fault is applied independently.

    drop : lost, whatever else hits the message
    freeze : the message passed on before comes in its place
    corrupt : changed, see CORRUPTIONS
    delay : passed on some messages, or some time, later
    reorder : passed on after its successor, unless it is delayed
    repeat : passed on twice
    """

    drop: Share = 0.0
    freeze: Share = 0.0
    corrupt: Share = 0.0
    delay: Share = 0.0
    reorder: Share = 0.0
    repeat: Share = 0.0


KINDS = tuple(field.name for field in fields(FaultRates))

Hits = Mapping[str, str]
"""The faults that hit a message: kind -> corruption, '' for the other kinds."""


@dataclass(frozen=True)
class Schedule:
    """Ticks at which faults happen, both ends included; `last` infinite: to the end.

    A message whose stamp is that of no tick has faults only if the schedule covers all ticks.
    """

    first: float = 0.0
    last: float = math.inf

    def __post_init__(self) -> None:
        if not self.first <= self.last:
            raise InputError(f'`to_tick` must be >= from_tick = {self.first!r}; got {self.last!r}')

    def covers(self, tick: int | None) -> bool:
        """Return whether faults may hit a message of this tick."""
        if tick is None:
            return self == Schedule()
        return self.first <= tick <= self.last


@dataclass
class _Held(Generic[Message]):
    """What goes out once `left` more messages have come, or at a time; `left` 0: by time."""

    left: int
    due_s: float
    out: list[tuple[Message, str]]


class FaultyLink(Generic[Message]):
    """Passes messages on, or not, or otherwise.

    delay_messages : how many messages later a delayed one is passed on, >= 1
    delay_s : how much later instead, if > 0; then `due` must be asked now and again
    """

    def __init__(self, delay_messages: int = 2, delay_s: float = 0.0) -> None:
        self.counts: Counter[str] = Counter()
        self._delay_messages = 0 if delay_s > 0.0 else delay_messages
        self._delay_s = delay_s
        self._held: list[_Held[Message]] = []
        self._last: Message | None = None

    @property
    def held(self) -> int:
        """How many messages are on their way."""
        return sum(len(held.out) for held in self._held)

    def send(self, message: Message, hits: Hits, now_s: float = 0.0) -> list[tuple[Message, str]]:
        """Return what goes out now, in this order, each with its corruption ('' if none).

        hits : the faults of this message; those held back come out all the same
        now_s : of a steady clock, for delays by time
        """
        self.counts['received'] += 1
        out, wait = self._fate(message, hits)
        for held in self._held:
            held.left -= held.left > 0
        due = self._release(lambda held: held.left == 0 and held.due_s == 0.0)
        if wait or (out and 'delay' in hits):
            due_s = 0.0 if wait else now_s + self._delay_s
            self._held.append(_Held(wait, due_s, out))
            out = []
        out = out + due
        self.counts['sent'] += len(out)
        return out

    def due(self, now_s: float) -> list[tuple[Message, str]]:
        """Return what goes out by time, each with its corruption ('' if none)."""
        out = self._release(lambda held: 0.0 < held.due_s <= now_s)
        self.counts['sent'] += len(out)
        return out

    def _fate(self, message: Message, hits: Hits) -> tuple[list[tuple[Message, str]], int]:
        """Return what becomes of a message, and after how many others it goes out."""
        if 'drop' in hits:
            self.counts['drop'] += 1
            return [], 0
        for kind, corruption in hits.items():
            self.counts[corruption or kind] += 1
        if 'freeze' in hits and self._last is not None:
            message = self._last
        self._last = message
        wait = self._delay_messages if 'delay' in hits else int('reorder' in hits)
        return [(message, hits.get('corrupt', ''))] * (1 + ('repeat' in hits)), wait

    def _release(self, ready: Callable[[_Held[Message]], bool]) -> list[tuple[Message, str]]:
        out = [pair for held in self._held if ready(held) for pair in held.out]
        self._held = [held for held in self._held if not ready(held)]
        return out


class SeededLink(FaultyLink[Message]):
    """A link whose faults are drawn as messages come; the same seed gives the same faults.

    Every message draws the same number of random numbers, one for each kind, whatever the rates:
    a higher rate of one kind adds faults of that kind and moves no fault of another.

    rates : how often what happens
    seed : of the random numbers
    corruptions : of CORRUPTIONS, those that may happen
    """

    def __init__(
        self,
        rates: FaultRates,
        seed: int,
        delay_messages: int = 2,
        corruptions: tuple[str, ...] = CORRUPTIONS,
        delay_s: float = 0.0,
    ) -> None:
        super().__init__(delay_messages, delay_s)
        self.rates = rates
        self._corruptions = corruptions
        self._random = Random(seed)

    def take(
        self, message: Message, faulty: bool = True, now_s: float = 0.0
    ) -> list[tuple[Message, str]]:
        """Return what goes out now, as `send` does; `faulty`: whether faults may hit it."""
        # Only random(): of the generator's methods it alone is the same in every Python.
        drawn = {kind: self._random.random() for kind in KINDS}
        which = self._corruptions[int(self._random.random() * len(self._corruptions))]
        hits = {
            kind: which if kind == 'corrupt' else ''
            for kind in KINDS
            if faulty and drawn[kind] < getattr(self.rates, kind)
        }
        return self.send(message, hits, now_s)
