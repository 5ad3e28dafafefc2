# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""CDR of the recorded message types: encode, decode, clear the gaps between fields.

Plain CDR (XCDR1), little endian, as ROS 2 Jazzy puts it on the wire: 4 bytes of encapsulation
header, then fields aligned to their size, counted from the end of that header. Floats keep their
bits.

Alignment leaves gaps between fields, and the middleware leaves there what its buffer held before. A
log that must be equal byte for byte has zeros there (`canonical`); nothing else is touched.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from itertools import pairwise
from operator import itemgetter
from typing import NamedTuple

HEADER = b'\x00\x01\x00\x00'
"""Encapsulation header: CDR, little endian, no options."""

STAMP_AT = 4
"""Offset of the stamp (int32 s, uint32 ns) in every stamped type and in Clock."""

STAMP = struct.Struct('<iI')

_FRAMES = ('header.frame_id', 'child_frame_id')

WRENCH_FIELDS = tuple(f'wrench.{part}.{axis}' for part in ('force', 'torque') for axis in 'xyz')
"""Names of a wrench's floats, in their order."""

ODOMETRY_FIELDS = (
    *(f'pose.pose.position.{axis}' for axis in 'xyz'),
    *(f'pose.pose.orientation.{axis}' for axis in 'xyzw'),
    *(f'pose.covariance[{i}]' for i in range(36)),
    *(f'twist.twist.linear.{axis}' for axis in 'xyz'),
    *(f'twist.twist.angular.{axis}' for axis in 'xyz'),
    *(f'twist.covariance[{i}]' for i in range(36)),
)
"""Names of an odometry's floats, in their order."""

CLOCK, ODOMETRY, WRENCH = (
    'rosgraph_msgs/msg/Clock',
    'nav_msgs/msg/Odometry',
    'geometry_msgs/msg/WrenchStamped',
)
"""Types that have a `Layout`: a stamp and numbers, the rest fixed."""

FIELDS = {
    CLOCK: ((), ()),
    ODOMETRY: (_FRAMES, ODOMETRY_FIELDS),
    WRENCH: (_FRAMES[:1], WRENCH_FIELDS),
}
"""Names of the texts, then of the floats, that follow the stamp in these types."""

_NS = 1_000_000_000
_LENGTH = struct.Struct('<I')


class CdrError(ValueError):
    """Bytes that are not the CDR of the expected type."""


class Stamped(NamedTuple):
    """A Clock, Odometry or WrenchStamped; texts and floats in the order of `FIELDS`."""

    stamp_ns: int
    texts: tuple[str, ...]
    floats: tuple[float, ...]


class Status(NamedTuple):
    """diagnostic_msgs/msg/DiagnosticStatus; values : pairs (key, value)."""

    level: int
    name: str
    message: str
    hardware_id: str
    values: tuple[tuple[str, str], ...]


def _stamp(stamp_ns: int) -> bytes:
    return HEADER + STAMP.pack(*divmod(stamp_ns, _NS))


def _string(text: str) -> bytes:
    data = text.encode() + b'\x00'
    return _LENGTH.pack(len(data)) + data


def _pad(buffer: bytearray, alignment: int) -> None:
    buffer.extend(bytes(-(len(buffer) - 4) % alignment))


def _encode_stamped(stamp_ns: int, texts: Sequence[str], floats: Sequence[float]) -> bytes:
    buffer = bytearray(_stamp(stamp_ns))
    for text in texts:
        _pad(buffer, 4)
        buffer += _string(text)
    _pad(buffer, 8 if floats else 1)
    return bytes(buffer) + struct.pack(f'<{len(floats)}d', *floats)


def encode_clock(stamp_ns: int) -> bytes:
    """Return the CDR of a rosgraph_msgs/msg/Clock."""
    return _stamp(stamp_ns)


def encode_status(
    level: int,
    name: str,
    message: str,
    hardware_id: str,
    values: Mapping[str, str] | Iterable[tuple[str, str]],
) -> bytes:
    """Return the CDR of a DiagnosticStatus."""
    pairs = tuple(values.items() if isinstance(values, Mapping) else values)
    parts = [HEADER, bytes((level, 0, 0, 0)), _key(name), _field(message), _key(hardware_id)]
    parts.append(_LENGTH.pack(len(pairs)))
    for key, value in pairs:
        parts += _key(key), _field(value)
    if pairs:
        parts[-1] = _string(pairs[-1][1])
    return b''.join(parts)


def _field(text: str) -> bytes:
    """Return a string and the gap after it."""
    data = text.encode()
    return _LENGTH.pack(len(data) + 1) + data + bytes(4 - len(data) % 4)


_key = lru_cache(maxsize=512)(_field)
"""The same, of a text that comes again and again."""


class _Cursor:
    """Reads fields of one message in order."""

    def __init__(self, data: bytes) -> None:
        if data[:2] != HEADER[:2]:
            raise CdrError(
                'must begin with the header of little-endian CDR, 00 01; '
                f'got {data[:4].hex(" ") or "no bytes"}'
            )
        self.data = data
        self.at = 4

    def align(self, alignment: int) -> None:
        self.at += -(self.at - 4) % alignment

    def unpack(self, layout: struct.Struct) -> tuple[float, ...]:
        start, self.at = self.at, self.at + layout.size
        if self.at > len(self.data):
            raise CdrError(f'must hold at least {self.at} bytes; got {len(self.data)}')
        return layout.unpack_from(self.data, start)

    def integer(self) -> int:
        self.align(4)
        return int(self.unpack(_LENGTH)[0])

    def stamp(self) -> int:
        seconds, nanoseconds = self.unpack(STAMP)
        return int(seconds) * _NS + int(nanoseconds)

    def strings(self, count: int) -> list[str]:
        data, at, texts = self.data, self.at, []
        size = len(data)
        for _ in range(count):
            at += -at % 4  # the header has 4 bytes
            start = at + 4
            (length,) = _LENGTH.unpack_from(data, at) if start <= size else (0,)
            at = start + length
            if not length or at > size or data[at - 1]:
                raise CdrError(f'must hold a string of {length} bytes at {start}, the last one 0')
            try:
                texts.append(data[start : at - 1].decode())
            except UnicodeDecodeError:
                raise CdrError(f'must hold UTF-8 text at {start}') from None
        self.at = at
        return texts

    def count(self) -> int:
        """Return the length of a sequence whose elements take at least a byte each."""
        count = self.integer()
        if count > len(self.data):  # a damaged count must not loop
            raise CdrError(f'must hold {count} elements; got {len(self.data)} bytes')
        return count

    def status(self) -> Status:
        if self.at >= len(self.data):
            raise CdrError('must hold a level; got no more bytes')
        level, self.at = self.data[self.at], self.at + 1
        name, message, hardware_id = self.strings(3)
        texts = self.strings(2 * self.count())
        values = tuple(zip(texts[::2], texts[1::2], strict=True))
        return Status(level, name, message, hardware_id, values)

    def end(self, spare: int = 0) -> None:
        if not 0 <= len(self.data) - self.at <= spare:
            raise CdrError(f'must be {self.at} bytes; got {len(self.data)}')


def stamp_ns(data: bytes) -> int:
    """Return the stamp of a Clock, or of any message that begins with a std_msgs/Header."""
    return _Cursor(data).stamp()


def decode_stamped(type_name: str, data: bytes) -> Stamped:
    """Return a message of a type of `FIELDS`; raises CdrError."""
    texts, floats = FIELDS[type_name]
    cursor = _Cursor(data)
    stamp, strings = cursor.stamp(), tuple(cursor.strings(len(texts)))
    cursor.align(8 if floats else 1)
    numbers = cursor.unpack(struct.Struct(f'<{len(floats)}d'))
    cursor.end()
    return Stamped(stamp, strings, numbers)


def decode_status(data: bytes) -> Status:
    """Return a diagnostic_msgs/msg/DiagnosticStatus; raises CdrError."""
    cursor = _Cursor(data)
    status = cursor.status()
    cursor.end(spare=3)
    return status


def canonical(type_name: str, data: bytes) -> bytes:
    """Return a message with the gaps between its fields cleared; raises CdrError."""
    if type_name == CLOCK:
        decode_stamped(CLOCK, data)
        return data
    if type_name == 'diagnostic_msgs/msg/DiagnosticStatus':
        return data[:4] + encode_status(*decode_status(data))[4:]
    strings, floats = map(len, FIELDS[type_name])
    texts, numbers = data[12 : -8 * floats], data[-8 * floats :]
    if data[:2] != HEADER[:2] or len(data) < 12 + 8 * floats:
        raise CdrError(f'must be the CDR of {type_name}; got {len(data)} bytes')
    cleared = _cleared(texts, strings)
    return data if cleared == texts else data[:12] + cleared + numbers


@lru_cache(maxsize=64)
def _cleared(texts: bytes, strings: int) -> bytes:
    """Return the strings between stamp and floats, gaps cleared; they are the same every tick."""
    cursor = _Cursor(HEADER + bytes(8) + texts)
    cursor.stamp()
    buffer = bytearray(HEADER + bytes(8))
    for text in cursor.strings(strings):
        _pad(buffer, 4)
        buffer += _string(text)
    _pad(buffer, 8)
    if len(buffer) != 12 + len(texts):
        raise CdrError(f'must have {len(buffer) - 12} bytes of text; got {len(texts)}')
    return bytes(buffer[12:])


WRONG_FRAME, NOT_FINITE, MALFORMED = 'wrong_frame', 'not_finite', 'malformed'
"""Why a message cannot be used."""


class Layout:
    """Where the numbers of a signal lie in its message; all else in the message is fixed.

    Making and reading a message is a copy and a few packed floats: a tenth of the time that message
    objects take.

    texts : frame ids in the message, in their order
    size : of the message [bytes]
    columns : places of the signal's numbers among the floats of the message
    plain : the message with zeros for stamp and numbers
    runs : where numbers of the signal lie one after the other: offset in the message, format
    also : the layout with another frame in the header, which a message may have; None: none may
    """

    def __init__(
        self, type_name: str, texts: tuple[str, ...], names: tuple[str, ...], own: int
    ) -> None:
        floats = FIELDS[type_name][1]
        self.columns = tuple(map(floats.index, names))
        zeros = [float(name == 'pose.pose.orientation.w') for name in floats]  # no rotation
        self.plain = _encode_stamped(0, texts, zeros)
        self.type, self.texts, self.size = type_name, texts, len(self.plain)
        first = self.size - 8 * len(floats)
        columns = enumerate(self.columns)
        begins = [i for i, c in columns if i in (0, own) or c != self.columns[i - 1] + 1]
        self.runs = tuple(
            (first + 8 * self.columns[i], struct.Struct(f'<{j - i}d'))
            for i, j in pairwise([*begins, len(self.columns)])
        )
        end, form, ordered = STAMP_AT + STAMP.size, STAMP.format, sorted(self.columns)
        for column in ordered:
            form += f'{first + 8 * column - end}xd'
            end = first + 8 * column + 8
        self._numbers = struct.Struct(form)  # stamp and numbers, in the order of the message
        places = [2 + ordered.index(column) for column in self.columns]
        whole = slice(2, None)
        self._values = itemgetter(*places if places != sorted(places) else [whole])
        # What must stand between the stamp and the numbers, with the gaps cleared.
        self._fixed = self.plain[12:first]
        self._head = self.plain[12 : 17 + len(texts[0])] if texts else b''
        self.also: Layout | None = None

    @staticmethod
    @lru_cache(maxsize=64)
    def of(
        type_name: str,
        texts: tuple[str, ...],
        names: tuple[str, ...] = (),
        own: int = -1,
        also: str = '',
    ) -> Layout:
        """Return the layout of a type of message with these frame ids.

        names : of the fields that hold numbers; from number `own` on a message may lack them
        also : another frame that the header may have; '' for none
        """
        layout = Layout(type_name, texts, names, own)
        if also:
            layout.also = Layout(type_name, (also, *texts[1:]), names, own)
        return layout

    def like(self, data: bytes) -> Layout:
        """Return the layout of a message by the frame of its header."""
        return self.also if self.also and data.startswith(self.also._head, 12) else self

    def encode(self, stamp_ns: int, values: Sequence[float]) -> bytes:
        """Return the CDR of a message that holds a stamp and the numbers of a signal.

        Of numbers that are not given, as covariances, it holds zeros; of an attitude, none.
        """
        message = bytearray(self.plain)
        STAMP.pack_into(message, STAMP_AT, *divmod(stamp_ns, _NS))
        used = 0
        for place, run in self.runs:
            following = used + run.size // 8
            if following > len(values):
                break
            run.pack_into(message, place, *values[used:following])
            used = following
        return bytes(message)

    def knows(self, data: bytes) -> bool:
        """Return whether a message has the size, frame ids and clear gaps of this layout."""
        if self.also and self.like(data) is not self:
            return self.also.knows(data)
        return (
            len(data) == self.size
            and data.startswith(self._fixed, 12)
            and data.startswith(HEADER[:2])
        )

    def decode(self, data: bytes) -> tuple[int, tuple[float, ...], bool]:
        """Return stamp [ns], numbers of the signal, and whether the frame ids are as they must be.

        Raises CdrError if the bytes are not a message of this type.
        """
        if self.also and self.like(data) is not self:
            return self.also.decode(data)
        if not self.knows(data):
            stamp, texts, floats = decode_stamped(self.type, data)
            return stamp, tuple(floats[i] for i in self.columns), texts[:1] == self.texts[:1]
        numbers = self._numbers.unpack_from(data, STAMP_AT)
        return numbers[0] * _NS + numbers[1], self._values(numbers), True

    def use(self, data: bytes) -> tuple[str, int, tuple[float, ...]]:
        """Return why a message cannot be used ('' if it can), its stamp [ns] and its numbers.

        What the plant ignores, the recorder ignores too: both ask here.
        """
        try:
            stamp_ns, values, right_frame = self.decode(data)
        except CdrError:
            return MALFORMED, 0, ()
        at = STAMP_AT + 4
        high = data[at + 3] >= _NS >> 24  # rarely; then look closely
        if high and int.from_bytes(data[at : at + 4], 'little') >= _NS:
            return MALFORMED, stamp_ns, values  # a second way to write a stamp
        if not right_frame:
            return WRONG_FRAME, stamp_ns, values
        # A finite sum has finite terms; one that is not may have overflowed.
        finite = math.isfinite(sum(values)) or all(map(math.isfinite, values))
        return '' if finite else NOT_FINITE, stamp_ns, values
