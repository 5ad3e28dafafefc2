# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The records of an MCAP file in their order, as far as they are whole.

The library's readers want an intact file, or take one message at a time. This walk tells a file cut
short from a corrupt one and from one that is not MCAP, checks every checksum there is, and hands
out whole chunks.
"""

from __future__ import annotations

import struct
import threading
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple, TypeVar

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from rpo_log.errors import Kind, LogError

MAGIC = b'\x89MCAP0\r\n'
MAX_CHUNK_BYTES = 1 << 30

_RECORD = struct.Struct('<BQ')
_CHUNK = struct.Struct('<QQQII')
_FOOTER = struct.Struct('<QQI')
_OPCODES = frozenset(int(opcode) for opcode in Opcode)
_Parsed = TypeVar('_Parsed')


class _Own(threading.local):
    """A decompressor takes longer to make than to use, and serves one thread at a time."""

    def __init__(self) -> None:
        self.decompressor = zstandard.ZstdDecompressor()


_own = _Own()


class Record(NamedTuple):
    """One record: opcode, offset in the file, content without opcode and length."""

    opcode: int
    offset: int
    content: bytes


@dataclass
class Scan:
    """Iterates the records of one file; raises LogError where a checksum fails.

    tolerant : go on after a checksum that fails
    damage : after the iteration, what is wrong with the file: where it ends early, or, tolerant,
        what does not fit; empty if it is whole
    """

    path: Path
    tolerant: bool = False
    damage: str = ''

    def __iter__(self) -> Iterator[Record]:
        try:
            with open(self.path, 'rb') as stream:
                yield from self._records(stream)
        except OSError as error:
            raise LogError(
                Kind.NOT_FOUND, self.path, f'cannot be read: {error.strerror or error}'
            ) from None

    def _records(self, stream: BinaryIO) -> Iterator[Record]:
        magic = stream.read(len(MAGIC))
        if magic != MAGIC:
            said = f'begins with {magic.hex(" ")}' if magic else 'is empty'
            raise LogError(Kind.NOT_MCAP, self.path, f'is not an MCAP file: it {said}')
        size = stream.seek(0, 2)
        offset, crc = stream.seek(len(MAGIC)), zlib.crc32(magic)
        while offset + _RECORD.size <= size:
            head = stream.read(_RECORD.size)
            opcode, length = _RECORD.unpack(head)
            if opcode not in _OPCODES or offset + _RECORD.size + length > size:
                break
            content = stream.read(length)
            if opcode == Opcode.DATA_END:
                self._check(content, crc, 'data section', offset)
                crc = 0
            elif opcode == Opcode.FOOTER:
                self._check(
                    content, zlib.crc32(content[:-4], zlib.crc32(head, crc)), 'summary', offset
                )
                if stream.read(len(MAGIC)) != MAGIC:
                    self.damage = 'the last 8 bytes lack'
                return
            else:
                crc = zlib.crc32(content, zlib.crc32(head, crc))
            yield Record(opcode, offset, content)
            offset += _RECORD.size + length
        self.damage = f'no whole record at byte {offset} of {size}'

    def _check(self, content: bytes, actual: int, part: str, offset: int) -> None:
        """Compare a checksum with the last 4 bytes of a record; 0 means that there is none."""
        stored = int.from_bytes(content[-4:], 'little')
        if len(content) >= 4 and stored in (0, actual):
            return
        self.damage = f'the checksum of its {part} does not fit'
        if not self.tolerant:
            raise LogError(
                Kind.CORRUPT,
                self.path,
                f'is corrupt: the checksum of its {part}, '
                f'which ends at byte {offset}, does not fit',
            )


def parse(path: Path, record: Record, reader: Callable[[ReadDataStream], _Parsed]) -> _Parsed:
    """Return a record as one of the classes of `mcap.records`; raises LogError."""
    try:
        return reader(ReadDataStream(BytesIO(record.content)))
    except (McapError, struct.error, UnicodeDecodeError):
        raise corrupt(path, record, 'its fields do not fit its length') from None


def corrupt(path: Path, record: Record, why: str) -> LogError:
    """Return the LogError of a damaged record."""
    try:
        name = Opcode(record.opcode).name.lower().replace('_', ' ')
    except ValueError:
        name = f'record {record.opcode}'
    return LogError(Kind.CORRUPT, path, f'is corrupt: the {name} at byte {record.offset}: {why}')


def chunk_records(path: Path, chunk: Record) -> bytes:
    """Return the records inside a chunk, decompressed and checked; raises LogError."""
    content = chunk.content
    try:
        _, _, size, crc, name_length = _CHUNK.unpack_from(content)
        start = _CHUNK.size + name_length + 8
        compression = bytes(content[_CHUNK.size : start - 8])
    except struct.error:
        raise corrupt(path, chunk, 'its fields do not fit its length') from None
    data = content[start:]
    if size > MAX_CHUNK_BYTES or len(data) != int.from_bytes(content[start - 8 : start], 'little'):
        raise corrupt(path, chunk, 'its lengths do not fit')
    try:
        records = _decompress(compression, data, size)
    except (zstandard.ZstdError, RuntimeError, ValueError) as error:
        raise corrupt(path, chunk, f'it cannot be decompressed ({error})') from None
    if len(records) != size or (crc and zlib.crc32(records) != crc):
        raise corrupt(path, chunk, 'its checksum does not fit')
    return records


def _decompress(compression: bytes, data: bytes, size: int) -> bytes:
    if compression == b'zstd':
        if zstandard.frame_content_size(data) not in (size, -1):  # a damaged size may be terabytes
            raise ValueError('its sizes disagree')
        return _own.decompressor.decompress(data, max_output_size=size)
    if compression == b'lz4':
        import lz4.frame  # type: ignore[import-untyped]  # comes with mcap

        return bytes(lz4.frame.decompress(data))
    if compression == b'':
        return data
    raise ValueError(f'unknown compression {compression!r}')


def inner_records(path: Path, chunk: Record, records: bytes) -> Iterator[Record]:
    """Yield the records inside a chunk; offsets are those in the decompressed data."""
    offset, size = 0, len(records)
    while offset < size:
        if offset + _RECORD.size > size:
            raise corrupt(path, chunk, 'its last record is cut short')
        opcode, length = _RECORD.unpack_from(records, offset)
        end = offset + _RECORD.size + length
        if end > size:
            raise corrupt(path, chunk, 'its last record is cut short')
        yield Record(opcode, offset, records[offset + _RECORD.size : end])
        offset = end
