# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages of a log to arrays: many ticks at once where they are alike, one by one where not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from rpo_core import cdr
from rpo_log import topics
from rpo_log.errors import Kind, LogError
from rpo_log.run import TimeBase
from rpo_log.scan import Record
from rpo_log.topics import Topic

RECORD_HEAD = 31
"""Bytes of a message record before its data: opcode, length, channel, sequence, two times."""

_NS = 1_000_000_000
_WIDTHS = {
    topics.STATE: 6,
    topics.FORCE: 3,
    topics.DISTURBANCE: 3,
    topics.NAVIGATION: 6,
    topics.APPLIED: 3,
    topics.APPLIED_DISTURBANCE: 3,
}
"""Numbers in a message of each role."""


class Odd(NamedTuple):
    """A message with something else in it than its stamp and its state or force.

    Another frame, an attitude, a torque, a covariance.
    """

    tick: int
    topic: Topic
    data: bytes


@dataclass(frozen=True)
class Block:
    """Some ticks of a log, in order; NaN where a message lacks.

    ticks : (n,) int64
    states : (n, 6) x, y, z [m], vx, vy, vz [m/s], target LVLH
    forces_n, disturbances_n : (n, 3) N, target LVLH
    navigation : (n, 6) like states, what the controller saw
    applied_n, applied_disturbances_n : (n, 3) N, what was flown in free running
    present : per role, (n,) bool, which ticks have its message
    statuses : (tick, status) of these ticks
    odd : messages that hold more than these arrays do
    """

    ticks: NDArray[np.int64]
    states: NDArray[np.float64]
    forces_n: NDArray[np.float64]
    disturbances_n: NDArray[np.float64]
    navigation: NDArray[np.float64]
    applied_n: NDArray[np.float64]
    applied_disturbances_n: NDArray[np.float64]
    present: Mapping[str, NDArray[np.bool_]]
    statuses: tuple[tuple[int, cdr.Status], ...] = ()
    odd: tuple[Odd, ...] = ()


class Message(NamedTuple):
    """One message of a chunk."""

    topic: Topic
    tick: int
    data: bytes


def split_message(
    record: Record, channels: Mapping[int, Topic], base: TimeBase, path: Path
) -> Message | None:
    """Return a message record, checked; None if its channel is not of the run. Raises LogError."""
    content = record.content
    if len(content) < RECORD_HEAD - 9:
        raise LogError(Kind.CORRUPT, path, 'is corrupt: a message record is too short')
    topic = channels.get(int.from_bytes(content[0:2], 'little'))
    if topic is None:
        return None
    tick = int.from_bytes(content[2:6], 'little')
    times = (int.from_bytes(content[6:14], 'little'), int.from_bytes(content[14:22], 'little'))
    data = content[22:]
    try:
        stamp = base.stamp_ns(tick) if topic.role == topics.STATUS else cdr.stamp_ns(data)
    except cdr.CdrError as error:
        raise bad_message(path, topic, tick, error) from None
    for what, time in (('stamp', stamp), ('log time', times[0]), ('publish time', times[1])):
        if time != base.stamp_ns(tick) or tick > base.last_tick:
            raise LogError(
                Kind.BAD_STAMP,
                path,
                f'tick {tick} of {topic.name} must have the {what} '
                f'{base.stamp_ns(min(tick, base.last_tick))} ns and be at most {base.last_tick}; '
                f'got {time} ns',
            )
    return Message(topic, tick, data)


def bad_message(path: Path, topic: Topic, tick: int, error: cdr.CdrError) -> LogError:
    """Return the LogError of a message that is not of its type."""
    return LogError(Kind.BAD_MESSAGE, path, f'tick {tick} of {topic.name}: a {topic.type} {error}')


def values_of(topic: Topic, data: bytes) -> tuple[float, ...]:
    """Return the state (6 floats) or force (3 floats) in a message; raises CdrError."""
    if topic.role in topics.STATES:
        floats = cdr.decode_odometry(data).floats
        return floats[cdr.POSITION] + floats[cdr.VELOCITY]
    return cdr.decode_wrench(data).floats[:3]


def plain(topic: Topic, stamp_ns: int, values: Sequence[float]) -> bytes:
    """Return the message that holds nothing but a stamp and a state or force."""
    frames = topics.FRAMES[topic.role]
    if topic.role in topics.STATES:
        return cdr.encode_odometry(stamp_ns, frames[0], frames[1], values)
    return cdr.encode_wrench(stamp_ns, frames[0], values)


@dataclass
class SlowDecoder:
    """Takes messages one by one, in the order of ticks, and gives them out as blocks."""

    path: Path
    base: TimeBase
    recorded: Sequence[Topic]
    newest: int = -1
    _given: int = -1
    _rows: dict[int, dict[str, tuple[float, ...]]] = field(default_factory=dict)
    _statuses: list[tuple[int, cdr.Status]] = field(default_factory=list)
    _odd: list[Odd] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self._rows) + len(self._statuses)

    def add(self, message: Message) -> None:
        """Take one message; raises LogError."""
        topic, tick, data = message
        if tick < self.newest:
            raise LogError(
                Kind.TIME_BACKWARDS,
                self.path,
                f'runs backwards: tick {tick} of {topic.name} comes after tick {self.newest}',
            )
        self.newest = tick
        try:
            if topic.role == topics.STATUS:
                self._statuses.append((tick, cdr.decode_status(data)))
                return
            values = self._values(message)
        except cdr.CdrError as error:
            raise bad_message(self.path, topic, tick, error) from None
        row = self._rows.setdefault(tick, {})
        if topic.role in row or tick <= self._given:
            raise LogError(Kind.DUPLICATE_TICK, self.path, f'has tick {tick} of {topic.name} twice')
        row[topic.role] = values

    def pass_on(self, block: Block) -> None:
        """Go on after a block that was decoded at once."""
        self.newest = self._given = int(block.ticks[-1])

    def _values(self, message: Message) -> tuple[float, ...]:
        topic, tick, data = message
        if topic.role == topics.CLOCK:
            cdr.decode_clock(data)
            return ()
        values = values_of(topic, data)
        if data != plain(topic, self.base.stamp_ns(tick), values):
            self._odd.append(Odd(tick, topic, data))
        return values

    def block(self, keep_newest: bool = False) -> Block:
        """Return what was taken and forget it; keep the newest tick if more of it may come."""
        kept = {}
        if keep_newest and self.newest in self._rows:
            kept[self.newest] = self._rows.pop(self.newest)
        ticks = np.array(list(self._rows), dtype=np.int64)
        self._given = max(self._given, int(ticks[-1]) if len(ticks) else -1)
        arrays = {role: np.full((len(ticks), width), np.nan) for role, width in _WIDTHS.items()}
        present = {
            topic.role: np.zeros(len(ticks), dtype=bool)
            for topic in self.recorded
            if topic.role != topics.STATUS
        }
        for index, row in enumerate(self._rows.values()):
            for role, values in row.items():
                present[role][index] = True
                if values:
                    arrays[role][index] = values
        block = Block(
            ticks,
            arrays[topics.STATE],
            arrays[topics.FORCE],
            arrays[topics.DISTURBANCE],
            arrays[topics.NAVIGATION],
            arrays[topics.APPLIED],
            arrays[topics.APPLIED_DISTURBANCE],
            present,
            tuple(self._statuses),
            tuple(self._odd),
        )
        self._rows, self._statuses, self._odd = kept, [], []
        return block

    def pattern(self, messages: Sequence[Message], channels: Mapping[int, Topic]) -> Pattern | None:
        """Return the pattern of the last tick of a chunk, if it has one."""
        tick = messages[-1].tick if messages else -1
        last = tuple(message for message in messages if message.tick == tick)
        if not last or any(message.topic.role == topics.STATUS for message in last):
            return None
        found = Pattern(last, {topic: number for number, topic in channels.items()})
        return found if found.fits else None


@dataclass(frozen=True)
class Pattern:
    """The bytes of one tick, as every tick of a steady log has them.

    messages : those of a tick, in their order
    template : (stride,) uint8, the tick as records; stamps and values are free
    """

    messages: tuple[Message, ...]
    channels: Mapping[Topic, int]

    @property
    def fits(self) -> bool:
        """Whether the tick that it was taken from follows it."""
        return self.stride == sum(RECORD_HEAD + len(message.data) for message in self.messages)

    @cached_property
    def template(self) -> NDArray[np.uint8]:
        """Records of the tick, without values."""
        parts = []
        for topic, _, data in self.messages:
            content = (
                bytes(data)
                if topic.role == topics.CLOCK
                else plain(topic, 0, (0.0,) * _WIDTHS[topic.role])
            )
            parts.append(
                bytes([Opcode.MESSAGE])
                + (22 + len(content)).to_bytes(8, 'little')
                + self.channels[topic].to_bytes(2, 'little')
                + bytes(20)
                + content
            )
        return np.frombuffer(b''.join(parts), dtype=np.uint8)

    @property
    def stride(self) -> int:
        """Bytes of a tick."""
        return len(self.template)

    @cached_property
    def _offsets(self) -> list[tuple[Topic, int]]:
        """Where the record of each message begins."""
        found, at = [], 0
        for topic, _, data in self.messages:
            found.append((topic, at))
            at += RECORD_HEAD + len(data)
        return found

    def _values_at(self, topic: Topic, data: bytes) -> list[tuple[int, int]]:
        """Return (offset, number) of the floats that are free in a message."""
        if topic.role == topics.CLOCK:
            return []
        first = cdr.floats_at(topic.type, data)
        if topic.role not in topics.STATES:
            return [(first, 3)]
        return [(first + 8 * part.start, 3) for part in (cdr.POSITION, cdr.VELOCITY)]

    @cached_property
    def _fixed(self) -> list[slice]:
        """Runs of bytes that are the same in every tick."""
        free = np.zeros(self.stride, dtype=bool)
        for (topic, at), message in zip(self._offsets, self.messages, strict=True):
            free[at + 11 : at + RECORD_HEAD] = True  # sequence and times
            free[at + RECORD_HEAD + cdr.STAMP_AT : at + RECORD_HEAD + cdr.STAMP_AT + 8] = True
            for offset, count in self._values_at(topic, message.data):
                free[at + RECORD_HEAD + offset : at + RECORD_HEAD + offset + 8 * count] = True
        edges = np.flatnonzero(np.diff(np.concatenate(([True], free, [True]))))
        return [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]

    def decode(self, data: bytes, base: TimeBase) -> Block | None:
        """Return ticks that follow the pattern; None if one of them does not."""
        rows = np.frombuffer(data, dtype=np.uint8).reshape(-1, self.stride)
        if not all((rows[:, run] == self.template[run]).all() for run in self._fixed):
            return None
        ticks = self._column(rows, 11, '<u4', 1)[:, 0].astype(np.int64)
        if ticks[-1] > base.last_tick or not (np.diff(ticks) > 0).all():
            return None
        stamps = base.epoch_ns + ticks * base.dt_ns
        arrays = {role: np.full((len(ticks), width), np.nan) for role, width in _WIDTHS.items()}
        for (topic, at), message in zip(self._offsets, self.messages, strict=True):
            times = self._column(rows, at + 15, '<u8', 2).astype(np.int64)
            stamp = self._column(rows, at + RECORD_HEAD + cdr.STAMP_AT, '<u4', 2).astype(np.int64)
            same = (
                (self._column(rows, at + 11, '<u4', 1)[:, 0] == ticks)
                & (times == stamps[:, None]).all(axis=1)
                & (stamp @ [_NS, 1] == stamps)
            )
            if not same.all():
                return None
            found = [
                self._column(rows, at + RECORD_HEAD + offset, '<f8', count)
                for offset, count in self._values_at(topic, message.data)
            ]
            if found:
                arrays[topic.role] = np.concatenate(found, axis=1)
        present = {topic.role: np.ones(len(ticks), dtype=bool) for topic, _ in self._offsets}
        return Block(
            ticks,
            arrays[topics.STATE],
            arrays[topics.FORCE],
            arrays[topics.DISTURBANCE],
            arrays[topics.NAVIGATION],
            arrays[topics.APPLIED],
            arrays[topics.APPLIED_DISTURBANCE],
            present,
        )

    @staticmethod
    def _column(rows: NDArray[np.uint8], at: int, kind: str, count: int) -> NDArray[np.generic]:
        width = np.dtype(kind).itemsize * count
        return np.ascontiguousarray(rows[:, at : at + width]).view(kind)
