# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Hostile values of any ROS type, as CDR: from the fields of the type and a seeded generator.

The bytes are made here and not by the middleware, because text that is no UTF-8, a false length or
half a message cannot be made from a message object.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from functools import cache
from importlib import import_module
from random import Random
from typing import Any

from rpo_core.wire import cdr

NUMBERS: dict[str, tuple[str, tuple[Any, ...]]] = {
    'boolean': ('B', (0, 1, 2, 255)),
    'octet': ('B', (0, 1, 3, 255)),
    'uint8': ('B', (0, 1, 4, 9, 10, 99, 255)),
    'int8': ('b', (0, -1, 127, -128)),
    'uint16': ('H', (0, 1, 65535)),
    'int16': ('h', (0, -1, 32767, -32768)),
    'uint32': ('I', (0, 1, 999_999_999, 1_000_000_000, 4_294_967_295)),
    'int32': ('i', (0, 1, -1, 2_147_483_647, -2_147_483_648)),
    'uint64': ('Q', (0, 1, 2**53 + 1, 2**64 - 1)),
    'int64': ('q', (0, 1, -1, 2**31, 2**63 - 1, -(2**63))),
    'float': ('f', (0.0, -1.0, 3e38, 1e-45, math.nan, math.inf)),
    'double': (
        'd',
        (0.0, -0.0, 1.5, -1e-3, 5e-324, 2.2e-308, 1e308, -1e308, math.nan, math.inf, -math.inf),
    ),
}
"""Type of a field -> its code in `struct`, hostile values."""

_WORDS = (
    '', ' ', '0', '-1', '1e400', 'nan', '12x', '٣', '9' * 5000, 'true', '~', '[', '{', '@x',
    '[draft] one', 'a: b', '2026-02-30', '!!python/object:x', '&a [*a, *a]', '- ' * 300,
    '[/bold]', '\x1b[2J\x1b]0;x\x07', 'two\nlines\r', '\x00', 'a\x00b', '\u202e', '\ud800',
    '../../etc/passwd', '/dev/zero', '/', '//', '~/x', '${HOME}', '%s%n', 'x' * 200_000,
)  # fmt: skip
_OURS = (
    'target_lvlh', 'chaser', 'running', 'waiting', 'finished', 'aborted', 'paused', 'ready',
    'closed', 'active', 'inactive', 'refused', 'plant', 'controller', 'disturbance', 'phase',
    'tick', 'role', 'stage', 'state', 'reason', 'dropped', 'resumed', 'file.scenario.yaml',
)  # fmt: skip
ANY_TEXTS = (
    *(word.encode('utf-8', 'surrogatepass') for word in _WORDS),
    *(b'\xff\xfe', b'\xc3', b'\xed\xa0\x80', b'\xf8\x88\x80\x80\x80' * 40),
)
TEXTS = (*ANY_TEXTS, *(word.encode() for word in _OURS))
"""Texts, some of them no UTF-8; words of our messages in the wrong places."""

MOST_BYTES = 400_000
"""Nothing more is spoilt in a message of this size: two long texts, or some lists."""

COUNTS = (0, 1, 2, 7, 300)
_LENGTH = struct.Struct('<I')
_FALSE_LENGTHS = (0, 1, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF, 0x0FFF_FFFF, 70_000)

Leaf = tuple[str, Any]


@cache
def class_of(name: str, room: str = 'msg') -> Any:
    """Return the class of a type such as 'std_msgs/Header' or 'std_srvs/srv/SetBool'."""
    package, *middle, kind = name.split('/')
    return getattr(import_module(f'{package}.{(middle or [room])[0]}'), kind)


@cache
def fields_of(kind: type) -> tuple[tuple[str, str], ...]:
    """Return name and type of each field."""
    found: dict[str, str] = kind.get_fields_and_field_types()  # type: ignore[attr-defined]
    return tuple(found.items())


class Encoder:
    """Encodes a message object as CDR; a share of its leaves becomes hostile, or one of them.

    share : of the leaves (numbers, texts, lengths of lists) that are replaced
    texts : to choose from
    only : number of the one leaf that is replaced, instead of a share
    leaves : how many it has met
    """

    def __init__(
        self,
        rng: Random,
        share: float,
        texts: Sequence[bytes] = TEXTS,
        only: int | None = None,
    ) -> None:
        self._rng, self._share, self._texts, self._only = rng, share, texts, only
        self._buffer = bytearray(cdr.HEADER)
        self.leaves = 0

    def encode(self, message: Any) -> bytes:
        """Return the bytes of a message."""
        self._message(message)
        if len(self._buffer) == len(cdr.HEADER):
            self._buffer.append(0)  # what ROS 2 puts into an empty message
        return bytes(self._buffer)

    def _spoilt(self) -> bool:
        self.leaves += 1
        if self._only is not None:
            return self.leaves == self._only
        return self._rng.random() < self._share and len(self._buffer) < MOST_BYTES

    def _message(self, message: Any) -> None:
        for name, kind in fields_of(type(message)):
            self._value(kind, getattr(message, name))

    def _value(self, kind: str, value: Any) -> None:
        if kind.endswith(']'):
            kind = kind.partition('[')[0]
            for item in value:
                self._value(kind, item)
        elif kind.startswith('sequence<'):
            self._sequence(kind[len('sequence<') : -1].partition(',')[0], value)
        elif kind.startswith('string'):
            self._text(value)
        elif kind in NUMBERS:
            self._number(kind, value)
        else:
            self._message(value)

    def _sequence(self, kind: str, values: Any) -> None:
        items = list(values)
        if self._spoilt():
            empty = items[:1] or [_empty(kind)]
            items = empty * self._rng.choice(COUNTS)
        self._align(4)
        self._buffer += _LENGTH.pack(len(items))
        for item in items:
            self._value(kind, item)

    def _text(self, value: str) -> None:
        data = self._rng.choice(self._texts) if self._spoilt() else value.encode('utf-8', 'replace')
        self._align(4)
        self._buffer += _LENGTH.pack(len(data) + 1) + data + b'\x00'

    def _number(self, kind: str, value: Any) -> None:
        code, hostile = NUMBERS[kind]
        if isinstance(value, bytes):
            value = value[0]
        if self._spoilt():
            value = self._rng.choice(hostile)
        layout = struct.Struct(f'<{code}')
        self._align(layout.size)
        self._buffer += layout.pack(value)

    def _align(self, size: int) -> None:
        self._buffer += bytes(-(len(self._buffer) - 4) % size)


def _empty(kind: str) -> Any:
    if kind.startswith('string'):
        return ''
    return 0 if kind in NUMBERS else class_of(kind)()


def _flipped(data: bytes, rng: Random) -> bytes:
    spoilt = bytearray(data or b'\x00')
    for _ in range(rng.randint(1, 8)):
        spoilt[rng.randrange(len(spoilt))] ^= 1 << rng.randrange(8)
    return bytes(spoilt)


def _false_length(data: bytes, rng: Random) -> bytes:
    """Return a message with another number in the place of a length, or of anything else."""
    places = range(4, len(data) - 3, 4)
    if not places:
        return data
    place = rng.choice(places)
    return data[:place] + _LENGTH.pack(rng.choice(_FALSE_LENGTHS)) + data[place + 4 :]


BYTES: dict[str, Callable[[bytes, Random], bytes]] = {
    'flipped bits': _flipped,
    'false length': _false_length,
    'cut': lambda data, rng: data[: rng.randrange(len(data) + 1)],
    'too long': lambda data, rng: data + rng.randbytes(rng.choice((1, 3, 4, 2000))),
    'no CDR': lambda data, rng: rng.randbytes(rng.choice((0, 1, 4, 12, 700, 5000))),
    'other header': lambda data, rng: rng.randbytes(2) + data[2:],
    'big endian': lambda data, rng: b'\x00\x00' + data[2:],
}
"""Kind -> spoils the bytes of a message."""

SHARES = {'few fields': 0.05, 'some fields': 0.3, 'all fields': 1.0}
"""Kind -> share of the fields that become hostile."""

ONE_FIELD = 'one field'
KINDS = (ONE_FIELD, *SHARES, *BYTES)


def spoilt(message: Any, kind: str, rng: Random) -> bytes:
    """Return a message as CDR, spoilt in one of `KINDS`."""
    if kind == ONE_FIELD:
        whole = Encoder(rng, 0.0)
        whole.encode(message)
        return Encoder(rng, 0.0, only=rng.randint(1, max(whole.leaves, 1))).encode(message)
    if kind in SHARES:
        return Encoder(rng, SHARES[kind]).encode(message)
    return BYTES[kind](Encoder(rng, 0.0).encode(message), rng)
