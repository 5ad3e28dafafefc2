# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""MCAP files taken apart and put together again, all checksums right; what other readers show."""

from __future__ import annotations

import io
import itertools
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.rosbag2.enums import CompressionFormat
from rosbags.typesys import Stores, get_typestore

from rpo_core.wire import cdr, interfaces
from rpo_log.read.records import MAGIC, RECORD_HEAD

STORE = get_typestore(Stores.ROS2_JAZZY)
WALL_NS = 1_790_000_000_000_000_000


@dataclass
class Parts:
    """An MCAP file taken apart: its records, and where each chunk of messages ends."""

    records: list[McapRecord | None]
    compression: CompressionType = CompressionType.ZSTD

    @classmethod
    def of(cls, path: Path) -> Parts:
        """Take a file apart; None stands for the end of a chunk."""
        found: list[McapRecord | None] = []
        with path.open('rb') as stream:
            for record in StreamReader(stream, emit_chunks=True).records:
                if isinstance(record, Chunk):
                    found += [*breakup_chunk(record), None]
                elif isinstance(record, Header | Metadata | Attachment):
                    found.append(record)
        return cls(found)

    def write(self, path: Path, **options: Any) -> None:
        """Put the file together again, all checksums and indexes right; options of the writer."""
        ours = {'chunk_size': 1 << 40, 'compression': self.compression, 'enable_data_crcs': True}
        with path.open('wb') as stream:
            writer = Writer(stream, **(options or ours))
            head = next((r for r in self.records if isinstance(r, Header)), Header('', ''))
            writer.start(profile=head.profile, library=head.library)
            schemas: dict[int, int] = {}
            channels: dict[int, int] = {}
            for record in self.records:
                _add(writer, record, schemas, channels)
            writer.finish()


def _add(
    writer: Writer,
    record: McapRecord | None,
    schemas: dict[int, int],
    channels: dict[int, int],
) -> None:
    if record is None:
        writer.flush()
    elif isinstance(record, Metadata):
        writer.add_metadata(record.name, record.metadata)
    elif isinstance(record, Attachment):
        writer.add_attachment(
            record.create_time, record.log_time, record.name, record.media_type, record.data
        )
    elif isinstance(record, Schema):
        if record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
    elif isinstance(record, Channel):
        channels[record.id] = writer.register_channel(
            record.topic, record.message_encoding, schemas.get(record.schema_id, 0), record.metadata
        )
    elif isinstance(record, Message):
        channel = channels.get(record.channel_id, 0)
        times = record.publish_time, record.sequence
        writer.add_message(channel, record.log_time, record.data, *times)


OFFSET = struct.Struct('<BQQ')
ELSEWHERE = 1 << 60
"""Added to the begin of a group: it stays as it is, and does not follow its group."""

Shown = list[tuple[Any, ...]]


def views(path: Path) -> dict[str, Shown | str]:
    """Return what each reader shows of a file: messages, files and metadata; or why it does not."""
    content = path.read_bytes()
    found: dict[str, Shown | str] = {}
    for name, show in _READERS.items():
        try:
            found[name] = sorted(show(content, path), key=repr)
        except Exception as error:  # of a library that reads what anybody may have written
            found[name] = f'{type(error).__name__}: {error}'
    return found


def _messages(reader: Any, **options: Any) -> Iterator[tuple[Any, ...]]:
    for schema, channel, message in reader.iter_messages(**options):
        times = message.log_time, message.publish_time, message.sequence
        yield (
            channel.topic,
            schema.name,
            schema.data,
            channel.message_encoding,
            *times,
            message.data,
        )


def _beside(reader: Callable[[], Any]) -> Iterator[tuple[Any, ...]]:
    for record in reader().iter_attachments():
        yield record.name, record.media_type, record.data
    for record in reader().iter_metadata():
        yield record.name, record.metadata


def _rosbags(content: bytes, path: Path) -> Iterator[tuple[Any, ...]]:
    with AnyReader([path]) as reader:
        for connection, stamp, data in reader.messages():
            yield connection.topic, connection.msgtype, stamp, bytes(data)
        yield 'messages', reader.message_count


_READERS: dict[str, Callable[[bytes, Path], Iterator[tuple[Any, ...]]]] = {
    'seeking': lambda content, _: _messages(SeekingReader(io.BytesIO(content))),
    'seeking, last first': lambda content, _: _messages(
        SeekingReader(io.BytesIO(content)), reverse=True
    ),
    'streaming': lambda content, _: _messages(
        NonSeekingReader(io.BytesIO(content)), log_time_order=False
    ),
    'beside, seeking': lambda content, _: _beside(lambda: SeekingReader(io.BytesIO(content))),
    'beside, streaming': lambda content, _: _beside(lambda: NonSeekingReader(io.BytesIO(content))),
    'rosbags': _rosbags,
}


class Raw:
    """The records of a file, each as opcode and content, to be changed and put together again.

    data : up to the end of the data, without it
    summary : behind it, without the footer
    end : content of the record that ends the data
    tail : what follows the fields of the footer
    """

    def __init__(self, content: bytes) -> None:
        found, at = [], len(MAGIC)
        while at < len(content) - len(MAGIC):
            opcode, length = RECORD_HEAD.unpack_from(content, at)
            at += RECORD_HEAD.size + length
            found.append((opcode, content[at - length : at]))
        place = [opcode for opcode, _ in found].index(Opcode.DATA_END)
        self.data, self.summary = found[:place], found[place + 1 : -1]
        self.end, self.tail = bytes(4), b''

    def _size(self) -> int:
        return len(MAGIC) + sum(RECORD_HEAD.size + len(content) for _, content in self.data)

    @property
    def free(self) -> int:
        """Where the content of a record begins that is added to the data."""
        return self._size() + RECORD_HEAD.size

    def records(self, kind: type[McapRecord]) -> Iterator[tuple[int, Any]]:
        """Yield the records of one kind in the summary, and their places."""
        for at, (opcode, content) in enumerate(self.summary):
            record = parsed(opcode, content)
            if isinstance(record, kind):
                yield at, record

    def change(self, kind: type[McapRecord], change: Callable[[Any], Any]) -> None:
        """Replace the records of one kind in the summary by those that `change` returns."""
        changed = {at: change(record) for at, record in self.records(kind)}
        self.summary = [
            record if at not in changed else packed(changed[at])
            for at, record in enumerate(self.summary)
            if at not in changed or changed[at] is not None
        ]

    def bytes(self, summary_start: int | None = None) -> bytes:
        """Put it together, with checksums that fit; what leads to the summary follows it.

        summary_start : that the footer says
        """
        data = MAGIC + b''.join(map(joined, self.data))
        if len(self.end) == 4:
            self.end = struct.pack('<I', zlib.crc32(data))
        data += joined((Opcode.DATA_END, self.end))
        start = len(data) if summary_start is None else summary_start
        groups, offsets, summary = {}, list[bytes](), b''
        for opcode, content in self.summary:
            if opcode == Opcode.SUMMARY_OFFSET:
                offsets.append(content)
                continue
            at, size = groups.get(opcode, (len(data) + len(summary), 0))
            groups[opcode] = at, size + RECORD_HEAD.size + len(content)
            summary += joined((opcode, content))
        offsets_start = len(data) + len(summary) if offsets else 0
        for content in offsets:
            if len(content) != OFFSET.size:
                summary += joined((Opcode.SUMMARY_OFFSET, content))
                continue
            opcode, *said = OFFSET.unpack(content)
            stays = said[0] >= ELSEWHERE
            place = (said[0] - ELSEWHERE, said[1]) if stays else groups.get(opcode, said)
            summary += joined((Opcode.SUMMARY_OFFSET, OFFSET.pack(opcode, *place)))
        fields = struct.pack('<QQ', start, offsets_start)
        head = RECORD_HEAD.pack(Opcode.FOOTER, len(fields) + 4 + len(self.tail))
        crc = zlib.crc32(summary + head + fields)
        footer = head + fields + struct.pack('<I', crc) + self.tail
        return data + summary + footer + MAGIC


def joined(record: tuple[int, bytes]) -> bytes:
    """Return the bytes of a record."""
    return RECORD_HEAD.pack(record[0], len(record[1])) + record[1]


def packed(record: McapRecord) -> tuple[int, bytes]:
    """Return a record as opcode and content."""
    builder = RecordBuilder()
    record.write(builder)
    data = builder.end()
    return data[0], data[RECORD_HEAD.size :]


def parsed(opcode: int, content: bytes) -> McapRecord | None:
    """Return a record by its content."""
    data = joined((opcode, content))
    return next(
        iter(StreamReader(io.BytesIO(data), skip_magic=True, emit_chunks=True).records), None
    )


def write_bag(
    folder: Path,
    messages: Any,
    space: str = '',
    plugin: StoragePlugin = StoragePlugin.MCAP,
    pressed: Any = None,
) -> Path:
    """Write messages in the order in which they came, with wall-clock times, by rosbags."""
    with_others = itertools.chain(messages, [('/rosout', 0, cdr.encode_clock(0))])
    bag = BagWriter(folder, version=9, storage_plugin=plugin)
    if pressed:
        bag.set_compression(pressed, CompressionFormat.ZSTD)
    with bag:
        known: dict[str, Any] = {}
        for number, (name, _, data) in enumerate(with_others):
            row = interfaces.find(name if name != '/truth/pose' else interfaces.RELATIVE_STATE)
            kind = row.type if row else 'rosgraph_msgs/msg/Clock'
            full = name if name == '/clock' else space + name
            if name not in known:
                known[name] = bag.add_connection(full, kind, typestore=STORE)
            bag.write(known[name], WALL_NS + number, data)
    return folder
