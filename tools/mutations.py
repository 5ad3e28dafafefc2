# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Changes of a run folder: records of its files, bytes, whole files. All are drawn at random."""

from __future__ import annotations

import os
import random
import shutil
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Metadata, Schema
from mcap.writer import CompressionType, Writer

from rpo_log.format import sums
from rpo_log.format.run import SUMS_FILE
from rpo_log.read.records import FileRecords, RawMessage, message_at

_NUMBERS = (0.0, -0.0, 1e-300, 1e308, float('inf'), float('nan'), 1.0, -1.0)


@dataclass
class Parts:
    """An MCAP file taken apart: its records, and where each chunk of messages ends."""

    records: list[McapRecord | RawMessage | None]
    compression: CompressionType = CompressionType.ZSTD

    @classmethod
    def of(cls, path: Path) -> Parts:
        """Take a file apart; None stands for the end of a chunk."""
        found: list[McapRecord | RawMessage | None] = []
        records = FileRecords(path)
        for record in records:
            if isinstance(record, Chunk):
                data = records.content_of(record)
                inner = records.messages_in(data, found.append)
                found += [message_at(data, at) for at in inner]
                found.append(None)
            elif isinstance(record, Header | Metadata | Attachment):
                found.append(record)
        return cls(found)

    def write(self, path: Path) -> None:
        """Put the file together again, all checksums and indexes right."""
        with path.open('wb') as stream:
            writer = Writer(stream, chunk_size=1 << 40, compression=self.compression)
            head = next((r for r in self.records if isinstance(r, Header)), Header('', ''))
            writer.start(profile=head.profile, library=head.library)
            schemas: dict[int, int] = {}
            channels: dict[int, int] = {}
            for record in self.records:
                _put(writer, record, schemas, channels)
            writer.finish()


def _put(
    writer: Writer,
    record: McapRecord | RawMessage | None,
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
        schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
    elif isinstance(record, Channel):
        channels[record.id] = writer.register_channel(
            record.topic, record.message_encoding, schemas.get(record.schema_id, 0), record.metadata
        )
    elif isinstance(record, RawMessage):
        writer.add_message(
            channels.get(record.channel, 0), record.log_ns, record.data, record.publish_ns,
            record.sequence,
        )  # fmt: skip


Change = Callable[[random.Random, list[Any]], None]


def _drop(rng: random.Random, records: list[Any]) -> None:
    records.pop(rng.randrange(len(records)))


def _repeat(rng: random.Random, records: list[Any]) -> None:
    at = rng.randrange(len(records))
    records.insert(rng.choice((at, rng.randrange(len(records)))), records[at])


def _swap(rng: random.Random, records: list[Any]) -> None:
    a, b = rng.randrange(len(records)), rng.randrange(len(records))
    records[a], records[b] = records[b], records[a]


def _move_on(rng: random.Random, records: list[Any]) -> None:
    at = rng.randrange(len(records))
    records[at : at + 2] = records[at : at + 2][::-1]


def _edit(rng: random.Random, records: list[Any]) -> None:
    """Change one record; the rare ones as often as messages."""
    kinds = {type(record) for record in records if record is not None}
    kind = rng.choice(sorted(kinds, key=lambda kind: kind.__name__))
    at = rng.choice([i for i, record in enumerate(records) if type(record) is kind])
    records[at] = _edited(rng, records[at])


def _edited(rng: random.Random, record: Any) -> Any:
    if isinstance(record, RawMessage):
        return _edited_message(rng, record)
    fields = [name for name in vars(record) if name not in ('crc',)]
    name = rng.choice(fields)
    value = getattr(record, name)
    if isinstance(value, dict):
        value = dict(value)
        key = rng.choice(sorted(value)) if value else 'key'
        what = rng.randrange(3)
        if what == 0:
            value.pop(key, None)
        elif what == 1:
            value[key + 'x'] = '1'
        else:
            value[key] = _text(rng, value.get(key, ''))
    elif isinstance(value, bytes):
        value = _bytes(rng, value)
    elif isinstance(value, str):
        value = _text(rng, value)
    else:
        value = rng.choice((0, value + 1, max(0, value - 1), rng.randrange(8)))
    return replace(record, **{name: value})


def _edited_message(rng: random.Random, message: RawMessage) -> RawMessage:
    what = rng.randrange(8)
    if what == 0:
        return message._replace(channel=rng.randrange(9))
    if what == 1:
        return message._replace(sequence=rng.choice((0, message.sequence + 1, 1 << 31)))
    if what == 2:
        step = rng.choice((1, -1, 100_000_000))
        return message._replace(log_ns=max(0, message.log_ns + step))
    if what == 3:
        return message._replace(publish_ns=message.publish_ns + 1)
    if what == 4 and len(message.data) >= 20:
        at = 4 + 8 * rng.randrange((len(message.data) - 4) // 8)
        number = struct.pack('<d', rng.choice(_NUMBERS))
        return message._replace(data=message.data[:at] + number + message.data[at + 8 :])
    if what == 5:
        return message._replace(data=_text_of(rng, message.data))
    return message._replace(data=_bytes(rng, message.data))


def _text_of(rng: random.Random, data: bytes) -> bytes:
    """Change a digit or a letter that stands in the bytes."""
    places = [i for i, byte in enumerate(data) if chr(byte).isascii() and chr(byte).isalnum()]
    if not places:
        return data
    at = rng.choice(places)
    return data[:at] + rng.choice(b'0123456789aeiou').to_bytes(1, 'big') + data[at + 1 :]


def _bytes(rng: random.Random, data: bytes) -> bytes:
    what, at = rng.randrange(5), rng.randrange(len(data) + 1)
    if what == 0 and at < len(data):
        return data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]
    if what == 1:
        return data[:at]
    if what == 2:
        return data[:at] + rng.randbytes(rng.randrange(1, 9)) + data[at:]
    if what == 3:
        return data[:at] + bytes(rng.randrange(1, 9)) + data[at + 8 :]
    return _text_of(rng, data)


def _text(rng: random.Random, text: str) -> str:
    changed = _bytes(rng, text.encode()).decode('utf-8', 'replace')
    return rng.choice((changed, text + ' ', text.upper(), '', '9' * 5000, '²', text * 2))


CHANGES: tuple[Change, ...] = (_drop, _repeat, _swap, _move_on, _edit, _edit, _edit, _edit)


def _mutate_records(rng: random.Random, path: Path) -> str:
    parts = Parts.of(path)
    names = []
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        change = rng.choice(CHANGES)
        change(rng, parts.records)
        names.append(change.__name__)
    parts.compression = rng.choice((CompressionType.ZSTD,) * 8 + tuple(CompressionType))
    parts.write(path)
    return f'records{"".join(sorted(set(names)))}'


def _mutate_bytes(rng: random.Random, path: Path) -> str:
    data = path.read_bytes()
    what = rng.randrange(4)
    if what == 0 and data:  # a length that asks for more than there is
        at = rng.randrange(len(data))
        data = data[:at] + struct.pack('<Q', 1 << rng.randrange(64)) + data[at + 8 :]
    elif what == 1 and path.suffix in ('.yaml', '') and data:
        lines = data.split(b'\n')
        at = rng.randrange(len(lines))
        lines[at : at + 1] = rng.choice(([], [lines[at]] * 2, [_text_of(rng, lines[at])]))
        data = b'\n'.join(lines)
    else:
        data = _bytes(rng, data)
    path.write_bytes(data)
    return 'bytes'


def _mutate_files(rng: random.Random, path: Path) -> str:
    what = rng.choice(('remove', 'swap', 'empty', 'link', 'pipe', 'folder', 'more', 'sparse'))
    others = sorted(p for p in path.parent.iterdir() if p.is_file() and p != path)
    other = rng.choice(others)
    if what == 'more':
        names = ('run_1.mcap', 'run_².mcap', 'notes\n.txt', 'x.mcap', 'run_0.mcap')
        shutil.copy(path, path.parent / rng.choice(names))
    elif what == 'empty':
        path.write_bytes(b'')
    elif what == 'swap':
        content = path.read_bytes()
        shutil.copy(other, path)
        other.write_bytes(content)
    elif what == 'sparse':
        os.truncate(path, rng.choice((1 << 36, 1 << 30)))
    else:
        path.unlink()
        if what == 'link':
            path.symlink_to(other.name)
        elif what == 'pipe':
            os.mkfifo(path)
        elif what == 'folder':
            path.mkdir()
    return f'file {what}'


def change(rng: random.Random, folder: Path) -> tuple[Path, str]:
    """Change a file of a run folder; return which, and what kind of change it was."""
    paths = sorted(path for path in folder.iterdir() if path.is_file())
    weights = [12 if p.name == 'run.mcap' else 4 if p.suffix == '.mcap' else 1 for p in paths]
    path = rng.choices(paths, weights)[0]
    way = rng.random()
    if path.suffix == '.mcap' and way < 0.8:
        kind = _mutate_records(rng, path)
    elif way < 0.95:
        kind = _mutate_bytes(rng, path)
    else:
        kind = _mutate_files(rng, path)
    return path, kind


def mutate(rng: random.Random, folder: Path) -> str:
    """Change a run folder, and perhaps its digests; return what kind of change it was."""
    path, kind = change(rng, folder)
    digests = rng.choice(('kept', 'kept', 'forged', 'forged', 'removed'))
    if path.name != SUMS_FILE and digests == 'forged' and not kind.endswith('sparse'):
        sums.write_sums(folder)
    elif digests == 'removed':
        (folder / SUMS_FILE).unlink(missing_ok=True)
    return f'{path.name}: {kind}; digests {digests}'
