# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One file of a run's log: its records in the order every file has, its chunks cut by ticks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from rpo_log.format import rosbag2
from rpo_log.format.run import RUN_RECORD, TimeBase
from rpo_log.topics import Topic
from rpo_log.write.mcap_file import McapFile

CHUNK_SHARE = 25
"""A chunk holds at most this share of the ticks before it."""

MEDIA_TYPE = 'application/yaml'


def bag_topics(recorded: Sequence[Topic], counts: Sequence[int]) -> list[rosbag2.BagTopic]:
    """Return the topics of a log as rosbag2 describes them."""
    return [
        rosbag2.BagTopic.of(topic.name, topic.type, topic.row.qos, count)
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
        for index, data in regular:
            self._add(index, tick, data)
        if regular:
            self.ticks += 1
            self._chunk_ticks += 1
        if len(regular) < len(messages):
            self._close_chunk()  # events: a chunk of their own, the same bytes whenever they came
            for index, data in messages[len(regular) :]:
                self._add(index, tick, data)
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

    def _add(self, index: int, tick: int, data: bytes) -> None:
        stamp = self.base.stamp_ns(tick)
        self._file.add_message(self._channels[index], stamp, tick, data)
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
