# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is not as computed in a log: the check that found it, and where."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from rpo_core.wire import cdr
from rpo_log.read.decode import NonCanonical, values_of
from rpo_log.topics import Topic

START, APPLIED, REST = 'start', 'force applied', 'rest'
"""Checks beside the stages, as a difference names them."""


@dataclass(frozen=True)
class Difference:
    """The first thing in a log that is not as computed.

    check : name of the stage that computed it, or one of the checks beside the stages
    """

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


def non_canonical_difference(message: NonCanonical, stamp_ns: int) -> Difference:
    """Name what a message of a tick holds beside its stamp and the numbers of its signal."""
    tick, topic, data = message
    expected = topic.row.layout.encode(stamp_ns, values_of(topic, data))
    pairs = zip(_items(topic, data), _items(topic, expected), strict=True)
    for (field, logged), (_, computed) in pairs:
        if _bits(logged) != _bits(computed):
            return Difference(tick, topic.name, field, logged, computed, REST)
    where = 'bytes between its fields'
    return Difference(tick, topic.name, where, data.hex(), expected.hex(), REST)


def _items(topic: Topic, data: bytes) -> list[tuple[str, float | str]]:
    """Return the fields of a message, by name, in their order."""
    texts, floats = cdr.FIELDS[topic.type]
    found = cdr.decode_stamped(topic.type, data)
    return list(zip((*texts, *floats), (*found.texts, *found.floats), strict=True))


def _bits(value: float | str) -> bytes:
    return value.encode() if isinstance(value, str) else struct.pack('<d', value)
