# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One growing MCAP file that a crash leaves readable: whole chunks reach the system or nothing."""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import IO, Any, cast

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import MessageIndex
from mcap.writer import CompressionType, Writer

from rpo_mcap.errors import Fault, LogError, exists
from rpo_mcap.format import rosbag2
from rpo_mcap.format.run import LOG_FORMAT, RUN_RECORD, TimeBase
from rpo_mcap.topics import Topic

PROFILE = 'ros2'
LIBRARY = f'rpo_log/{LOG_FORMAT}'
"""Library field of the header; the same on every machine."""

_UNLIMITED = 1 << 62


class _Sink:
    """Output stream of the MCAP writer: gathers bytes, hands them to the system in `flush`.

    A write that fails half way (a full disk) is cut off again: the file ends with a whole chunk.
    """

    def __init__(self, path: Path) -> None:
        self._file = open(path, 'xb', buffering=0)  # noqa: SIM115, lives as long as the log
        self._parts: list[bytes] = []
        self._waiting = 0
        self.committed = 0

    def write(self, data: bytes) -> int:
        self._parts.append(bytes(data))
        self._waiting += len(data)
        return len(data)

    def tell(self) -> int:
        return self.committed + self._waiting

    def fileno(self) -> int:
        return self._file.fileno()

    def flush(self) -> None:
        view = memoryview(b''.join(self._parts))
        try:
            if os.fstat(self.fileno()).st_nlink == 0:
                raise FileNotFoundError('the file was deleted')
            at = 0
            while at < len(view):
                at += os.write(self.fileno(), view[at:])
        except OSError:
            self.discard()
            raise
        self._parts.clear()
        self._waiting = 0
        self.committed += len(view)

    def discard(self) -> None:
        """Drop what the system has not got whole."""
        self._parts.clear()
        self._waiting = 0
        os.ftruncate(self.fileno(), self.committed)

    def close(self) -> None:
        self._file.close()


class _Index(MessageIndex):
    """Where the messages of a channel lie in a chunk."""

    def write(self, stream: RecordBuilder) -> None:
        pairs = [number for record in self.records for number in record]
        length = 8 * len(pairs)
        head = struct.pack('<BQHI', Opcode.MESSAGE_INDEX, 6 + length, self.channel_id, length)
        stream.write(head + struct.pack(f'<{len(pairs)}Q', *pairs))


_MESSAGE = struct.Struct('<BQHIQQ')
"""Of a message: opcode, length of the rest, channel, sequence, log time, publish time."""


class _Writer(Writer):
    """The library's writer packs each number by itself; this one writes the same bytes at once."""

    def __init__(self, output: IO[Any], **options: Any) -> None:
        super().__init__(output, **options)
        own = vars(self)
        self._counted, self._chunk = own['_Writer__statistics'], own['_Writer__chunk_builder']

    def add_messages(
        self, stamp_ns: int, sequence: int, messages: Sequence[tuple[int, bytes]]
    ) -> None:
        counted, chunk = self._counted, self._chunk
        for times, count in ((counted, counted.message_count), (chunk, chunk.num_messages)):
            if not count or stamp_ns < times.message_start_time:
                times.message_start_time = stamp_ns
            if stamp_ns > times.message_end_time:
                times.message_end_time = stamp_ns
        counted.message_count += len(messages)
        chunk.num_messages += len(messages)
        at, parts = chunk.count, list[bytes]()
        for channel_id, data in messages:
            counted.channel_message_counts[channel_id] += 1
            if channel_id not in chunk.message_indices:
                chunk.message_indices[channel_id] = _Index(channel_id, [])
            chunk.message_indices[channel_id].records.append((stamp_ns, at))
            size = _MESSAGE.size + len(data)
            rest = channel_id, sequence, stamp_ns, stamp_ns
            parts += (_MESSAGE.pack(Opcode.MESSAGE, size - 9, *rest), data)
            at += size
        chunk.record_writer.write(b''.join(parts))


class McapFile:
    """One MCAP file with the profile ros2, zstd chunks, all indexes, statistics and checksums.

    Every method that writes may raise OSError; the file then ends with the last whole chunk.
    Nothing in it depends on the wall clock or the machine. The compression level is zstd's own, 3.

    summary_offsets : whether the summary says where its groups are. The library lists empty groups
        too, an error to `mcap doctor`: so not for a file without attachments or messages
    """

    def __init__(
        self,
        path: Path,
        profile: str = PROFILE,
        library: str = LIBRARY,
        *,
        summary_offsets: bool = True,
    ) -> None:
        try:
            self._sink = _Sink(path)
        except FileExistsError:
            raise exists(path) from None
        except OSError as error:
            raise LogError(
                Fault.CANNOT_WRITE, path, f'cannot be created: {error.strerror}'
            ) from None
        self.path = path
        self._writer = _Writer(
            cast(IO[Any], self._sink),
            chunk_size=_UNLIMITED,
            compression=CompressionType.ZSTD,
            use_summary_offsets=summary_offsets,
            enable_data_crcs=True,
        )
        self._writer.start(profile=profile, library=library)
        self._syncer = ThreadPoolExecutor(max_workers=1, thread_name_prefix='fsync')
        self._syncing: Future[None] | None = None
        self._schemas: dict[str, int] = {}

    @property
    def size(self) -> int:
        """Bytes that have reached the system."""
        return self._sink.committed

    def add_topic(self, topic: rosbag2.BagTopic) -> int:
        """Return the id of a new channel for a topic of an installed type; raises LogError."""
        if topic.type not in self._schemas:
            text = rosbag2.definition(topic.type).text
            self._schemas[topic.type] = self.add_schema(topic.type, text.encode())
        return self.add_channel(topic.name, self._schemas[topic.type], topic.channel_metadata)

    def add_schema(self, name: str, text: bytes, encoding: str = 'ros2msg') -> int:
        """Return the id of a new schema."""
        return self._writer.register_schema(name, encoding, text)

    def add_channel(
        self, topic: str, schema_id: int, metadata: Mapping[str, str], encoding: str = 'cdr'
    ) -> int:
        """Return the id of a new channel."""
        return self._writer.register_channel(topic, encoding, schema_id, dict(metadata))

    def add_messages(
        self, stamp_ns: int, sequence: int, messages: Sequence[tuple[int, bytes]]
    ) -> None:
        """Add messages, each with its channel, to the open chunk.

        Their log and publish times are their stamp.
        """
        self._writer.add_messages(stamp_ns, sequence, messages)

    def add_attachment(self, name: str, media_type: str, data: bytes, time_ns: int) -> None:
        """Write an attachment; both its times are `time_ns`."""
        self._writer.add_attachment(time_ns, time_ns, name, media_type, data)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        self._writer.add_metadata(name, dict(values))

    def close_chunk(self) -> None:
        """End the open chunk, if it has messages, and hand all bytes to the system."""
        self._writer.flush()

    def sync(self) -> None:
        """Ask for the bytes to reach the disk, without waiting; raises what the last call met."""
        if self._syncing is not None:
            if not self._syncing.done():
                return
            self._syncing.result()
        self._syncing = self._syncer.submit(os.fsync, self._sink.fileno())

    def finish(self) -> None:
        """End the file with its summary and wait until it is on the disk."""
        self._writer.finish()
        self._sink.flush()
        os.fsync(self._sink.fileno())

    def close(self) -> None:
        """Release the file, finished or not."""
        self._syncer.shutdown(wait=True)
        self._sink.close()


CHUNK_SHARE = 25
"""A chunk holds at most this share of the ticks before it."""

MEDIA_TYPE = 'application/yaml'


def bag_topics(recorded: Sequence[Topic], counts: Sequence[int]) -> list[rosbag2.BagTopic]:
    """Return the topics of a log as rosbag2 describes them."""
    return [
        rosbag2.BagTopic.of(
            topic.name, topic.type, topic.row.qos, count, topic.signal if topic.remapped else ''
        )
        for topic, count in zip(recorded, counts, strict=True)
    ]


class BagFileWriter:
    """Writes ticks, in order, to one MCAP file; may raise OSError, see `McapFile`.

    ticks_before : ticks of this run in the files before
    """

    def __init__(
        self,
        path: Path,
        base: TimeBase,
        recorded: Sequence[Topic],
        attachments: Mapping[str, bytes],
        ticks_before: int,
    ) -> None:
        self._file = McapFile(path)
        self.base = base
        self.topics = recorded
        self.ticks = ticks_before
        self.counts = [0] * len(recorded)
        self._chunk_counts = [0] * len(recorded)
        self._chunk_ticks = 0
        self.newest_tick = -1
        self._first_ns = self._last_ns = self._newest_ns = 0
        self._events = {index for index, topic in enumerate(recorded) if topic.is_event}
        self._file.add_metadata(rosbag2.RECORD, self._rosbag2_record())
        self._file.add_metadata(RUN_RECORD, base.to_record())
        for name, data in attachments.items():
            self._file.add_attachment(name, MEDIA_TYPE, data, base.epoch_ns)
        self._channels = [self._file.add_topic(t) for t in bag_topics(recorded, self.counts)]
        self._file.close_chunk()

    @property
    def size(self) -> int:
        """Bytes that have reached the system."""
        return self._file.size

    @property
    def entry(self) -> rosbag2.BagFile:
        """What rosbag2 says of this file now."""
        return rosbag2.BagFile(
            self._file.path.name, self._first_ns, self._last_ns, sum(self.counts)
        )

    def add_tick(self, tick: int, messages: Sequence[tuple[int, bytes]]) -> None:
        """Add the messages of one tick, each with the index of its topic; events come last."""
        regular = [pair for pair in messages if pair[0] not in self._events]
        if regular:
            self._add(tick, regular)
            self.ticks += 1
            self._chunk_ticks += 1
        if len(regular) < len(messages):
            self._close_chunk()  # events: a chunk of their own, the same bytes whenever they came
            self._add(tick, messages[len(regular) :])
            self._close_chunk()
        elif self._chunk_ticks >= min(self.ticks // CHUNK_SHARE, self.base.chunk_ticks):
            self._close_chunk()

    def attach(self, name: str, data: bytes) -> None:
        """Write an attachment between two chunks."""
        self._file.add_attachment(name, MEDIA_TYPE, data, self.base.epoch_ns)
        self._file.close_chunk()
        self._count_chunk()

    def sync(self) -> None:
        """Ask for the bytes to reach the disk, without waiting."""
        self._file.sync()

    def finish(self) -> None:
        """End the file: rosbag2's record again, summary, statistics, indexes."""
        self._close_chunk()
        self._file.add_metadata(rosbag2.RECORD, self._rosbag2_record())
        self._file.finish()

    def close(self) -> None:
        """Release the file, finished or not."""
        self._file.close()

    def _add(self, tick: int, messages: Sequence[tuple[int, bytes]]) -> None:
        stamp, channels = self.base.stamp_ns(tick), self._channels
        self._file.add_messages(stamp, tick, [(channels[index], data) for index, data in messages])
        for index, _ in messages:
            self._chunk_counts[index] += 1
        self._newest_ns = stamp
        if self.newest_tick < 0:
            self._first_ns = stamp
        self.newest_tick = tick

    def _close_chunk(self) -> None:
        """End the open chunk; its messages count once the system has them."""
        if not any(self._chunk_counts):
            return
        self._file.close_chunk()
        self._count_chunk()

    def _count_chunk(self) -> None:
        """Count the messages of a chunk that was closed."""
        self.counts = [sum(pair) for pair in zip(self.counts, self._chunk_counts, strict=True)]
        self._chunk_counts = [0] * len(self.topics)
        self._chunk_ticks = 0
        self._last_ns = self._newest_ns

    def _rosbag2_record(self) -> dict[str, str]:
        return rosbag2.record_values(bag_topics(self.topics, self.counts), self.entry)
