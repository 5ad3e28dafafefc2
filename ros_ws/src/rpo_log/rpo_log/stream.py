# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The log of a run, block by block: whole or cut short, in bounded memory, and never a guess.

A log that is cut short (the recorder was killed, the disk was full) is read as far as its chunks
are whole; the reader says until when. Everything else that is wrong with a log is a `LogError`.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from rpo_log import topics
from rpo_log.decode import Block, Message, Pattern, SlowDecoder, split_message
from rpo_log.errors import Kind, LogError
from rpo_log.mcap_file import LOG_FORMAT
from rpo_log.run import RUN_RECORD, TimeBase, log_files
from rpo_log.scan import Record, Scan, chunk_records, corrupt, inner_records, parse
from rpo_log.topics import Topic

BLOCK_TICKS = 4096
"""Ticks that are decoded at once, about 4 MB."""


class RunReader:
    """Opens the log of a run: its folder, or one .mcap file of it.

    After the constructor: `base`, `topics`, `attachments`. `blocks` then reads all ticks in bounded
    memory. Raises LogError.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.files = files_of(self.path)
        self.damage = ''
        self.attachments: dict[str, bytes] = {}
        self._bases: list[TimeBase] = []
        self._channels: dict[int, Topic] = {}
        self._schemas: dict[int, str] = {}
        self._pattern: Pattern | None = None
        damage = self._read_head()
        if not self._bases:
            raise LogError(
                Kind.NOT_A_RUN,
                self.files[0],
                f'has no record {RUN_RECORD}: it is not '
                'the log of a run' + (f' ({damage})' if damage else ''),
            )
        if damage is not None:
            raise self._empty(damage)
        self.base = self._bases[0]
        self.topics = self._complete_topics()

    def blocks(self) -> Iterator[Block]:
        """Yield all ticks in order; afterwards `damage` says whether the log ends early."""
        decoder = SlowDecoder(self.files[0], self.base, self.topics)
        self._pattern = None
        self.damage = ''
        for path in self.files:
            decoder.path = path
            yield from self._blocks_of(path, decoder)
        if len(decoder):
            yield decoder.block()
        if decoder.newest < 0:
            raise self._empty(self.damage)

    def messages(self) -> Iterator[Message]:
        """Yield every message as it was logged, in order; afterwards `damage` as for `blocks`."""
        self.damage = ''
        for path in self.files:
            scan = Scan(path)
            for record, records in self._chunks_of(scan):
                chunk = record.opcode == Opcode.CHUNK
                for inner in inner_records(path, record, records) if chunk else (record,):
                    if inner.opcode != Opcode.MESSAGE:
                        self._take(path, inner)
                        continue
                    message = split_message(inner, self._channels, self.base, path)
                    if message is not None:
                        yield message
            if scan.damage:
                self.damage = f'{path.name}: {scan.damage}'

    def _empty(self, damage: str) -> LogError:
        return LogError(
            Kind.EMPTY, self.path, 'holds no message' + (f' ({damage})' if damage else '')
        )

    def _complete_topics(self) -> tuple[Topic, ...]:
        recorded = topics.resolve([t.name for t in self._channels.values()], str(self.files[0]))
        roles = [topic.role for topic in recorded]
        for role in topics.REQUIRED:
            if role not in roles:
                there = ', '.join(topic.name for topic in recorded) or 'no topic of a run'
                raise LogError(
                    Kind.MISSING_TOPIC, self.files[0], f'has no topic {role}; it has {there}'
                )
        return recorded

    def _read_head(self) -> str | None:
        """Read up to the first message; if there is none, return how the file ends, '' for well."""
        path, scan = self.files[0], Scan(self.files[0])
        for record in scan:
            inner = [record]
            if record.opcode == Opcode.CHUNK:
                inner = list(inner_records(path, record, chunk_records(path, record)))
            for found in inner:
                if found.opcode == Opcode.MESSAGE:
                    return None
                self._take(path, found)
        return scan.damage

    def _take(self, path: Path, record: Record) -> None:
        """Take a record that is not of the time line."""
        if record.opcode == Opcode.HEADER:
            library = parse(path, record, Header.read).library
            name, _, version = library.partition('/')
            if name == 'rpo_log' and version.isdigit() and int(version) > LOG_FORMAT:
                raise LogError(
                    Kind.NEWER,
                    path,
                    f'is of log format {version}; this version reads formats up to {LOG_FORMAT}',
                )
        elif record.opcode == Opcode.METADATA:
            metadata = parse(path, record, Metadata.read)
            if metadata.name == RUN_RECORD:
                self._take_base(path, TimeBase.from_record(metadata.metadata, path))
        elif record.opcode == Opcode.ATTACHMENT:
            crc = int.from_bytes(record.content[-4:], 'little')
            if crc not in (0, zlib.crc32(record.content[:-4])):
                raise corrupt(path, record, 'its checksum does not fit')
            attachment = parse(path, record, Attachment.read)
            self.attachments[attachment.name] = attachment.data
        elif record.opcode == Opcode.SCHEMA:
            schema = parse(path, record, Schema.read)
            self._schemas[schema.id] = schema.name
        elif record.opcode == Opcode.CHANNEL:
            self._take_channel(path, parse(path, record, Channel.read))

    def _take_base(self, path: Path, base: TimeBase) -> None:
        self._bases.append(base)
        if base != self._bases[0]:
            raise LogError(
                Kind.NOT_A_RUN,
                path,
                f'must be of the same run as {self.files[0].name}, {self._bases[0]}; got {base}',
            )

    def _take_channel(self, path: Path, channel: Channel) -> None:
        role = topics.role_of(channel.topic)
        if role is None:
            return
        found = self._schemas.get(channel.schema_id, 'no type')
        if found != topics.TYPES[role] or channel.message_encoding != 'cdr':
            raise LogError(
                Kind.WRONG_TYPE,
                path,
                f'{channel.topic} must be {topics.TYPES[role]} in cdr; got '
                f'{found} in {channel.message_encoding or "no encoding"}',
            )
        self._channels[channel.id] = Topic(channel.topic, role)

    def _blocks_of(self, path: Path, decoder: SlowDecoder) -> Iterator[Block]:
        """Yield the blocks of one file; chunks that follow the pattern are decoded together."""
        scan, size = Scan(path), 0
        alike: list[tuple[Record, bytes]] = []
        for record, records in self._chunks_of(scan):
            if self._pattern is not None and records and not len(records) % self._pattern.stride:
                alike.append((record, records))
                size += len(records)
                if size < BLOCK_TICKS * self._pattern.stride:
                    continue
                yield from self._alike(path, decoder, alike)
            else:
                yield from self._alike(path, decoder, alike)
                self._one_by_one(path, decoder, record, records)
                if len(decoder) > BLOCK_TICKS:
                    yield decoder.block(keep_newest=True)
            alike, size = [], 0
        yield from self._alike(path, decoder, alike)
        if scan.damage:
            self.damage = f'{path.name}: {scan.damage}'

    def _chunks_of(self, scan: Scan) -> Iterator[tuple[Record, bytes]]:
        """Yield chunks with what is in them, and messages outside of chunks; take the rest.

        What a power cut leaves may end with a chunk whose bytes never reached the disk: a corrupt
        chunk is the end of a file that was not closed, if no sound one follows.
        """
        records = iter(scan)
        for record in records:
            if record.opcode == Opcode.MESSAGE:
                yield record, b''
            elif record.opcode != Opcode.CHUNK:
                self._take(scan.path, record)
            else:
                try:
                    yield record, chunk_records(scan.path, record)
                except LogError as error:
                    if any(_is_sound(scan.path, rest) for rest in records) or not scan.damage:
                        raise
                    scan.damage = error.sentence

    def _alike(
        self, path: Path, decoder: SlowDecoder, chunks: list[tuple[Record, bytes]]
    ) -> Iterator[Block]:
        """Yield the ticks of chunks that look alike; what only looks so goes one by one."""
        if not chunks or self._pattern is None:
            return
        block = self._pattern.decode(b''.join(data for _, data in chunks), self.base)
        if block is None and len(chunks) > 1:
            for pair in chunks:
                yield from self._alike(path, decoder, [pair])
        elif block is None or int(block.ticks[0]) <= decoder.newest:
            for chunk, data in chunks:
                self._one_by_one(path, decoder, chunk, data)
        else:
            if len(decoder):
                yield decoder.block()
            decoder.pass_on(block)
            yield block

    def _one_by_one(self, path: Path, decoder: SlowDecoder, record: Record, data: bytes) -> None:
        """Take the messages of a chunk whose records are `data`, or one outside of a chunk."""
        inside = record.opcode == Opcode.CHUNK
        messages: list[Message] = []
        for inner in inner_records(path, record, data) if inside else (record,):
            if inner.opcode != Opcode.MESSAGE:
                self._take(path, inner)
                continue
            message = split_message(inner, self._channels, self.base, path)
            if message is not None:
                decoder.add(message)
                messages.append(message)
        self._pattern = decoder.pattern(messages, self._channels) or self._pattern


def _is_sound(path: Path, record: Record) -> bool:
    """Return whether a record is a chunk that can be read."""
    try:
        return record.opcode == Opcode.CHUNK and bool(chunk_records(path, record))
    except LogError:
        return False


def files_of(path: Path) -> list[Path]:
    """Return the MCAP files of a run folder, or the file itself; raises LogError."""
    if not path.exists():
        raise LogError(Kind.NOT_FOUND, path, 'does not exist')
    if not path.is_dir():
        return [path]
    files = log_files(path)
    if not files:
        there = ', '.join(sorted(found.name for found in path.iterdir())[:8]) or 'nothing'
        raise LogError(Kind.NOT_FOUND, path, f'holds no run.mcap; it holds {there}')
    for number, file in enumerate(files):
        if len(files) > 1 and file.name != f'run_{number}.mcap':
            raise LogError(
                Kind.NOT_FOUND,
                path,
                f'must hold run_{number}.mcap too; it holds '
                f'{", ".join(found.name for found in files)}',
            )
    return files
