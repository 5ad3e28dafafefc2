# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Where the numbers of a signal lie in the bytes of its message."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise
from operator import itemgetter

from rpo_core.wire import cdr

WRONG_FRAME, NOT_FINITE, MALFORMED = 'wrong_frame', 'not_finite', 'malformed'
"""Why a message cannot be used."""

_NS = 1_000_000_000
_HEADER = cdr.HEADER[:2]


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
        floats = cdr.FIELDS[type_name][1]
        self.columns = tuple(map(floats.index, names))
        if type_name == cdr.CLOCK:
            self.plain = cdr.encode_clock(0)
        elif type_name == cdr.ODOMETRY:
            self.plain = cdr.encode_odometry(0, texts[0], texts[1], (0.0,) * 6)
        else:
            self.plain = cdr.encode_wrench(0, texts[0], (0.0,) * 3)
        self.type, self.texts, self.size = type_name, texts, len(self.plain)
        first = self.size - 8 * len(floats)
        columns = enumerate(self.columns)
        begins = [i for i, c in columns if i in (0, own) or c != self.columns[i - 1] + 1]
        self.runs = tuple(
            (first + 8 * self.columns[i], struct.Struct(f'<{j - i}d'))
            for i, j in pairwise([*begins, len(self.columns)])
        )
        end, form, ordered = cdr.STAMP_AT + cdr.STAMP.size, cdr.STAMP.format, sorted(self.columns)
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
        found = Layout(type_name, texts, names, own)
        if also:
            found.also = Layout(type_name, (also, *texts[1:]), names, own)
        return found

    def like(self, data: bytes) -> Layout:
        """Return the layout of a message by the frame of its header."""
        return self.also if self.also and data.startswith(self.also._head, 12) else self

    def encode(self, stamp_ns: int, values: Sequence[float]) -> bytes:
        """Return the CDR of a message that holds a stamp and the numbers of a signal.

        Of numbers that are not given, as covariances, it holds zeros; of an attitude, none.
        """
        message = bytearray(self.plain)
        cdr.STAMP.pack_into(message, cdr.STAMP_AT, *divmod(stamp_ns, _NS))
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
            len(data) == self.size and data.startswith(self._fixed, 12) and data.startswith(_HEADER)
        )

    def decode(self, data: bytes) -> tuple[int, tuple[float, ...], bool]:
        """Return stamp [ns], numbers of the signal, and whether the frame ids are as they must be.

        Raises CdrError if the bytes are not a message of this type.
        """
        if self.also and self.like(data) is not self:
            return self.also.decode(data)
        if not self.knows(data):
            stamp, texts, floats = cdr.decode_stamped(self.type, data)
            return stamp, tuple(floats[i] for i in self.columns), texts[:1] == self.texts[:1]
        found = self._numbers.unpack_from(data, cdr.STAMP_AT)
        return found[0] * _NS + found[1], self._values(found), True

    def use(self, data: bytes) -> tuple[str, int, tuple[float, ...]]:
        """Return why a message cannot be used ('' if it can), its stamp [ns] and its numbers.

        What the plant ignores, the recorder ignores too: both ask here.
        """
        try:
            stamp_ns, values, right_frame = self.decode(data)
        except cdr.CdrError:
            return MALFORMED, 0, ()
        at = cdr.STAMP_AT + 4
        high = data[at + 3] >= _NS >> 24  # rarely; then look closely
        if high and int.from_bytes(data[at : at + 4], 'little') >= _NS:
            return MALFORMED, stamp_ns, values  # a second way to write a stamp
        if not right_frame:
            return WRONG_FRAME, stamp_ns, values
        # A finite sum has finite terms; one that is not may have overflowed.
        finite = math.isfinite(sum(values)) or all(map(math.isfinite, values))
        return '' if finite else NOT_FINITE, stamp_ns, values
