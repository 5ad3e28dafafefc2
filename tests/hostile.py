# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a forger, or a hostile sender, puts into the place of a value or of bytes."""

from __future__ import annotations

import struct
from dataclasses import is_dataclass

import numpy as np

FIGURES = 0.0, -0.0, 1.5, -1e-3, 5e-324, 1e300, -1e308, float('nan'), float('inf'), -float('inf')
SHARES = -1.0, 0.0, 0.5, 0.9, 1.0 - 1e-9, 1.0 + 1e-9, 1.1, 2.0, 1e3
WORDS = (
    '', ' ', '-1', '+5', '1.5', '1e400', '0x10', '1_000', 'nan', '٣', '²', '9' * 5000, 'true', '~',
    '[', 'a: b', '2026-02-30', '!!python/object:x', '&a [*a, *a]', '[/bold]', '\x1b[2J',
    'two\nlines', '\u202e', '../../etc/passwd', '/dev/zero', '//', '%s%n', 'x' * 200_000,
    'running', 'finished', 'active', 'refused', 'plant', 'chaser', 'tick', 'proven',
    'robust', 'mm', 'for ever', '@0@@', '@1@@', '@2@@',
)  # fmt: skip
LENGTHS = 0, 1, 70_000, 0x7FFF_FFFF, 0x8000_0000, 0xFFFF_FFFF, 1 << 40


def spoilt(rng, data):
    """Return bytes with a bit or a number changed, more of them, or fewer."""
    at, way = rng.randrange(len(data) + 1), rng.choice(('bit', 'cut', 'more', 'number', 'length'))
    if way == 'cut':
        return data[:at]
    if way == 'more':
        return data[:at] + bytes([at % 256, 65]) * rng.choice((1, 2, 1000)) + data[at:]
    if way == 'bit':
        changed = bytes(byte ^ 1 << rng.randrange(8) for byte in data[at : at + 1])
        return data[:at] + changed + data[at + 1 :]
    at -= at % 4
    number = struct.pack('<d', rng.choice(FIGURES))
    length = struct.pack('<Q', rng.choice(LENGTHS))[: rng.choice((4, 8))]
    wrong = number if way == 'number' else length
    return data[:at] + wrong + data[at + len(wrong) :]


def other(rng, value):
    """Return something else in the place of a value: of one inside it, fewer, or more."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return rng.choice((0, value + 1, abs(value - 1), value + 10**8, 1 << 31))
    if isinstance(value, float):
        return rng.choice((*[value * share for share in SHARES], *FIGURES, 1 << 70))
    if isinstance(value, bytes):
        return spoilt(rng, value)
    if isinstance(value, list) and value:
        at = rng.randrange(len(value))
        inner = rng.choice(([], [value[at]] * 2, [other(rng, value[at])], [other(rng, value[at])]))
        return value[:at] + inner + value[at + 1 :]
    if isinstance(value, dict) and value:
        key, rest = rng.choice(sorted(value)), dict(value)
        inner = other(rng, rest.pop(key))
        return rng.choice((rest, {**value, f'{key}x': inner}, *[{**value, key: inner}] * 6))
    if isinstance(value, np.ndarray):
        return array(rng, value)
    if is_dataclass(value) or hasattr(value, '_asdict'):
        fields = value._asdict() if hasattr(value, '_asdict') else dict(vars(value))
        name = rng.choice([name for name in fields if name != 'crc'])
        return type(value)(**{**fields, name: other(rng, fields[name])})
    if isinstance(value, str) and value and rng.random() < 0.5:
        return spoilt(rng, value.encode()).decode('utf-8', 'replace')
    return rng.choice((*WORDS, [value], {'x': value}, None))


def array(rng, values):
    """Return an array with another number, column, row, type or shape."""
    if rng.random() < 0.8 and values.size:
        at = np.unravel_index(rng.randrange(values.size), values.shape)
        changed = np.array(values)
        changed[rng.choice((at, at, at[:1], (..., *at[-1:]), ...))] *= rng.choice(SHARES)
        return changed + rng.choice((0.0, 0.0, 0.0, 1e-9, -0.1))
    twice = np.concatenate((values, values[:1])) if values.ndim else values
    forms = values.astype('f4'), values.astype(object), values[None], values.T
    return rng.choice((*forms, twice, values[1:] if values.ndim else values))
