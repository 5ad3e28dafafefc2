# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Growing MCAP files that a crash leaves readable: whole chunks reach the system or nothing."""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from io import BytesIO
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import MessageIndex
from mcap.writer import CompressionType, Writer

from rpo_log.errors import LogError, exists
from rpo_log.format import rosbag2
from rpo_log.format.rosbag2 import BagFile
from rpo_log.format.run import LOG_FORMAT, RUN_RECORD, TimeBase
from rpo_log.topics import Topic

PROFILE = 'ros2'
LIBRARY = f'rpo_log/{LOG_FORMAT}'
"""Library field of the header; the same on every machine."""

CHUNK_SHARE = 25
"""A chunk holds at most this share of the ticks before it."""

MEDIA_TYPE = 'application/yaml'

_UNLIMITED = 1 << 62
_MESSAGE = struct.Struct('<BQHIQQ')
"""Of a message: opcode, length of the rest, channel, sequence, log time, publish time."""


class _Sink(BytesIO):
    """Output stream of the MCAP writer: gathers bytes, hands them to the system in `flush`.

    A write that fails half way (a full disk) is cut off again: the file ends with a whole chunk.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.file = open(path, 'xb', buffering=0)  # noqa: SIM115, lives as long as the log
        self.committed = 0

    def tell(self) -> int:
        return self.committed + super().tell()

    def flush(self) -> None:
        view, at = memoryview(self.getvalue()), 0
        self.seek(0)
        self.truncate()
        try:
            if os.fstat(self.file.fileno()).st_nlink == 0:
                raise FileNotFoundError('the file was deleted')
            while at < len(view):
                at += self.file.write(view[at:])
        except OSError:
            self.file.truncate(self.committed)
            raise
        self.committed += at


class _Index(MessageIndex):
    """Where the messages of a channel lie in a chunk; the library packs one number at a time."""

    def write(self, stream: RecordBuilder) -> None:
        pairs = [number for record in self.records for number in record]
        length = 8 * len(pairs)
        head = struct.pack('<BQHI', Opcode.MESSAGE_INDEX, 6 + length, self.channel_id, length)
        stream.write(head + struct.pack(f'<{len(pairs)}Q', *pairs))


class BagFileWriter(Writer):
    """Writes messages of some topics, with rosbag2's record at the begin and at the end.

    The file has the profile ros2, zstd chunks, all indexes, statistics and checksums. Nothing in
    it depends on the wall clock or the machine; the compression level is zstd's own, 3. Every
    method that writes may raise OSError; the file then ends with the last whole chunk.

    base : the ticks of the run
    attachments : name to bytes
    ticks : of the run in this file and the files before
    entry : what rosbag2 says of the file; of messages, those of chunks that the system has
    """

    def __init__(
        self,
        path: Path,
        topics: Sequence[Topic],
        base: TimeBase,
        attachments: Mapping[str, bytes],
        ticks: int = 0,
    ) -> None:
        try:
            self._sink = _Sink(path)
        except FileExistsError:
            raise exists(path) from None
        except OSError as error:
            raise LogError(path, f'cannot be created: {error.strerror}') from None
        super().__init__(
            self._sink,
            chunk_size=_UNLIMITED,
            compression=CompressionType.ZSTD,
            enable_data_crcs=True,
        )
        self.topics = topics
        self.base = base
        self.ticks, self._chunk_ticks, self.newest_tick = ticks, 0, -1
        self._events = {index for index, topic in enumerate(topics) if topic.is_event}
        self.entry = BagFile(path.name, [0] * len(topics))
        parts = vars(self)
        self._counted, self._chunk = parts['_Writer__statistics'], parts['_Writer__chunk_builder']
        self._syncer = ThreadPoolExecutor(max_workers=1, thread_name_prefix='fsync')
        self._syncing: Future[None] | None = None
        try:
            self.start(PROFILE, LIBRARY)
            self._add_record()
            self.add_metadata(RUN_RECORD, base.to_record())
            for name, data in attachments.items():
                self.attach(name, data)
            self._declare()
            self.flush()
        except OSError:
            self.close()
            raise

    def _declare(self) -> None:
        """Declare a channel for each topic, numbered from 1, and one schema for each type."""
        schemas: dict[str, int] = {}
        for topic in self.topics:
            if topic.type not in schemas:
                text = rosbag2.definition(topic.type).text.encode()
                schemas[topic.type] = self.register_schema(topic.type, 'ros2msg', text)
            metadata = rosbag2.channel_metadata(topic)
            self.register_channel(topic.name, 'cdr', schemas[topic.type], metadata)

    @property
    def size(self) -> int:
        """Bytes that have reached the system."""
        return self._sink.committed

    def add(self, stamp_ns: int, sequence: int, messages: Sequence[tuple[int, bytes]]) -> None:
        """Add messages, each with the index of its topic, to the open chunk, all packed at once.

        Their log and publish times are their stamp. The bytes are those of the library, which
        takes three times as long.
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
        for index, data in messages:
            channel_id = index + 1
            counted.channel_message_counts[channel_id] += 1
            if channel_id not in chunk.message_indices:
                chunk.message_indices[channel_id] = _Index(channel_id, [])
            chunk.message_indices[channel_id].records.append((stamp_ns, at))
            size = _MESSAGE.size + len(data)
            rest = channel_id, sequence, stamp_ns, stamp_ns
            parts += (_MESSAGE.pack(Opcode.MESSAGE, size - 9, *rest), data)
            at += size
        chunk.record_writer.write(b''.join(parts))

    def add_tick(self, tick: int, messages: Sequence[tuple[int, bytes]]) -> None:
        """Add the messages of one tick, in order, each with the index of its topic; events last."""
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

    def attach(self, name: str, data: bytes) -> None:
        """Write an attachment between two chunks."""
        self.add_attachment(self.base.epoch_ns, self.base.epoch_ns, name, MEDIA_TYPE, data)
        self.close_chunk()

    def close_chunk(self) -> None:
        """End the open chunk and hand all bytes to the system; then its messages count."""
        self._chunk_ticks = 0
        self.flush()
        counted = self._counted
        counts = [counted.channel_message_counts.get(i + 1, 0) for i in range(len(self.topics))]
        ends = counted.message_start_time, counted.message_end_time
        self.entry = BagFile(self.entry.path, counts, *ends)

    def sync(self) -> None:
        """Ask for the bytes to reach the disk, without waiting; raises what the last call met."""
        if self._syncing is not None:
            if not self._syncing.done():
                return
            self._syncing.result()
        self._syncing = self._syncer.submit(os.fsync, self._sink.file.fileno())

    def finish(self) -> None:
        """End the file with rosbag2's record and its summary; wait until it is on the disk."""
        self.close_chunk()
        self._add_record()
        super().finish()
        self._sink.flush()
        os.fsync(self._sink.file.fileno())

    def close(self) -> None:
        """Release the file, finished or not."""
        self._syncer.shutdown(wait=True)
        self._sink.file.close()

    def _add_record(self) -> None:
        self.add_metadata(rosbag2.RECORD, rosbag2.record_values(self.topics, self.entry))
