# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is not as computed in a log: the check that found it, and where."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from rpo_core import cdr
from rpo_log import topics
from rpo_log.decode import Odd, plain, values_of
from rpo_log.topics import Topic

START, NAVIGATION, LAW, DISTURBANCE, FLOWN, DYNAMICS, WHOLE, REST = (
    'start',
    'navigation',
    'control law',
    'disturbance',
    'force flown',
    'dynamics',
    'whole run',
    'rest',
)
"""Checks, as a difference names them."""


@dataclass(frozen=True)
class Difference:
    """The first thing in a log that is not as computed."""

    tick: int
    topic: str
    field: str
    logged: float | str
    computed: float | str
    check: str

    def sentence(self) -> str:
        """Return one line for people."""
        return (
            f'tick {self.tick}, {self.topic}, {self.field}: logged {self.logged!r}, computed '
            f'{self.computed!r} ({self.check})'
        )


def odd_difference(odd: Odd, stamp_ns: int) -> Difference:
    """Name what a message of a tick holds beside its stamp and its values."""
    expected = plain(odd.topic, stamp_ns, values_of(odd.topic, odd.data))
    pairs = zip(_items(odd.topic, odd.data), _items(odd.topic, expected), strict=True)
    for (field, logged), (_, computed) in pairs:
        if _bits(logged) != _bits(computed):
            return Difference(odd.tick, odd.topic.name, field, logged, computed, REST)
    return Difference(
        odd.tick,
        odd.topic.name,
        'bytes between its fields',
        odd.data.hex(),
        expected.hex(),
        REST,
    )


def _items(topic: Topic, data: bytes) -> list[tuple[str, float | str]]:
    """Return the fields of a message, by name, in their order."""
    if topic.role in topics.STATES:
        odometry = cdr.decode_odometry(data)
        return [
            ('header.frame_id', odometry.frame_id),
            ('child_frame_id', odometry.child_frame_id),
            *zip(cdr.ODOMETRY_FIELDS, odometry.floats, strict=True),
        ]
    wrench = cdr.decode_wrench(data)
    return [
        ('header.frame_id', wrench.frame_id),
        *zip(cdr.WRENCH_FIELDS, wrench.floats, strict=True),
    ]


def _bits(value: float | str) -> bytes:
    return value.encode() if isinstance(value, str) else struct.pack('<d', value)
