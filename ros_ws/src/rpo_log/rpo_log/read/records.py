# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The records of an MCAP file in their order, as far as they are whole.

The library's `StreamReader` parses each of them. What it does not do is done here:

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
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import lz4.frame
import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Schema
from mcap.stream_reader import StreamReader

from rpo_core.files import open_regular
from rpo_core.files.validation import shown
from rpo_log.errors import LogError, NotARun, cannot_read
from rpo_log.read.indexes import LEADING, Indexes

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

_FILLING = frozenset((int(Opcode.CHUNK), int(Opcode.MESSAGE)))
_SKIMMED = _FILLING | {int(Opcode.MESSAGE_INDEX)}
_IN_CHUNKS = frozenset((int(Opcode.SCHEMA), int(Opcode.CHANNEL)))
_PARSED = frozenset(Opcode) - {Opcode.MESSAGE, Opcode.MESSAGE_INDEX}


class Content(NamedTuple):
    """The records of a chunk, or a message that is in no chunk.

    at : where the content of each message begins
    """

    data: bytes
    at: list[int]


class _WholeReads(BytesIO):
    """Each read gets all the bytes that it asks for, or EndOfFile."""

    def read(self, length: int | None = None) -> bytes:
        data = super().read(min(length or 0, MAX_RECORD_BYTES))
        if len(data) != length:
            raise EndOfFile
        return data


@dataclass
class FileRecords:
    """Iterates the records of one file, messages as `Content`; raises LogError if one is corrupt.

    tolerant : go on after a checksum that fails, and without records that are corrupt
    skim : pass over chunks, messages and indexes: nothing is hashed, no checksum is compared
    known : outline of the file when it was skimmed: it may have grown since, and not changed
    indexes : takes all records, to compare what leads other readers through the file
    offset : where the last record begins
    damage : after the iteration, what is wrong with the file: where it ends early, or, tolerant,
        what does not fit; empty if it is whole
    lost_chunks : chunks passed over
    filled : whether there were chunks or messages
    digest : after the iteration, SHA-256 of the file; empty if it was not read to its end
    """

    path: Path
    tolerant: bool = False
    skim: bool = False
    known: tuple[int, bytes] = (0, b'')
    indexes: Indexes | None = None
    offset: int = 0
    damage: str = ''
    lost_chunks: int = 0
    filled: bool = False
    digest: str = ''
    _count: int = 0
    _sha256: hashlib._Hash = field(default_factory=hashlib.sha256)
    _outline: hashlib._Hash = field(default_factory=hashlib.sha256)
    _zstd: zstandard.ZstdDecompressor = field(default_factory=zstandard.ZstdDecompressor)

    def __iter__(self) -> Iterator[McapRecord | Content]:
        try:
            with open_regular(self.path) as stream:
                yield from self._walk(stream)
        except OSError as error:
            raise cannot_read(self.path, error) from None

    @property
    def outline(self) -> tuple[int, bytes]:
        """Number of records so far, and SHA-256 of those that skimming reads."""
        return self._count, self._outline.digest()

    def _walk(self, stream: BinaryIO) -> Iterator[McapRecord | Content]:
        """Yield the records.

        What a power cut leaves may end with a chunk whose bytes never reached the disk: a corrupt
        chunk is the end of a file that was not closed, if no sound one follows.
        """
        magic = stream.read(len(MAGIC))
        if magic != MAGIC:
            what = f'begins with {magic.hex(" ")}' if magic else 'is empty'
            raise NotARun(self.path, f'is not an MCAP file: it {what}')
        size = stream.seek(0, 2)
        stream.seek(len(MAGIC))
        self._sha256.update(MAGIC)
        opcode, corrupt = 0, None
        try:
            for opcode, content in self._contents(stream, size):
                try:
                    records = self._opened(opcode, content)
                except LogError as error:
                    if self.tolerant or opcode != Opcode.CHUNK:
                        self._pass_over(opcode, error)
                    else:
                        corrupt = corrupt or error
                    continue
                if corrupt is None:
                    yield from records
                elif opcode == Opcode.CHUNK:
                    raise corrupt
            if self._read(stream, len(MAGIC)) != MAGIC:
                raise EndOfFile
            rest = size - stream.tell()
            self.damage = self.damage or (f'{rest} bytes follow its end' if rest else '')
        except EndOfFile:
            torn = f'no whole record at byte {self.offset} of {size}'
            self.damage = 'the last 8 bytes are missing' if opcode == Opcode.FOOTER else torn
        if self._count < self.known[0]:
            raise self._changed()
        if corrupt is not None:
            if not self.damage:
                raise corrupt
            self.damage = corrupt.sentence
        if not self.skim and size - stream.tell() <= MAX_REST_BYTES:
            while block := stream.read(MAX_RECORD_BYTES):
                self._sha256.update(block)
            self.digest = self._sha256.hexdigest()

    def _contents(self, stream: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
        """Yield opcode and content of each record up to the footer, its checksum judged.

        Raises EndOfFile where no whole record follows.
        """
        crc, opcode = zlib.crc32(MAGIC), 0  # of all up to the last record, and its kind
        ended = False
        while opcode != Opcode.FOOTER:
            self.offset = stream.tell()
            head = self._read(stream, RECORD_HEAD.size)
            opcode, length = RECORD_HEAD.unpack(head)
            if opcode == 0:  # what a power cut leaves
                raise EndOfFile
            passed, left = opcode in _SKIMMED, size - stream.tell()
            self.filled = self.filled or opcode in _FILLING
            if self.skim and passed:
                if length > left:
                    raise EndOfFile
                stream.seek(length, 1)
                self._sketch(head)
                continue
            if MAX_RECORD_BYTES < length <= left:
                where = f'the record at byte {self.offset}'
                why = f'it has {length} bytes; at most {MAX_RECORD_BYTES} are read'
                self._pass_over(opcode, LogError(self.path, f'is corrupt: {where}: {why}'))
                raise EndOfFile
            content = self._read(stream, length)
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
            yield opcode, content

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
        self._sha256.update(data)
        if len(data) != length:
            raise EndOfFile
        return data

    def _check(self, content: bytes, actual: int, part: str) -> None:
        """Compare the checksum of a section with the last 4 bytes of a record."""
        if not _fits(content, actual):
            where = f'the checksum of its {part}, which ends at byte {self.offset},'
            self._pass_over(0, LogError(self.path, f'is corrupt: {where} does not fit'))

    def _pass_over(self, opcode: int, error: LogError) -> None:
        """Go on after a record that is corrupt, where that is allowed."""
        if not self.tolerant:
            raise error
        self.damage = error.sentence
        self.lost_chunks += opcode == Opcode.CHUNK

    def _corrupt(self, opcode: int, why: str) -> LogError:
        """Return the LogError of a damaged record, the last one read."""
        where = f'the {Opcode(opcode).name.lower().replace("_", " ")} at byte {self.offset}'
        return LogError(self.path, f'is corrupt: {where}: {why}')

    def _opened(self, opcode: int, content: bytes) -> list[McapRecord | Content]:
        """Return a record, or those of a chunk; none if it is an index, or of an unknown kind."""
        record = None
        if opcode in _PARSED and (self.indexes is not None or opcode not in LEADING):
            record = self._parse(opcode, content)
        if self.indexes is not None:
            self.indexes.take(opcode, self.offset, content, record)
        if isinstance(record, Chunk):
            return self._records_of(self._content_of(record))
        if opcode == Opcode.MESSAGE:
            return [Content(RECORD_HEAD.pack(opcode, len(content)) + content, [RECORD_HEAD.size])]
        return [] if record is None else [record]

    def _parse(self, opcode: int, content: bytes) -> McapRecord:
        """Return a record by its content; raises LogError if a field reaches beyond it."""
        if opcode == Opcode.ATTACHMENT and not _fits(content, zlib.crc32(content[:-4])):
            raise self._corrupt(opcode, 'its checksum does not fit')
        stream = _WholeReads(RECORD_HEAD.pack(opcode, len(content)) + content)
        try:
            return next(iter(StreamReader(stream, skip_magic=True, emit_chunks=True).records))
        except (McapError, struct.error, UnicodeDecodeError):
            raise self._corrupt(opcode, 'its fields do not fit its length') from None

    def _content_of(self, chunk: Chunk) -> bytes:
        """Return the records inside a chunk, decompressed; raises LogError."""
        try:
            _check_sizes(chunk)
            data = chunk.data
            if chunk.compression == 'zstd':  # the library makes a decompressor for each chunk
                data = self._zstd.decompress(
                    data, max_output_size=chunk.uncompressed_size, allow_extra_data=False
                )
            elif chunk.compression == 'lz4':  # the library sets no limit
                data = _unpacked_lz4(data, chunk.uncompressed_size)
        except (zstandard.ZstdError, RuntimeError, ValueError, MemoryError) as error:
            raise self._corrupt(Opcode.CHUNK, f'it cannot be decompressed ({error})') from None
        if len(data) != chunk.uncompressed_size:
            raise self._corrupt(Opcode.CHUNK, 'its lengths do not fit')
        if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            raise self._corrupt(Opcode.CHUNK, 'its checksum does not fit')
        return data

    def _records_of(self, data: bytes) -> list[McapRecord | Content]:
        """Return the records of a chunk, its messages last."""
        records: list[McapRecord | Content] = []
        places, at, end = list[int](), 0, len(data)
        unpack, head, message = RECORD_HEAD.unpack_from, RECORD_HEAD.size, int(Opcode.MESSAGE)
        while at < end:
            opcode, length = unpack(data, at) if at + head <= end else (0, end)
            at += head
            if at + length > end:
                raise self._corrupt(Opcode.CHUNK, 'its last record is cut short')
            if opcode == message:
                places.append(at)
            elif opcode in _IN_CHUNKS:
                record = self._parse(opcode, data[at : at + length])
                if self.indexes is not None and isinstance(record, Schema | Channel):
                    self.indexes.declare(record, data[at : at + length], at)
                records.append(record)
            else:
                raise self._corrupt(Opcode.CHUNK, f'it holds a record of kind {opcode}')
            at += length
        if self.indexes is not None:
            self.indexes.take_content(data, places)
        return [*records, Content(data, places)]


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
    max_size = min(MAX_RECORD_BYTES, MAX_RATIO * len(chunk.data))
    if size > max_size:
        raise ValueError(f'it would have {size} bytes; at most {max_size} are read')
    if chunk.compression == 'zstd' and zstandard.frame_content_size(chunk.data) not in (size, -1):
        raise ValueError('its sizes disagree')
