# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One growing MCAP file that a crash leaves readable: whole chunks reach the system or nothing."""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, cast

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import MessageIndex
from mcap.writer import CompressionType, Writer

from rpo_mcap.errors import LogError, exists
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


class McapFile(Writer):
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
            raise LogError(path, f'cannot be created: {error.strerror}') from None
        super().__init__(
            cast(IO[Any], self._sink),
            chunk_size=_UNLIMITED,
            compression=CompressionType.ZSTD,
            use_summary_offsets=summary_offsets,
            enable_data_crcs=True,
        )
        self.path = path
        own = vars(self)
        self._counted, self._chunk = own['_Writer__statistics'], own['_Writer__chunk_builder']
        self._syncer = ThreadPoolExecutor(max_workers=1, thread_name_prefix='fsync')
        self._syncing: Future[None] | None = None
        self.start(profile=profile, library=library)

    @property
    def size(self) -> int:
        """Bytes that have reached the system."""
        return self._sink.committed

    def add_messages(
        self, stamp_ns: int, sequence: int, messages: Sequence[tuple[int, bytes]]
    ) -> None:
        """Add messages, each with its channel, to the open chunk, all numbers packed at once.

        Their log and publish times are their stamp. The bytes are those of the library.
        """
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

    def sync(self) -> None:
        """Ask for the bytes to reach the disk, without waiting; raises what the last call met."""
        if self._syncing is not None:
            if not self._syncing.done():
                return
            self._syncing.result()
        self._syncing = self._syncer.submit(os.fsync, self._sink.fileno())

    def finish(self) -> None:
        """End the file with its summary and wait until it is on the disk."""
        super().finish()
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


class BagFileWriter(McapFile):
    """Writes messages of some topics, with rosbag2's record at the begin and at the end.

    topics : as rosbag2 describes them
    base : the ticks, in the log of a run
    attachments : name to bytes, of a log
    counts : per topic, messages of the chunks that were closed: the system has them
    """

    def __init__(
        self,
        path: Path,
        topics: Sequence[rosbag2.BagTopic],
        base: TimeBase | None = None,
        attachments: Mapping[str, bytes] | None = None,
    ) -> None:
        super().__init__(path, summary_offsets=base is not None)
        self.topics = topics
        self.counts = [0] * len(topics)
        self._chunk_counts = [0] * len(topics)
        self._first_ns: int | None = None
        self._last_ns = self._newest_ns = 0
        try:
            self._add_record()
            if base is not None:
                self.add_metadata(RUN_RECORD, base.to_record())
                for name, data in (attachments or {}).items():
                    self.add_attachment(base.epoch_ns, base.epoch_ns, name, MEDIA_TYPE, data)
            self._channels = self._declare()
            self.flush()
        except OSError:
            self.close()
            raise

    def _declare(self) -> list[int]:
        """Return the ids of the channels, one for each topic; one schema for each type."""
        schemas: dict[str, int] = {}
        channels = []
        for topic in self.topics:
            if topic.type not in schemas:
                text = rosbag2.definition(topic.type).text.encode()
                schemas[topic.type] = self.register_schema(topic.type, 'ros2msg', text)
            known = schemas[topic.type], topic.channel_metadata
            channels.append(self.register_channel(topic.name, 'cdr', *known))
        return channels

    @property
    def entry(self) -> rosbag2.BagFile:
        """What rosbag2 says of this file now."""
        stamps = self._first_ns or 0, self._last_ns
        return rosbag2.BagFile(self.path.name, *stamps, sum(self.counts))

    def add(self, stamp_ns: int, sequence: int, messages: Sequence[tuple[int, bytes]]) -> None:
        """Add messages, each with the index of its topic, to the open chunk."""
        channels = self._channels
        self.add_messages(stamp_ns, sequence, [(channels[index], data) for index, data in messages])
        for index, _ in messages:
            self._chunk_counts[index] += 1
        self._newest_ns = stamp_ns
        if self._first_ns is None:
            self._first_ns = stamp_ns

    def close_chunk(self) -> None:
        """End the open chunk and hand all bytes to the system; then its messages count."""
        self.flush()
        self.counts = [sum(pair) for pair in zip(self.counts, self._chunk_counts, strict=True)]
        self._chunk_counts = [0] * len(self.topics)
        self._last_ns = self._newest_ns

    def finish(self) -> None:
        """End the file: rosbag2's record again, summary, statistics, indexes."""
        self.close_chunk()
        self._add_record()
        super().finish()

    def _add_record(self) -> None:
        topics = [
            replace(topic, messages=count)
            for topic, count in zip(self.topics, self.counts, strict=True)
        ]
        self.add_metadata(rosbag2.RECORD, rosbag2.record_values(topics, self.entry))


class RunFileWriter(BagFileWriter):
    """Writes ticks, in order, to one file of a run's log.

    ticks : of this run in this file and the files before
    """

    def __init__(
        self,
        path: Path,
        base: TimeBase,
        recorded: Sequence[Topic],
        attachments: Mapping[str, bytes],
        ticks_before: int,
    ) -> None:
        super().__init__(path, bag_topics(recorded, [0] * len(recorded)), base, attachments)
        self.base = base
        self.ticks = ticks_before
        self._chunk_ticks = 0
        self.newest_tick = -1
        self._events = {index for index, topic in enumerate(recorded) if topic.is_event}

    def add_tick(self, tick: int, messages: Sequence[tuple[int, bytes]]) -> None:
        """Add the messages of one tick, each with the index of its topic; events come last."""
        stamp_ns = self.base.stamp_ns(tick)
        regular = [pair for pair in messages if pair[0] not in self._events]
        if regular:
            self.add(stamp_ns, tick, regular)
            self.ticks += 1
            self._chunk_ticks += 1
        self.newest_tick = tick
        if len(regular) < len(messages):
            self.close_chunk()  # events: a chunk of their own, the same bytes whenever they came
            self.add(stamp_ns, tick, messages[len(regular) :])
            self.close_chunk()
        elif self._chunk_ticks >= min(self.ticks // CHUNK_SHARE, self.base.chunk_ticks):
            self.close_chunk()

    def close_chunk(self) -> None:
        """End the open chunk."""
        super().close_chunk()
        self._chunk_ticks = 0

    def attach(self, name: str, data: bytes) -> None:
        """Write an attachment between two chunks."""
        self.add_attachment(self.base.epoch_ns, self.base.epoch_ns, name, MEDIA_TYPE, data)
        self.close_chunk()
