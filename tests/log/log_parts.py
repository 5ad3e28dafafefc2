# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""MCAP files taken apart and put together again, all checksums and indexes right."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, Writer


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
