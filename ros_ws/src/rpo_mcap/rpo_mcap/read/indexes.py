# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What leads other readers through an MCAP file, compared with what stands in it.

We read a file from its begin to its end. Other readers begin at its end: the footer leads to the
summary, the summary to chunks, attachments and metadata. Where it leads elsewhere, into a record
that we pass over or to a second channel of the same number, they show another flight than we judge.
So the summary and all indexes are computed from the records, and compared. Memory is bounded.
"""

from __future__ import annotations

import hashlib
import struct
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from rpo_core.files.validation import shown

_HEAD_BYTES = 9
"""Opcode and length before the content of each record."""

_DATA = frozenset(
    (
        Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK,
        Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT, Opcode.METADATA, Opcode.DATA_END,
    )
)  # fmt: skip
_SUMMARY = frozenset(
    (
        Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX,
        Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET, Opcode.FOOTER,
    )
)  # fmt: skip
_MESSAGE = np.dtype([('channel', '<u2'), ('sequence', '<u4'), ('log_ns', '<u8')])
_INDEX = struct.Struct('<HI')
_GROUPS = 16
"""Groups of a summary, and offsets to them, that are kept; no summary has more kinds of records."""

Pairs = NDArray[np.uint64]


@dataclass
class _Group:
    """The index records of one kind: those that must be there, and those that are."""

    due: int = 0
    count: int = 0
    expected: hashlib._Hash = field(default_factory=hashlib.sha256)
    actual: hashlib._Hash = field(default_factory=hashlib.sha256)

    def expect(self, *values: object) -> None:
        """Take the values of an index record that must be there."""
        self.due += 1
        self.expected.update(repr(values).encode())

    def take(self, *values: object) -> None:
        """Take the values of one that is there."""
        self.count += 1
        self.actual.update(repr(values).encode())


@dataclass
class _OpenChunk:
    """A chunk whose message indexes are still to come.

    messages : per channel, (n, 2) log time and offset of each message in the chunk
    indexes : where the message indexes are, by channel
    """

    offset: int
    length: int
    times: tuple[int, int]
    packing: tuple[str, int, int]
    messages: dict[int, Pairs] = field(default_factory=dict)
    indexes: dict[int, int] = field(default_factory=dict)
    indexes_length: int = 0


class Indexes:
    """Takes the records of a file in their order, as `FileRecords` reads them.

    fault : the first thing that can show another reader something else; empty if there is none
    lacks : indexes and checksums that a file may have, and this one has not; without summary
        offsets, since our own files beside a log have none
    unused : a schema or channel that only the summary has: rosbag2 writes those of topics without
        messages; empty if there is none
    """

    def __init__(self) -> None:
        self.fault = ''
        self.lacks: list[str] = []
        self.unused = ''
        self._records = 0
        self._data_end = -1  # where the summary begins
        self._chunk: _OpenChunk | None = None
        self._groups = {
            kind: _Group()
            for kind in (Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX)
        }
        self._declared: dict[tuple[int, int], tuple[bytes, str]] = {}  # digest and name
        self._repeated: dict[tuple[int, int], tuple[bytes, str]] = {}  # in the summary
        self._begins: dict[int, int] = {}  # of channels that the open chunk declares
        self._loose = 0  # messages in no chunk
        self._counts: Counter[int] = Counter()
        self._times: tuple[int, int] | None = None
        self._statistics: list[Statistics] = []
        self._grouped: list[tuple[int, int, int]] = []  # opcode, start, length
        self._offsets: list[tuple[int, int, int]] = []
        self._offsets_start = 0

    def take(self, opcode: int, offset: int, content: bytes, record: McapRecord | None) -> None:
        """Take the next record of the file.

        record : None if it is a message index, or of an unknown kind
        """
        if opcode == Opcode.MESSAGE_INDEX:
            self._take_message_index(offset, content)
            self._records += 1
            return
        self._end_chunk()
        self._place(opcode, offset)
        if record is not None and not _is_exact(record, content):
            self._find(f'{_named(opcode, offset)} holds more than its fields')
        self._records += 1
        length = _HEAD_BYTES + len(content)
        if self._data_end >= 0:
            self._take_group(opcode, offset, length)
        if isinstance(record, Schema | Channel):
            self.declare(record, content)
        elif isinstance(record, Chunk):
            times = record.message_start_time, record.message_end_time
            packing = record.compression, len(record.data), record.uncompressed_size
            self._chunk = _OpenChunk(offset, length, times, packing)
            self._begins.clear()
            self._require_checksum(record.uncompressed_crc, 'its chunks')
        elif opcode == Opcode.MESSAGE and len(content) >= _MESSAGE.itemsize:
            channel, _, log_ns = struct.unpack_from('<HIQ', content)
            self._loose += 1
            self._count(channel, 1, log_ns, log_ns)
            self._require_channel(channel, offset)
        elif isinstance(record, Attachment):
            self._require_checksum(int.from_bytes(content[-4:], 'little'), 'its attachments')
            values = record.log_time, record.create_time, len(record.data)
            named = record.name, record.media_type
            self._groups[Opcode.ATTACHMENT_INDEX].expect(offset, length, *values, *named)
        elif isinstance(record, Metadata):
            self._groups[Opcode.METADATA_INDEX].expect(offset, length, record.name)
        elif isinstance(record, DataEnd):
            self._data_end = offset + length if self._data_end < 0 else self._data_end
            self._require_checksum(record.data_section_crc, 'its data')
        else:
            self._take_summary(offset, record)

    def _take_summary(self, offset: int, record: McapRecord | None) -> None:
        """Take a record of the summary, or the footer."""
        if isinstance(record, AttachmentIndex):
            values = record.log_time, record.create_time, record.data_size
            named = record.name, record.media_type
            place = record.offset, record.length
            self._groups[Opcode.ATTACHMENT_INDEX].take(*place, *values, *named)
        elif isinstance(record, MetadataIndex):
            group = self._groups[Opcode.METADATA_INDEX]
            group.take(record.offset, record.length, record.name)
        elif isinstance(record, ChunkIndex):
            self._groups[Opcode.CHUNK_INDEX].take(
                record.chunk_start_offset, record.chunk_length,
                (record.message_start_time, record.message_end_time),
                (record.compression, record.compressed_size, record.uncompressed_size),
                sorted(record.message_index_offsets.items()), record.message_index_length,
            )  # fmt: skip
        elif isinstance(record, Statistics):
            self._statistics = [*self._statistics[:1], record]
        elif isinstance(record, SummaryOffset):
            self._offsets_start = self._offsets_start or offset
            if len(self._offsets) <= _GROUPS:
                place = record.group_start, record.group_length
                self._offsets.append((record.group_opcode, *place))
        elif isinstance(record, Footer):
            self._finish(offset, record)

    def declare(self, record: Schema | Channel, content: bytes, begin: int = -1) -> None:
        """Take a schema or a channel.

        begin : where it lies in its chunk
        """
        opcode = int(Opcode.SCHEMA if isinstance(record, Schema) else Opcode.CHANNEL)
        name = (
            f'{_kind(opcode)} {shown(record.name if isinstance(record, Schema) else record.topic)}'
        )
        if begin >= 0 and not _is_exact(record, content):
            self._find(f'{name} holds more than its fields')
        into = self._repeated if self._data_end >= 0 and begin < 0 else self._declared
        key, value = (opcode, record.id), (hashlib.sha256(content).digest(), name)
        if into.setdefault(key, value) != value or self._declared.get(key, value) != value:
            self._find(f'it has two {_kind(opcode)} records of number {record.id}')
        if isinstance(record, Channel) and into is self._declared:
            if begin >= 0:
                self._begins.setdefault(record.id, begin)
            if record.schema_id and (int(Opcode.SCHEMA), record.schema_id) not in into:
                self._find(f'{name} comes before its schema')

    def take_content(self, data: bytes, at: Sequence[int]) -> None:
        """Take the records inside the last chunk, and where the content of each message begins."""
        chunk = self._chunk
        if chunk is None:
            return
        places = np.array(at, dtype=np.intp)
        padded = np.frombuffer(data + bytes(_MESSAGE.itemsize), np.uint8)
        heads = sliding_window_view(padded, _MESSAGE.itemsize)[places].view(_MESSAGE)[:, 0]
        pairs = np.stack([heads['log_ns'], (places - _HEAD_BYTES).astype('<u8')], axis=1)
        times = int(pairs[:, 0].min(initial=1 << 63)), int(pairs[:, 0].max(initial=0))
        if chunk.times != (times if len(at) else (0, 0)):
            self._find(f'{_named(Opcode.CHUNK, chunk.offset)} has other times than its messages')
        for number in np.unique(heads['channel']).tolist():
            own = chunk.messages[number] = pairs[heads['channel'] == number]
            self._count(number, len(own), *times)
            if int(own[0, 1]) < self._begins.get(number, -1):
                self._find(_undeclared(number, chunk.offset))
            self._require_channel(number, chunk.offset)

    def _take_message_index(self, offset: int, content: bytes) -> None:
        """Compare the entries with the messages of the chunk before it, in any order."""
        chunk, number = self._chunk, -1
        length = _HEAD_BYTES + len(content)
        if len(content) >= _INDEX.size:
            number, size = _INDEX.unpack_from(content)
            number = number if size == len(content) - _INDEX.size and size % 16 == 0 else -1
        if chunk is None or number < 0 or number in chunk.indexes:
            self._find(f'{_named(Opcode.MESSAGE_INDEX, offset)} belongs to no chunk')
            return
        found = np.frombuffer(content, '<u8', offset=_INDEX.size).reshape(-1, 2)
        wanted = chunk.messages.get(number, np.empty((0, 2), np.uint64))
        if not np.array_equal(found, wanted) and not np.array_equal(
            _sorted(found), _sorted(wanted)
        ):
            self._find(f'{_named(Opcode.MESSAGE_INDEX, offset)} is not that of the chunk before it')
        chunk.indexes[number] = offset
        chunk.indexes_length += length

    def _end_chunk(self) -> None:
        """Expect the index of a chunk whose message indexes have come."""
        chunk, self._chunk = self._chunk, None
        if chunk is None:
            return
        missing = chunk.messages.keys() - chunk.indexes.keys()
        if missing and chunk.indexes:
            where = _named(Opcode.CHUNK, chunk.offset)
            self._find(f'{where} has no message index for its channel {min(missing)}')
        elif missing:
            self._lack('message indexes')
        self._groups[Opcode.CHUNK_INDEX].expect(
            chunk.offset, chunk.length, chunk.times, chunk.packing,
            sorted(chunk.indexes.items()), chunk.indexes_length,
        )  # fmt: skip

    def _count(self, channel: int, count: int, first_ns: int, last_ns: int) -> None:
        self._counts[channel] += count
        first, last = self._times or (first_ns, last_ns)
        self._times = min(first, first_ns), max(last, last_ns)

    def _require_channel(self, channel: int, offset: int) -> None:
        if (int(Opcode.CHANNEL), channel) not in self._declared:
            self._find(_undeclared(channel, offset))

    def _require_checksum(self, crc: int, of: str) -> None:
        if not crc:
            self._lack(f'checksum of {of}')

    def _place(self, opcode: int, offset: int) -> None:
        """Find a record that stands where it must not."""
        if opcode not in _DATA | _SUMMARY:
            self._find(f'the record at byte {offset} is of the unknown kind {opcode}')
        elif opcode not in (_DATA if self._data_end < 0 else _SUMMARY):
            side = 'before' if self._data_end < 0 else 'behind'
            self._find(f'{_named(opcode, offset)} stands {side} the end of the data')
        elif (opcode == Opcode.HEADER) != (self._records == 0):
            self._find(f'{_named(opcode, offset)} stands where the header must be, or is a second')

    def _take_group(self, opcode: int, offset: int, length: int) -> None:
        """Count a record of the summary to its group: all records of a kind in one row."""
        if opcode in (Opcode.DATA_END, Opcode.FOOTER, Opcode.SUMMARY_OFFSET):
            return
        last = self._grouped[-1] if self._grouped else (-1, 0, 0)
        if last[0] == opcode:
            self._grouped[-1] = (opcode, last[1], last[2] + length)
        elif len(self._grouped) <= _GROUPS:
            self._grouped.append((opcode, offset, length))
        kinds = [kind for kind, *_ in self._grouped]
        if len(set(kinds)) < len(kinds) or self._offsets_start:
            self._find(f'{_named(opcode, offset)} stands apart from its group in the summary')

    def _finish(self, offset: int, footer: Footer) -> None:
        """Compare the summary, after its last record."""
        self._require_checksum(footer.summary_crc, 'its summary')
        empty = not self._grouped and not self._offsets
        if footer.summary_start != self._data_end and not (empty and not footer.summary_start):
            self._find('its footer leads to another summary than that behind its data')
        begins = (self._offsets_start,) if self._offsets else (0, offset)
        filled = [place for place in self._offsets if place[2]]
        kinds = {kind for kind, *_ in self._grouped}
        stray = any(kind in kinds for kind, _, size in self._offsets if not size)
        if footer.summary_offset_start not in begins or stray:
            self._find('the summary offsets are not where its footer says')
        elif self._offsets and sorted(filled) != sorted(self._grouped):
            self._find('the summary offsets do not lead to the groups of its summary')
        for kind, group in self._groups.items():
            name = _kind(kind)
            if group.count and group.actual.digest() != group.expected.digest():
                what = name.removesuffix(' index')
                self._find(f'the {name} records of its summary do not lead to each {what} in turn')
            elif group.due > group.count:
                self._lack(f'{name} records')
        if self._groups[Opcode.CHUNK_INDEX].count and self._loose:
            self._find(f'its index does not lead to {self._loose} messages that are in no chunk')
        self._compare_declared()
        self._compare_statistics()

    def _compare_declared(self) -> None:
        """Compare the schemas and channels of the summary with those before."""
        for kind in (int(Opcode.SCHEMA), int(Opcode.CHANNEL)):
            before, after = (
                {key: name for key, (_, name) in found.items() if key[0] == kind}
                for found in (self._declared, self._repeated)
            )
            only = [after[key] for key in after.keys() - before.keys()]
            lacking = [before[key] for key in before.keys() - after.keys()]
            if only:
                self.unused = f'the {min(only)} is in its summary only'
            if lacking and after:
                self._find(f'its summary lacks the {min(lacking)}')
            elif lacking:
                self._lack(f'{_kind(kind)} records in its summary')

    def _compare_statistics(self) -> None:
        if not self._statistics:
            self._lack('statistics')
            return
        groups = [self._groups[kind].due for kind in self._groups]
        first, last = self._times or (0, 0)
        written = [kind for kind, _ in self._declared]
        all_kinds = [kind for kind, _ in self._declared.keys() | self._repeated.keys()]
        numbers = [
            (kinds.count(int(Opcode.SCHEMA)), kinds.count(int(Opcode.CHANNEL)))
            for kinds in (written, all_kinds)
        ]
        expected = (self._counts.total(), *groups, first, last, dict(self._counts))
        for said in self._statistics:
            counts = {channel: n for channel, n in said.channel_message_counts.items() if n}
            found = (
                said.message_count, said.chunk_count, said.attachment_count, said.metadata_count,
                said.message_start_time, said.message_end_time, counts,
            )  # fmt: skip
            if found != expected or (said.schema_count, said.channel_count) not in numbers:
                self._find('the statistics in its summary are not those of its records')
        if len(self._statistics) > 1:
            self._find('its summary has two statistics records')

    def _find(self, fault: str) -> None:
        self.fault = self.fault or fault

    def _lack(self, what: str) -> None:
        if what not in self.lacks:
            self.lacks.append(what)


def _is_exact(record: McapRecord, content: bytes) -> bool:
    """Return whether a record is all that its bytes hold: each field once, and nothing behind."""
    if isinstance(record, Chunk):
        fields = 8 + 8 + 8 + 4 + 4 + len(record.compression.encode()) + 8 + len(record.data)
        return fields == len(content)
    builder = RecordBuilder()
    record.write(builder)
    written = builder.end()[_HEAD_BYTES:]
    end = -4 if isinstance(record, Attachment) else None  # its checksum may be left out
    return written[:end] == content[:end] and len(written) == len(content)


def _sorted(pairs: Pairs) -> Pairs:
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def _kind(opcode: int) -> str:
    return Opcode(opcode).name.lower().replace('_', ' ')


def _named(opcode: int, offset: int) -> str:
    return f'the {_kind(opcode)} at byte {offset}'


def _undeclared(channel: int, offset: int) -> str:
    return f'a message of channel {channel} at byte {offset} comes before any record of its channel'
