# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of a log to arrays: those of each topic together, the few that are unlike one by one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from rpo_core.wire import cdr
from rpo_core.wire.cdr import Layout
from rpo_log.errors import LogError
from rpo_log.format.run import TimeBase
from rpo_log.read.records import MESSAGE_HEAD, RECORD_HEAD
from rpo_log.topics import Topic

_HEAD = np.dtype(
    [
        ('length', '<u8'), ('channel', '<u2'), ('tick', '<u4'), ('log_ns', '<i8'),
        ('publish_ns', '<i8'), ('cdr', '<u2'), ('options', '<u2'), ('s', '<i4'), ('ns', '<u4'),
    ]
)  # fmt: skip
"""A message record from its length to the stamp in its data."""

_PLACE = np.dtype([('topic', np.intp), ('tick', '<i8'), ('start', np.intp), ('size', '<i8')])

_LEAST_DATA = 12
"""Bytes of a message up to and with its stamp."""

_LITTLE_ENDIAN = int.from_bytes(cdr.HEADER[:2], 'little')
_NS = 1_000_000_000


class Message(NamedTuple):
    """One message, as it was logged."""

    topic: Topic
    tick: int
    data: bytes


class Event(NamedTuple):
    """One message of an event topic."""

    tick: int
    signal: str
    status: cdr.Status

    @property
    def values(self) -> dict[str, str]:
        """Its values by their keys."""
        return dict(self.status.values)


@dataclass(frozen=True)
class TickBlock:
    """Some ticks of a log, in order.

    ticks : (n,) int64
    values : by signal, (n, width) its numbers; NaN where the message is missing
    present : by signal, (n,) bool, which ticks have its message
    events : of these ticks
    non_canonical : messages that hold more than a stamp and the numbers of their signal: another
        frame, an attitude, a torque, a covariance
    """

    ticks: NDArray[np.int64]
    values: Mapping[str, NDArray[np.float64]]
    present: Mapping[str, NDArray[np.bool_]]
    events: tuple[Event, ...] = ()
    non_canonical: tuple[Message, ...] = ()


@dataclass(frozen=True)
class Messages:
    """Some messages of one file in their order, still in the bytes of their chunks.

    raw : the bytes
    topics : of the run
    places : (n,) topic, an index in `topics`; tick; start and size of its data in `raw`
    """

    path: Path
    raw: bytes
    topics: Sequence[Topic]
    places: NDArray[np.void]

    def __len__(self) -> int:
        return len(self.places)

    def __iter__(self) -> Iterator[Message]:
        return map(self.__getitem__, range(len(self)))

    def __getitem__(self, i: int) -> Message:
        topic, tick, start, size = self.places[i].tolist()
        return Message(self.topics[topic], tick, self.raw[start : start + size])

    def bad(self, message: Message, error: cdr.CdrError) -> LogError:
        """Return the LogError of a message that is not of its type."""
        topic, tick, _ = message
        return LogError(self.path, f'tick {tick} of {topic.name}: a {topic.type} {error}')

    def block(self) -> TickBlock:
        """Return them as arrays; raises LogError."""
        is_event = np.array([topic.is_event for topic in self.topics])[self.places['topic']]
        ticks = np.unique(self.places['tick'][~is_event])
        values, present = {}, {}
        events: list[Event] = []
        non_canonical: list[Message] = []
        for index, topic in enumerate(self.topics):
            places = np.flatnonzero(self.places['topic'] == index)
            if topic.is_event:
                events += map(self._event, places.tolist())
                continue
            at = self.places['tick'][places]
            if len(again := at[1:][at[1:] == at[:-1]]):
                raise LogError(self.path, f'has tick {again[0]} of {topic.name} twice')
            rows = np.searchsorted(ticks, at)
            there = np.zeros(len(ticks), dtype=bool)
            there[rows] = True
            numbers, unlike = self._numbers(topic, places)
            non_canonical += unlike
            table = np.full((len(ticks), numbers.shape[1]), np.nan)
            table[rows] = numbers
            width = len(topic.row.columns)
            present[topic.signal] = there
            if width:
                values[topic.signal] = np.ascontiguousarray(table[:, :width])
            if topic.row.rider:
                values[topic.row.rider] = np.ascontiguousarray(table[:, width:])
                present[topic.row.rider] = there
        events.sort(key=lambda event: event.tick)
        non_canonical.sort(key=lambda message: message.tick)
        return TickBlock(ticks, values, present, tuple(events), tuple(non_canonical))

    def _numbers(
        self, topic: Topic, places: NDArray[np.intp]
    ) -> tuple[NDArray[np.float64], list[Message]]:
        """Return the numbers (n, width) in the messages of a topic, and those that are unlike."""
        layout = topic.row.layout.like(self[int(places[0])].data if len(places) else b'')
        numbers = np.full((len(places), len(layout.columns)), np.nan)
        like = self.places['size'][places] == layout.size
        data = _cut(self.raw, self.places['start'][places[like]], layout.size)
        stamp_ns = np.ascontiguousarray(data[:, cdr.STAMP_AT + 4 : cdr.STAMP_AT + 8]).view('<u4')
        plain = stamp_ns[:, 0] < _NS
        for part in _fixed_parts(layout):
            plain &= (data[:, part] == np.frombuffer(layout.plain[part], np.uint8)).all(axis=1)
        used = 0
        for place, run in layout.runs:
            several = np.ascontiguousarray(data[:, place : place + run.size]).view('<f8')
            numbers[like, used : used + several.shape[1]] = several
            used += several.shape[1]
        like[like] = plain
        unlike = []
        for row in np.flatnonzero(~like | (layout is not topic.row.layout)).tolist():
            message = self[int(places[row])]
            try:
                numbers[row] = topic.row.layout.decode(message.data)[1]
            except cdr.CdrError as error:
                raise self.bad(message, error) from None
            unlike.append(message)
        return numbers, unlike

    def _event(self, i: int) -> Event:
        message = self[i]
        try:
            return Event(message.tick, message.topic.signal, cdr.decode_status(message.data))
        except cdr.CdrError as error:
            raise self.bad(message, error) from None


def _cut(raw: bytes, start: NDArray[np.intp], size: int) -> NDArray[np.uint8]:
    """Return the `size` bytes that begin at each start, as rows."""
    if not len(start):
        return np.empty((0, size), dtype=np.uint8)
    return sliding_window_view(np.frombuffer(raw, np.uint8), size)[start]


@lru_cache(maxsize=64)
def _fixed_parts(layout: Layout) -> tuple[slice, ...]:
    """Return the parts of a message that are the same in each: all but its stamp and numbers."""
    free = [
        (cdr.STAMP_AT, cdr.STAMP_AT + 8),
        *sorted((at, at + run.size) for at, run in layout.runs),
    ]
    ends = [0, *(end for _, end in free)], [*(begin for begin, _ in free), layout.size]
    return tuple(slice(a, b) for a, b in zip(*ends, strict=True) if a < b)


@dataclass
class Gathering:
    """Messages of one file on their way from its chunks to blocks of whole ticks.

    channels : by id; a channel that is not there, or whose topic is not, is not of the run
    newest : last tick that was taken
    size : bytes that wait
    """

    path: Path
    base: TimeBase
    topics: Sequence[Topic]
    channels: Mapping[int, Topic]
    newest: int = -1
    _pieces: list[bytes] = field(default_factory=list)
    _at: list[int] = field(default_factory=list)
    size: int = 0

    def __len__(self) -> int:
        return len(self._at)

    def add(self, records: bytes, at: Sequence[int]) -> None:
        """Take the records of a chunk, and where the content of each message begins."""
        size = self.size
        self._at += [size + begin for begin in at] if size else at
        self._pieces.append(records)
        self.size += len(records)

    def take(self, last: bool = False) -> Messages:
        """Return what came and forget it; raises LogError.

        last : with the newest tick, of which otherwise more may come
        """
        raw = b''.join([*self._pieces, bytes(_HEAD.itemsize)])
        taken = self._checked(raw, np.array(self._at, dtype=np.intp))
        ticks, starts = taken.places['tick'], taken.places['start']
        count = len(taken)
        if not last and count:
            count = int(np.searchsorted(ticks, ticks[-1]))
        self._pieces, self._at, self.size = [], [], 0
        if count < len(taken):
            begin = int(starts[count]) - MESSAGE_HEAD.size - RECORD_HEAD.size
            rest = starts[count:] - MESSAGE_HEAD.size - begin
            self.add(raw[begin : -_HEAD.itemsize], rest.tolist())
        self.newest = int(ticks[count - 1]) if count else self.newest
        return Messages(self.path, raw, self.topics, taken.places[:count])

    def _checked(self, raw: bytes, at: NDArray[np.intp]) -> Messages:
        """Return the messages of the run, each with the times of its tick, in order."""
        heads = _cut(raw, at - 8, _HEAD.itemsize).view(_HEAD)[:, 0]
        of_channel = np.full(1 << 16, -1, dtype=np.intp)
        for number, topic in self.channels.items():
            if topic in self.topics:
                of_channel[number] = self.topics.index(topic)
        ours = of_channel[heads['channel']] >= 0
        heads = heads[ours]
        places = np.empty(len(heads), dtype=_PLACE)
        index = places['topic'] = of_channel[heads['channel']]
        tick = places['tick'] = heads['tick'].astype(np.int64)
        size = places['size'] = heads['length'].astype(np.int64) - MESSAGE_HEAD.size
        places['start'] = at[ours] + MESSAGE_HEAD.size
        taken = Messages(self.path, raw, self.topics, places)
        due = self.base.epoch_ns + tick * self.base.dt_ns
        sound = (size >= 0) & (heads['log_ns'] == due) & (heads['publish_ns'] == due)
        sound &= tick <= self.base.last_tick
        stamp = heads['s'].astype(np.int64) * _NS + heads['ns']
        is_event = np.array([t.is_event for t in self.topics], dtype=bool)[index]
        sound &= is_event | (
            (size >= _LEAST_DATA) & (heads['cdr'] == _LITTLE_ENDIAN) & (stamp == due)
        )
        for i in np.flatnonzero(~sound).tolist():
            self._refuse(taken, i, heads[i])
        before = np.concatenate([[self.newest], tick])[:-1]
        for i in np.flatnonzero(tick < before).tolist():
            name = taken[i].topic.name
            sentence = f'tick {tick[i]} of {name} comes after tick {before[i]}'
            raise LogError(self.path, f'runs backwards: {sentence}')
        return taken

    def _refuse(self, messages: Messages, i: int, head: np.void) -> None:
        """Raise the LogError of a message whose times are not those of its tick."""
        if messages.places['size'][i] < 0:
            raise LogError(self.path, 'is corrupt: a message record is too short')
        topic, tick, data = messages[i]
        due = self.base.stamp_ns(tick)
        try:
            stamp = due if topic.is_event else cdr.stamp_ns(data)
        except cdr.CdrError as error:
            raise messages.bad(messages[i], error) from None
        wanted = f'{due} ns of its tick, at most {self.base.last_tick}'
        times = f'stamp {stamp}, log time {head["log_ns"]}, publish time {head["publish_ns"]}'
        sentence = f'tick {tick} of {topic.name} must have the time {wanted}; got {times}'
        raise LogError(self.path, sentence)
