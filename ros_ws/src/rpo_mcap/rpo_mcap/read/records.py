# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The records of an MCAP file in their order, as far as they are whole.

The library's `StreamReader` reads them. What it does not do is done here:

- it takes the bytes that are there for those that should be, so a record cut short looks whole;
- it skips what it does not know, also the zeros that a power cut leaves;
- a field may reach beyond the end of its record, and a damaged length may ask for terabytes;
- it does not check the checksums of attachments and of the summary, and after one that fails it
  cannot go on, as a tolerant reader must;
- it parses indexes and messages one number at a time, which takes longer than all the rest;
- it decompresses what a file of some kilobytes says are gigabytes.
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Schema
from mcap.stream_reader import CRCValidationError, StreamReader, get_chunk_data_stream

from rpo_core.files import open_regular
from rpo_core.files.validation import shown
from rpo_mcap.errors import LogError, NotARun, cannot_read
from rpo_mcap.read.indexes import Indexes

MAGIC = b'\x89MCAP0\r\n'
MAX_RECORD_BYTES = 1 << 25
"""A longer record, or chunk when decompressed, is not read: ours have at most some megabytes."""
MAX_REST_BYTES = 1 << 28
"""Bytes behind the end of a damaged file that are hashed with it; a sparse file has terabytes."""
MAX_RATIO = 1000
"""A chunk that grows more when decompressed is a bomb; ours grow 100 times at the most."""
RECORD_HEAD = struct.Struct('<BQ')
"""Opcode and length of the content, before the content of each record."""
MESSAGE_HEAD = struct.Struct('<HIQQ')
"""Channel, sequence, log time and publish time, before the data of a message."""

_IN_CHUNKS = frozenset((int(Opcode.SCHEMA), int(Opcode.CHANNEL)))
_INDEXES = frozenset(
    (
        Opcode.MESSAGE_INDEX, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX,
        Opcode.STATISTICS, Opcode.SUMMARY_OFFSET,
    )
)  # fmt: skip
_FILLING = frozenset((int(Opcode.CHUNK), int(Opcode.MESSAGE)))
_SKIMMED = _FILLING | {int(Opcode.MESSAGE_INDEX)}


class _WholeReads(ReadDataStream):
    """The library's stream, but each read gets all the bytes that it asks for, or EndOfFile."""

    def read(self, length: int) -> bytes:
        """Return the next bytes."""
        data = self._stream.read(min(length, MAX_RECORD_BYTES))
        if len(data) != length:
            raise EndOfFile
        self._count += length
        return data


@dataclass
class FileRecords:
    """Iterates the records of one file but for its indexes; raises LogError if one is corrupt.

    tolerant : go on after a checksum that fails, and without records that are corrupt
    offset : where the last record begins
    damage : after the iteration, what is wrong with the file: where it ends early, or, tolerant,
        what does not fit; empty if it is whole
    lost_chunks : chunks passed over
    sha256 : of the bytes read so far; after the iteration, of the file but for `unread`
    unread : after the iteration, bytes behind the damage that are too many to be hashed
    skim : pass over chunks, messages and indexes: nothing is hashed, no checksum is compared
    filled : whether there were chunks or messages
    known : outline of the file when it was skimmed: it may have grown since, and not changed
    indexes : takes all records, to compare what leads other readers through the file
    """

    path: Path
    tolerant: bool = False
    offset: int = 0
    damage: str = ''
    lost_chunks: int = 0
    unread: int = 0
    skim: bool = False
    filled: bool = False
    known: tuple[int, bytes] = (0, b'')
    indexes: Indexes | None = None
    _zstd: zstandard.ZstdDecompressor = field(default_factory=zstandard.ZstdDecompressor)
    sha256: hashlib._Hash = field(default_factory=hashlib.sha256)
    _end: int = 0  # of the last whole record
    _count: int = 0
    _outline: hashlib._Hash = field(default_factory=hashlib.sha256)

    def __iter__(self) -> Iterator[McapRecord]:
        try:
            with open_regular(self.path) as stream:
                yield from self._walk(stream)
        except OSError as error:
            raise cannot_read(self.path, error) from None

    @property
    def outline(self) -> tuple[int, bytes]:
        """Number of records so far, and SHA-256 of those that skimming reads."""
        return self._count, self._outline.digest()

    def _walk(self, stream: BinaryIO) -> Iterator[McapRecord]:
        magic = stream.read(len(MAGIC))
        if magic != MAGIC:
            what = f'begins with {magic.hex(" ")}' if magic else 'is empty'
            raise NotARun(self.path, f'is not an MCAP file: it {what}')
        size = stream.seek(0, 2)
        stream.seek(len(MAGIC))
        self.sha256 = hashlib.sha256(MAGIC)
        self._end = len(MAGIC)
        closed = False
        try:
            for record in self._records(stream, size):
                closed = isinstance(record, Footer)
                yield record
            if self._read(stream, len(MAGIC)) != MAGIC:
                raise EndOfFile
            rest = size - self._end - len(MAGIC)
            self.damage = self.damage or (f'{rest} bytes follow its end' if rest else '')
        except EndOfFile:
            self.damage = (
                'the last 8 bytes are missing'
                if closed
                else f'no whole record at byte {self._end} of {size}'
            )
        if self._count < self.known[0]:
            raise self._changed()
        self.unread = size - stream.tell()
        if self.skim:
            return
        if self.unread <= MAX_REST_BYTES:
            while block := stream.read(MAX_RECORD_BYTES):
                self.sha256.update(block)
            self.unread = 0

    def _records(self, stream: BinaryIO, size: int) -> Iterator[McapRecord]:
        """Yield the records up to the footer, each with its length and checksum judged.

        Raises EndOfFile where no whole record follows.
        """
        crc, opcode = zlib.crc32(MAGIC), 0  # of all up to the last record, and its kind
        ended = False
        while opcode != Opcode.FOOTER:
            head = self._read(stream, RECORD_HEAD.size)
            opcode, length = RECORD_HEAD.unpack(head)
            if opcode == 0:  # what a power cut leaves
                raise EndOfFile
            self.offset = self._end
            passed = opcode in _SKIMMED
            self.filled = self.filled or opcode in _FILLING
            if self.skim and passed:
                if length > size - stream.tell():
                    raise EndOfFile
                stream.seek(length, 1)
                self._end = self.offset + len(head) + length
                self._sketch(head)
                continue
            if MAX_RECORD_BYTES < length <= size - stream.tell():
                why = f'it has {length} bytes; at most {MAX_RECORD_BYTES} are read'
                self.pass_over(opcode, self.corrupt(opcode, why))
                raise EndOfFile
            content = self._read(stream, length)
            self._end = self.offset + len(head) + length
            self._sketch(head if passed else head + content)
            before, crc = crc, zlib.crc32(head, crc)
            if self.skim:
                pass
            elif opcode == Opcode.DATA_END and not ended:
                self._check(content, before, 'data section')
                crc, ended = 0, True
            elif opcode == Opcode.FOOTER:
                self._check(content, zlib.crc32(content[:-4], crc), 'summary')
            else:
                crc = zlib.crc32(content, crc)
            unread = _INDEXES if self.indexes is None else (Opcode.MESSAGE_INDEX,)
            try:
                record = None if opcode in unread else self.parse(opcode, content)
            except LogError as error:
                self.pass_over(opcode, error)
                continue
            if self.indexes is not None:
                self.indexes.take(opcode, self.offset, content, record)
            if record is not None and opcode not in _INDEXES:
                yield record

    def _sketch(self, data: bytes) -> None:
        """Add a record to the outline; LogError if it is not as it was when it was skimmed."""
        self._count += 1
        self._outline.update(data)
        if self._count == self.known[0] and self.outline != self.known:
            raise self._changed()

    def _changed(self) -> LogError:
        return LogError(self.path, 'was changed while it was read')

    def _read(self, stream: BinaryIO, length: int) -> bytes:
        data = stream.read(min(length, MAX_RECORD_BYTES))
        self.sha256.update(data)
        if len(data) != length:
            raise EndOfFile
        return data

    def parse(self, opcode: int, content: bytes) -> McapRecord | None:
        """Return a record by its content; raises LogError if a field reaches beyond it."""
        if opcode == Opcode.ATTACHMENT and not _fits(content, zlib.crc32(content[:-4])):
            raise self.corrupt(opcode, 'its checksum does not fit')
        reader = StreamReader(BytesIO())
        reader._stream = _WholeReads(BytesIO(content))
        try:
            return reader._read_record(opcode, len(content))
        except (McapError, struct.error, UnicodeDecodeError):
            raise self.corrupt(opcode, 'its fields do not fit its length') from None

    def _check(self, content: bytes, actual: int, part: str) -> None:
        """Compare the checksum of a section with the last 4 bytes of a record."""
        if _fits(content, actual):
            return
        self.damage = f'the checksum of its {part} does not fit'
        if not self.tolerant:
            raise LogError(
                self.path,
                f'is corrupt: the checksum of its {part}, '
                f'which ends at byte {self.offset}, does not fit',
            )

    def pass_over(self, opcode: int, error: LogError) -> None:
        """Go on after a record that is corrupt, where that is allowed."""
        if not self.tolerant:
            raise error
        self.damage = error.sentence
        self.lost_chunks += opcode == Opcode.CHUNK

    def corrupt(self, opcode: int, why: str) -> LogError:
        """Return the LogError of a damaged record, the last one read."""
        known = opcode in set(Opcode)
        name = Opcode(opcode).name.lower().replace('_', ' ') if known else f'record {opcode}'
        return LogError(self.path, f'is corrupt: the {name} at byte {self.offset}: {why}')

    def content_of(self, chunk: Chunk) -> bytes:
        """Return the records inside the chunk read last, decompressed; raises LogError."""
        try:
            _check_sizes(chunk)
            size = chunk.uncompressed_size
            if chunk.compression == 'zstd':  # the library makes a decompressor for each chunk
                chunk.data = self._zstd.decompress(
                    chunk.data, max_output_size=size, allow_extra_data=False
                )
            elif chunk.compression == 'lz4':  # the library sets no limit
                chunk.data = _unpacked_lz4(chunk.data, size)
            chunk.compression = ''
            stream, size = get_chunk_data_stream(chunk, validate_crc=True)
            records = stream.read(size)
        except CRCValidationError:
            raise self.corrupt(Opcode.CHUNK, 'its checksum does not fit') from None
        except (McapError, zstandard.ZstdError, RuntimeError, ValueError, MemoryError) as error:
            raise self.corrupt(Opcode.CHUNK, f'it cannot be decompressed ({error})') from None
        if len(records) != chunk.uncompressed_size:
            raise self.corrupt(Opcode.CHUNK, 'its lengths do not fit')
        return records

    def messages_in(self, records: bytes, take: Callable[[McapRecord], None]) -> list[int]:
        """Return where the content of each message begins in the records of a chunk.

        take : gets each record that is no message, first
        """
        found, at, end = [], 0, len(records)
        unpack, head, message = RECORD_HEAD.unpack_from, RECORD_HEAD.size, int(Opcode.MESSAGE)
        while at < end:
            opcode, length = unpack(records, at) if at + head <= end else (0, end)
            at += head
            if at + length > end:
                raise self.corrupt(Opcode.CHUNK, 'its last record is cut short')
            if opcode == message:
                found.append(at)
            elif opcode in _IN_CHUNKS:
                record = self.parse(opcode, records[at : at + length])
                if self.indexes is not None and isinstance(record, Schema | Channel):
                    self.indexes.declare(record, records[at : at + length], at)
                if record is not None:
                    take(record)
            else:
                raise self.corrupt(Opcode.CHUNK, f'it holds a record of kind {opcode}')
            at += length
        if self.indexes is not None:
            self.indexes.take_content(records, found)
        return found


class RawMessage(NamedTuple):
    """A message record: its fields as they stand in the file."""

    channel: int
    sequence: int
    log_ns: int
    publish_ns: int
    data: bytes


def message_at(records: bytes, at: int) -> RawMessage:
    """Return the message whose content begins at a place that `messages_in` found."""
    _, length = RECORD_HEAD.unpack_from(records, at - RECORD_HEAD.size)
    content = records[at : at + length].ljust(MESSAGE_HEAD.size, b'\0')
    data = content[MESSAGE_HEAD.size :]
    return RawMessage._make((*MESSAGE_HEAD.unpack_from(content), data))


def as_record(message: Message) -> bytes:
    """Return the record of a message that is in no chunk, as it stands in the file."""
    builder = RecordBuilder()
    message.write(builder)
    return bytes(builder.end())


def _fits(content: bytes, actual: int) -> bool:
    """Return whether a checksum is the last 4 bytes of a record; 0 means that there is none."""
    return len(content) >= 4 and int.from_bytes(content[-4:], 'little') in (0, actual)


def _unpacked_lz4(data: bytes, size: int) -> bytes:
    """Return the frame that is the data of a chunk; RuntimeError if it is not all of it.

    One byte more than expected is enough to see that there are more.
    """
    unpacker = lz4.frame.LZ4FrameDecompressor()
    unpacked: bytes = unpacker.decompress(data, size + 1)
    if len(unpacked) <= size and (not unpacker.eof or unpacker.unused_data):
        raise RuntimeError('its data is not one whole frame')
    return unpacked


def _check_sizes(chunk: Chunk) -> None:
    """Raise ValueError where a damaged size asks for more memory than there is."""
    size = chunk.uncompressed_size
    if chunk.compression not in ('', 'zstd', 'lz4'):
        raise ValueError(f'unknown compression {shown(chunk.compression)}')
    most = min(MAX_RECORD_BYTES, MAX_RATIO * len(chunk.data))
    if size > most:
        raise ValueError(f'it would have {size} bytes; at most {most} are read')
    if chunk.compression == 'zstd' and zstandard.frame_content_size(chunk.data) not in (size, -1):
        raise ValueError('its sizes disagree')
