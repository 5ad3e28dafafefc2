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
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, McapRecord, Schema
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from rpo_core.files.validation import shown

_HEAD_BYTES = 9
"""Opcode and length before the content of each record."""

LEADING = frozenset(
    (
        Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX, Opcode.STATISTICS,
        Opcode.SUMMARY_OFFSET,
    )
)  # fmt: skip
"""Records that only a summary has."""

_DATA = frozenset(Opcode) - LEADING - {Opcode.FOOTER}
_SUMMARY = LEADING | {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.FOOTER}
_IN_NO_GROUP = (Opcode.DATA_END, Opcode.FOOTER, Opcode.SUMMARY_OFFSET)
_INDEXES = (records.ChunkIndex, records.AttachmentIndex, records.MetadataIndex)
_DECLARATIONS = (Schema, Channel)
_MESSAGE = np.dtype([('channel', '<u2'), ('sequence', '<u4'), ('log_ns', '<u8')])
_INDEX = struct.Struct('<HI')

Pairs = NDArray[np.uint64]


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
        self._data_end = -1  # where the summary begins
        # Of the last chunk, while its message indexes come: what leads to it, and per channel
        # (n, 2) log time and offset of each message.
        self._chunk: records.ChunkIndex | None = None
        self._messages: dict[int, Pairs] = {}
        self._begins: dict[int, int] = {}  # where it declares channels
        # Index records by type, those that must be there (True) and those that are.
        self._numbers: Counter[tuple[type, bool]] = Counter()
        self._digests: dict[tuple[type, bool], hashlib._Hash] = defaultdict(hashlib.sha256)
        self._declared: dict[tuple[type, int], tuple[bytes, str]] = {}  # digest and name
        self._repeated: dict[tuple[type, int], tuple[bytes, str]] = {}  # in the summary
        self._loose = 0  # messages in no chunk
        self._counts: Counter[int] = Counter()
        self._times: tuple[int, int] | None = None
        self._statistics: records.Statistics | None = None
        self._groups: dict[int, tuple[int, int]] = {}  # by opcode, start and length
        self._offsets: dict[int, tuple[int, int]] = {}  # to them
        self._offsets_start = 0

    @property
    def ended(self) -> bool:
        """Whether the data has ended, and the summary begun."""
        return self._data_end >= 0

    def take(self, opcode: int, offset: int, content: bytes, record: McapRecord | None) -> None:
        """Take the next record of the file.

        record : None if it is a message or a message index, or of an unknown kind
        """
        if opcode == Opcode.MESSAGE_INDEX:
            self._take_message_index(offset, content)
            return
        self._end_chunk()
        self._place(opcode, offset)
        if record is not None and not _is_exact(record, content):
            self._find(f'{_named(opcode, offset)} holds more than its fields')
        length = _HEAD_BYTES + len(content)
        if self.ended and opcode not in _IN_NO_GROUP:
            self._take_group(opcode, offset, length)
        match record:
            case Schema() | Channel():
                self.declare(record, content)
            case records.Chunk():
                self._chunk = records.ChunkIndex(
                    length, offset, record.compression, len(record.data), record.message_end_time,
                    0, {}, record.message_start_time, record.uncompressed_size,
                )  # fmt: skip
                self._require_checksum(record.uncompressed_crc, 'its chunks')
            case None if opcode == Opcode.MESSAGE and len(content) >= _MESSAGE.itemsize:
                channel, _, log_ns = struct.unpack_from('<HIQ', content)
                self._loose += 1
                self._count(channel, 1, (log_ns, log_ns), offset)
            case records.Attachment(create_time, log_time, name, media_type, data):
                self._require_checksum(int.from_bytes(content[-4:], 'little'), 'its attachments')
                times = log_time, create_time
                index = records.AttachmentIndex(offset, length, *times, len(data), name, media_type)
                self._note(index, due=True)
            case records.Metadata():
                self._note(records.MetadataIndex(offset, length, record.name), due=True)
            case records.DataEnd():
                self._data_end = offset + length if self._data_end < 0 else self._data_end
                self._require_checksum(record.data_section_crc, 'its data')
            case records.ChunkIndex() | records.AttachmentIndex() | records.MetadataIndex():
                self._note(record, due=False)
            case records.Statistics():
                if self._statistics is not None:
                    self._find('its summary has two statistics records')
                self._statistics = record
            case records.SummaryOffset(kind, start, size):
                self._offsets_start = self._offsets_start or offset
                if kind in self._offsets:
                    self._find(f'{_named(opcode, offset)} leads to a group that has another')
                self._offsets[kind] = start, size
            case records.Footer():
                self._finish(offset, record)

    def declare(self, record: Schema | Channel, content: bytes, begin: int = -1) -> None:
        """Take a schema or a channel.

        begin : where it lies in its chunk
        """
        cls = type(record)
        called = record.name if isinstance(record, Schema) else record.topic
        name = f'{cls.__name__.lower()} {shown(called)}'
        if begin >= 0 and not _is_exact(record, content):
            self._find(f'{name} holds more than its fields')
        into = self._repeated if self.ended and begin < 0 else self._declared
        key, value = (cls, record.id), (hashlib.sha256(content).digest(), name)
        if into.setdefault(key, value) != value or self._declared.get(key, value) != value:
            self._find(f'it has two {cls.__name__.lower()} records of number {record.id}')
        if isinstance(record, Channel) and into is self._declared:
            if begin >= 0:
                self._begins.setdefault(record.id, begin)
            if record.schema_id and (Schema, record.schema_id) not in into:
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
        place = chunk.chunk_start_offset
        if (chunk.message_start_time, chunk.message_end_time) != (times if len(at) else (0, 0)):
            self._find(f'{_named(Opcode.CHUNK, place)} has other times than its messages')
        for number in np.unique(heads['channel']).tolist():
            entries = self._messages[number] = pairs[heads['channel'] == number]
            before = int(entries[0, 1]) < self._begins.get(number, -1)
            self._count(number, len(entries), times, place, before)

    def _take_message_index(self, offset: int, content: bytes) -> None:
        """Compare the entries with the messages of the chunk before it, in any order."""
        chunk, number = self._chunk, -1
        if len(content) >= _INDEX.size:
            number, size = _INDEX.unpack_from(content)
            number = number if size == len(content) - _INDEX.size and size % 16 == 0 else -1
        if chunk is None or number < 0 or number in chunk.message_index_offsets:
            self._find(f'{_named(Opcode.MESSAGE_INDEX, offset)} belongs to no chunk')
            return
        entries = np.frombuffer(content, '<u8', offset=_INDEX.size).reshape(-1, 2)
        wanted = self._messages.get(number, np.empty((0, 2), np.uint64))
        if not np.array_equal(entries, wanted) and not np.array_equal(
            _sorted(entries), _sorted(wanted)
        ):
            self._find(f'{_named(Opcode.MESSAGE_INDEX, offset)} is not that of the chunk before it')
        chunk.message_index_offsets[number] = offset
        chunk.message_index_length += _HEAD_BYTES + len(content)

    def _end_chunk(self) -> None:
        """Expect the index of a chunk whose message indexes have come."""
        if self._chunk is None:
            return
        missing = self._messages.keys() - self._chunk.message_index_offsets.keys()
        if missing and self._chunk.message_index_offsets:
            where = _named(Opcode.CHUNK, self._chunk.chunk_start_offset)
            self._find(f'{where} has no message index for its channel {min(missing)}')
        elif missing:
            self._lack('message indexes')
        self._note(self._chunk, due=True)
        self._chunk, self._messages, self._begins = None, {}, {}

    def _count(
        self, channel: int, count: int, times: tuple[int, int], offset: int, early: bool = False
    ) -> None:
        """Count messages of a channel; early: they come before it in their chunk."""
        self._counts[channel] += count
        first, last = self._times or times
        self._times = min(first, times[0]), max(last, times[1])
        if early or (Channel, channel) not in self._declared:
            where = f'of channel {channel} at byte {offset}'
            self._find(f'a message {where} comes before any record of its channel')

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
        elif (opcode == Opcode.HEADER) != (offset == 8):  # behind the magic bytes
            self._find(f'{_named(opcode, offset)} stands where the header must be, or is a second')

    def _take_group(self, opcode: int, offset: int, length: int) -> None:
        """Count a record of the summary to its group: all records of a kind in one row."""
        start, size = self._groups.get(opcode, (offset, 0))
        if start + size != offset or self._offsets_start:
            self._find(f'{_named(opcode, offset)} stands apart from its group in the summary')
        self._groups[opcode] = start, size + length

    def _finish(self, offset: int, footer: records.Footer) -> None:
        """Compare the summary, after its last record."""
        self._require_checksum(footer.summary_crc, 'its summary')
        empty = not self._groups and not self._offsets
        if footer.summary_start != self._data_end and not (empty and not footer.summary_start):
            self._find('its footer leads to another summary than that behind its data')
        filled = {kind: place for kind, place in self._offsets.items() if place[1]}
        begins = (self._offsets_start,) if self._offsets else (0, offset)
        if footer.summary_offset_start not in begins or (self._offsets and filled != self._groups):
            self._find('the summary offsets do not lead to the groups of its summary')
        for kind in _INDEXES:
            name = kind.__name__.removesuffix('Index').lower()
            due, count = self._numbers[kind, True], self._numbers[kind, False]
            expected, actual = (self._digests[kind, is_due].digest() for is_due in (True, False))
            if count and actual != expected:
                where = f'the {name} index records of its summary'
                self._find(f'{where} do not lead to each {name} in turn')
            elif due > count:
                self._lack(f'{name} index records')
        if self._numbers[records.ChunkIndex, False] and self._loose:
            self._find(f'its index does not lead to {self._loose} messages that are in no chunk')
        self._compare_declared()
        self._compare_statistics()

    def _compare_declared(self) -> None:
        """Compare the schemas and channels of the summary with those before."""
        for kind in _DECLARATIONS:
            before, after = (
                {key: name for key, (_, name) in side.items() if key[0] is kind}
                for side in (self._declared, self._repeated)
            )
            only = [after[key] for key in after.keys() - before.keys()]
            lacking = [before[key] for key in before.keys() - after.keys()]
            if only:
                self.unused = f'the {min(only)} is in its summary only'
            if lacking and after:
                self._find(f'its summary lacks the {min(lacking)}')
            elif lacking:
                self._lack(f'{kind.__name__.lower()} records in its summary')

    def _compare_statistics(self) -> None:
        if (said := self._statistics) is None:
            self._lack('statistics')
            return
        first, last = self._times or (0, 0)
        chunks, attachments, metadata = (self._numbers[kind, True] for kind in _INDEXES)
        expected = records.Statistics(
            attachments, said.channel_count, dict(self._counts), chunks, self._counts.total(),
            last, first, metadata, said.schema_count,
        )  # fmt: skip
        counts = {channel: n for channel, n in said.channel_message_counts.items() if n}
        numbers = [
            tuple(sum(kind is wanted for kind, _ in keys) for wanted in _DECLARATIONS)
            for keys in (self._declared.keys(), self._declared.keys() | self._repeated.keys())
        ]
        same = replace(said, channel_message_counts=counts) == expected
        if not same or (said.schema_count, said.channel_count) not in numbers:
            self._find('the statistics in its summary are not those of its records')

    def _note(self, index: McapRecord, due: bool) -> None:
        """Take an index record that must be there, or one that is."""
        if isinstance(index, records.ChunkIndex):  # its message indexes come in any order
            offsets = dict(sorted(index.message_index_offsets.items()))
            index = replace(index, message_index_offsets=offsets)
        self._numbers[type(index), due] += 1
        self._digests[type(index), due].update(repr(index).encode())

    def _find(self, fault: str) -> None:
        self.fault = self.fault or fault

    def _lack(self, what: str) -> None:
        if what not in self.lacks:
            self.lacks.append(what)


def _is_exact(record: McapRecord, content: bytes) -> bool:
    """Return whether a record is all that its bytes hold: each field once, and nothing behind."""
    if isinstance(record, records.Chunk):
        fields = 8 + 8 + 8 + 4 + 4 + len(record.compression.encode()) + 8 + len(record.data)
        return fields == len(content)
    builder = RecordBuilder()
    record.write(builder)
    written = builder.end()[_HEAD_BYTES:]
    end = -4 if isinstance(record, records.Attachment) else None  # its checksum may be left out
    return written[:end] == content[:end] and len(written) == len(content)


def _sorted(pairs: Pairs) -> Pairs:
    return pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]


def _named(opcode: int, offset: int) -> str:
    return f'the {Opcode(opcode).name.lower().replace("_", " ")} at byte {offset}'
