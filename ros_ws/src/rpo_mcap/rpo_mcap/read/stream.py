# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The log of a run, block by block: whole or cut short, in bounded memory, and never a guess.

A log that is cut short (the recorder was killed, the disk was full) is read as far as its chunks
are whole; the reader says until when. Everything else that is wrong with a log is a `LogError`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple, TypeVar

import numpy as np
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    DataEnd,
    Header,
    McapRecord,
    Metadata,
    Schema,
)
from mcap.records import Message as MessageRecord

from rpo_core import files
from rpo_core.files import scenario
from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import InputError, shown
from rpo_core.wire import interfaces
from rpo_mcap import topics
from rpo_mcap.errors import LogError, NotARun
from rpo_mcap.format import rosbag2
from rpo_mcap.format.run import LOG_FORMAT, RUN_RECORD, SCENARIO, TimeBase, log_files
from rpo_mcap.read.decode import Gathering, Message, Messages, TickBlock
from rpo_mcap.read.indexes import Indexes
from rpo_mcap.read.records import RECORD_HEAD, FileRecords, as_record
from rpo_mcap.topics import Topic

BLOCK_TICKS = 4096
"""Ticks that are decoded at once, about 4 MB."""

MAX_BYTES = 1 << 27
"""A log whose messages of one tick are longer is no log of a run."""

_Declaration = TypeVar('_Declaration', Schema, Channel)
_NUMBER = re.compile('[0-9]{1,9}')


@dataclass
class _Extent:
    """What was read of one file: messages per topic, first and last tick; -1: none."""

    counts: list[int]
    first: int = -1
    last: int = -1

    def add(self, messages: Messages) -> None:
        """Count messages."""
        found = np.bincount(messages.topic, minlength=len(self.counts)).tolist()
        self.counts = [sum(pair) for pair in zip(self.counts, found, strict=True)]
        self.first = int(messages.tick[0]) if self.first < 0 else self.first
        self.last = int(messages.tick[-1])


class _Skimmed(NamedTuple):
    """What was found of one file before its messages are read.

    declared : its schemas and channels
    damage : how it ends, as `FileRecords.damage`
    filled : whether it has chunks or messages
    error : why its chunks could not all be read
    """

    declared: list[Schema | Channel]
    damage: str
    filled: bool
    error: LogError | None


class RunReader:
    """Opens the log of a run: its folder, or one .mcap file of it.

    After the constructor: `base`, `topics`, `attachments`. `blocks` then reads all ticks in bounded
    memory. Raises LogError.

    tolerant : whether corrupt chunks are passed over
    lost_chunks : those passed over by `blocks` or `messages`
    foreign : whether it is a bag that our recorder did not write
    lacks : what such a bag does not hold, and a log does
    sources : the files of the log or bag
    attached : files of the log and names of attachments in them, by what was read
    digests : per file, SHA-256 of the bytes that `blocks` read; empty if they were not all read
    witness : called with the file and each of its records beside the messages, while `blocks` reads
    judged : per file, what takes all its records to compare its indexes, while `blocks` reads
    """

    judged: Mapping[Path, Indexes] = MappingProxyType({})
    witness: Callable[[Path, McapRecord], None] | None = None
    foreign = False
    lacks: tuple[str, ...] = ()

    def __init__(self, path: str | Path, *, tolerant: bool = False) -> None:
        self.path, self._tolerant = Path(path), tolerant
        self.files = self.sources = files_of(self.path)
        self._path = self.files[0]
        self.damage, self.lost_chunks = '', 0
        self.attachments: dict[str, bytes] = {}
        self._bases: list[TimeBase] = []
        self._channels: dict[int, Topic] = {}
        self._schemas: dict[int, str] = {}
        self.attached: set[tuple[Path, str]] = set()
        self._declared: dict[tuple[Path, type, int], Schema | Channel] = {}
        self._extents: dict[Path, _Extent] = {}
        self.digests: dict[Path, str] = {}
        self._outlines: dict[Path, tuple[int, bytes]] = {}  # as the constructor found the files
        self.topics: tuple[Topic, ...] = ()
        self._read_heads()

    def blocks(self) -> Iterator[TickBlock]:
        """Yield all ticks in order; afterwards `damage` says whether the log ends early."""
        empty = True
        for messages in self._read():
            empty = False
            yield from _blocks_of(messages)
        if empty:
            raise self._empty(self.damage)

    def extent_of(self, path: Path) -> tuple[list[int], int, int]:
        """Return what was read of a file: messages per topic, first and last stamp [ns]."""
        found = self._extents[path]
        stamps = [self.base.stamp_ns(max(0, tick)) for tick in (found.first, found.last)]
        return found.counts, *(stamps if found.last >= 0 else (0, 0))

    def messages(self) -> Iterator[Message]:
        """Yield every message as it was logged, in order; afterwards `damage` as for `blocks`."""
        for messages in self._read():
            yield from messages

    def _empty(self, damage: str) -> LogError:
        return LogError(self.path, 'holds no message' + (f' ({damage})' if damage else ''))

    def _read_heads(self) -> None:
        """Find the ticks, the topics and the files that the log carries, wherever they stand."""
        found = [self._skim(path) for path in self.files]
        if not self._bases:
            self._base_of_scenario()
        errors = [part.error for part in found if part.error is not None]
        damage = next((part.damage for part in found if part.damage), '')
        if not self._bases:
            if errors:
                raise errors[0]
            raise NotARun(
                self.files[0],
                f'has no record {RUN_RECORD}: it is not '
                'the log of a run' + (f' ({damage})' if damage else ''),
            )
        if not any(part.filled for part in found):
            raise self._empty(damage)
        self.base = self._bases[0]
        recorded: dict[Topic, None] = {}
        for path, part in zip(self.files, found, strict=True):
            self._path, self._schemas, self._channels = path, {}, {}
            for record in sorted(part.declared, key=lambda record: isinstance(record, Channel)):
                self._take(record)
            recorded.update(dict.fromkeys(self._channels.values()))
        self.topics = topics.resolve(recorded, str(self.files[0]))
        signals = [topic.signal for topic in self.topics]
        for signal in topics.REQUIRED:
            if signal not in signals and errors:
                raise errors[0]
            if signal not in signals:
                there = ', '.join(topic.name for topic in recorded) or 'no topic of a run'
                raise LogError(self.files[0], f'has no topic {signal}; it has {there}')

    def _skim(self, path: Path) -> _Skimmed:
        """Take the records beside messages, schemas and channels; return the others.

        Schemas and channels are in the summary; where they are not, the chunks are read for them.
        """
        self._path = path
        records = FileRecords(path, self._tolerant, skim=True)
        declared, behind = list[Schema | Channel](), 0
        for record in records:
            if isinstance(record, Schema | Channel):
                declared.append(record)
            elif isinstance(record, DataEnd):
                behind = len(declared)
            else:
                self._take(record)
        self._outlines[path] = records.outline
        error = None
        if records.filled and (self._tolerant or not _are_all(declared, behind)):
            declared, error = _declared_in(path, self._tolerant)
        return _Skimmed(declared, records.damage, records.filled, error)

    def _take(self, record: McapRecord) -> None:
        """Take a record that is not of the time line."""
        path = self._path
        if isinstance(record, Header):
            name, _, version = record.library.partition('/')
            if name == 'rpo_log' and _NUMBER.fullmatch(version) and int(version) > LOG_FORMAT:
                raise LogError(
                    path,
                    f'is of log format {version}; this version reads formats up to {LOG_FORMAT}',
                )
        elif isinstance(record, Metadata) and record.name == RUN_RECORD:
            self._take_base(path, TimeBase.from_record(record.metadata, path))
        elif isinstance(record, Attachment):
            self._take_attachment(path, record)
        elif isinstance(record, Schema):
            self._schemas[record.id] = self._declare(path, record, record.name).name
        elif isinstance(record, Channel):
            self._take_channel(path, self._declare(path, record, record.topic))
        if self.witness is not None:
            self.witness(path, record)

    def _take_attachment(self, path: Path, record: Attachment) -> None:
        """Take a file; each file of a log carries it once, and all the same one."""
        before = self.attachments.setdefault(record.name, record.data)
        place = (path, record.name)
        if place in self.attached or before != record.data:
            raise LogError(path, f'carries two files named {shown(record.name)}')
        self.attached.add(place)

    def _declare(self, path: Path, record: _Declaration, name: str) -> _Declaration:
        """Return the first record of a number; refuse another: messages would change their type."""
        declared = self._declared.setdefault((path, type(record), record.id), record)
        if declared != record and not self._tolerant:
            kind = type(record).__name__.lower()
            sentence = f'has two {kind} records of number {record.id}, the second for {shown(name)}'
            raise LogError(path, sentence)
        return declared  # type: ignore[return-value]

    def _take_base(self, path: Path, base: TimeBase) -> None:
        self._bases.append(base)
        if base != self._bases[0]:
            raise NotARun(
                path,
                f'must be of the same run as {self.files[0].name}, {self._bases[0]}; got {base}',
            )

    def _base_of_scenario(self) -> None:
        """Take the ticks of the scenario that the log carries, if it has no record of them."""
        data = self.attachments.get(SCENARIO)
        try:
            found = files.loads((data or b'').decode(), scenario.parse, SCENARIO)
        except (InputError, UnicodeDecodeError):
            return
        if isinstance(found, Scenario):
            self._bases.append(TimeBase(found.epoch_ns, found.dt_ns, found.ticks))

    def _take_channel(self, path: Path, channel: Channel) -> None:
        topic = topics.find(channel.topic, channel.metadata.get(topics.SIGNAL, ''))
        if topic is None:
            return
        found = self._schemas.get(channel.schema_id, 'no type')
        if found != topic.type or channel.message_encoding != 'cdr':
            raise LogError(
                path,
                f'{channel.topic} must be {topic.type} in cdr; got '
                f'{found} in {channel.message_encoding or "no encoding"}',
            )
        if self.topics and topic not in self.topics:
            raise LogError(path, f'its summary lacks the channel {shown(channel.topic)}')
        self._channels[channel.id] = topic

    def _read(self) -> Iterator[Messages]:
        """Yield the messages of all files, so many whole ticks at a time."""
        self.damage, self.lost_chunks, newest = '', 0, -1
        most = BLOCK_TICKS * max(1, sum(not topic.is_event for topic in self.topics))
        self.attached.clear()  # the records of the head are read again with the messages
        for path in self.files:
            self._path, self._schemas, self._channels = path, {}, {}
            outline, indexes = self._outlines[path], self.judged.get(path)
            records = FileRecords(path, self._tolerant, known=outline, indexes=indexes)
            gathering = Gathering(path, self.base, self.topics, self._channels, newest)
            extent = self._extents[path] = _Extent([0] * len(self.topics))
            for data, at in self._chunks(records):
                gathering.add(data, at)
                if len(gathering) > most or gathering.size > MAX_BYTES:
                    messages = gathering.take()
                    if len(messages):
                        extent.add(messages)
                        yield messages
                    if gathering.size > MAX_BYTES:
                        sentence = f'is corrupt: tick {gathering.newest + 1} is too long to be read'
                        raise LogError(path, sentence)
            messages = gathering.take(last=True)
            newest = gathering.newest
            if len(messages):
                extent.add(messages)
                yield messages
            self.lost_chunks += records.lost_chunks
            if records.damage:
                self.damage = f'{path.name}: {records.damage}'
            self.digests[path] = '' if records.unread else records.sha256.hexdigest()

    def _chunks(self, records: FileRecords) -> Iterator[tuple[bytes, list[int]]]:
        """Yield the bytes of chunks and where their messages begin; take the other records.

        What a power cut leaves may end with a chunk whose bytes never reached the disk: a corrupt
        chunk is the end of a file that was not closed, if no sound one follows.
        """
        walk = iter(records)
        for record in walk:
            if isinstance(record, MessageRecord):
                data = as_record(record)
                yield data, [RECORD_HEAD.size]
            elif not isinstance(record, Chunk):
                self._take(record)
            else:
                try:
                    data = records.content_of(record)
                except LogError as error:
                    if self._tolerant:
                        records.pass_over(Opcode.CHUNK, error)
                        continue
                    if any(_is_sound(records, rest) for rest in walk) or not records.damage:
                        raise
                    records.damage = error.sentence
                    return
                yield data, records.messages_in(data, self._take)


def _are_all(declared: Sequence[Schema | Channel], behind: int) -> bool:
    """Return whether the summary seems to have all channels of a run, and their schemas are known.

    behind : number of records before the summary
    """
    schemas = {record.id for record in declared if isinstance(record, Schema)}
    listed = [record for record in declared[behind:] if isinstance(record, Channel)]
    found = [topics.find(one.topic, one.metadata.get(topics.SIGNAL, '')) for one in listed]
    signals = {topic.signal for topic in found if topic is not None}
    return signals.issuperset(topics.REQUIRED) and schemas.issuperset(c.schema_id for c in listed)


def _declared_in(path: Path, tolerant: bool) -> tuple[list[Schema | Channel], LogError | None]:
    """Return the schemas and channels of a whole file, and the error that ended the reading."""
    found: dict[str, Schema | Channel] = {}

    def take(record: McapRecord) -> None:
        if isinstance(record, Schema | Channel):
            found.setdefault(repr(record), record)

    records = FileRecords(path, tolerant)
    try:
        for record in records:
            if not isinstance(record, Chunk):
                take(record)
            elif not tolerant or _is_sound(records, record):
                records.messages_in(records.content_of(record), take)
    except LogError as error:
        return list(found.values()), error
    return list(found.values()), None


def _blocks_of(messages: Messages) -> Iterator[TickBlock]:
    """Yield the messages as a block; if one is not of its type, those before it first."""
    try:
        block = messages.block()
    except LogError as error:
        if error.tick is not None and len(before := messages.before(error.tick)):
            yield from _blocks_of(before)
        raise
    yield block


def _is_sound(records: FileRecords, record: McapRecord) -> bool:
    """Return whether a record is a chunk that can be read."""
    try:
        return isinstance(record, Chunk) and bool(records.content_of(record))
    except LogError:
        return False


def files_of(path: Path) -> list[Path]:
    """Return the MCAP files of a run folder, or the file itself; raises LogError."""
    if not path.exists():
        raise NotARun(path, 'does not exist')
    if not path.is_dir():
        return [path]
    files = log_files(path)
    if not files and (renamed := rosbag2.files_in(path)):
        return renamed
    if not files:
        there = ', '.join(sorted(found.name for found in path.iterdir())[:8]) or 'nothing'
        raise NotARun(path, f'holds no run.mcap; it holds {there}')
    for number, file in enumerate(files):
        if len(files) > 1 and file.name != f'run_{number}.mcap':
            raise NotARun(
                path,
                f'must hold run_{number}.mcap too; it holds '
                f'{", ".join(found.name for found in files)}',
            )
    return files


class Completeness:
    """Counts the messages of a log, block by block."""

    def __init__(self, reader: RunReader) -> None:
        self.base = reader.base
        self.messages: dict[Topic, int] = dict.fromkeys(reader.topics, 0)
        self._may_miss = {t for t in reader.topics if not topics.is_due(t, reader.topics)}
        self._due = dict.fromkeys(reader.topics, 0)
        self.dropped: dict[str, int] = {}
        self.first = self.last = -1
        self.outcome: str | None = None

    def add(self, block: TickBlock) -> None:
        """Take the next block."""
        for event in block.events:
            if event.signal == interfaces.RUN_STATUS:
                self.outcome = event.values.get('phase', self.outcome)
                self.dropped = topics.dropped(event.status) | self.dropped  # the first counts
        for topic in self.messages:
            if topic.is_event:
                self.messages[topic] += sum(e.signal == topic.signal for e in block.events)
            else:
                ticks = block.ticks[block.present[topic.signal]]
                self.messages[topic] += len(ticks)
                self._due[topic] += int((ticks < self._until(topic)).sum())
        if len(block.ticks):
            self.first = int(block.ticks[0]) if self.first < 0 else self.first
            self.last = int(block.ticks[-1])

    def _until(self, topic: Topic) -> int:
        """Return the tick from which a topic is expected no more."""
        return self.dropped.get(topic.signal, self.base.last_tick + 1)

    @property
    def missing(self) -> dict[str, int]:
        """Per topic, ticks without a message between the first and the last; none is left out.

        In free running an answer may be missing, and so may what the plant went on without.
        """
        found = {
            topic.name: min(self.last + 1, self._until(topic)) - max(self.first, 0) - count
            for topic, count in self._due.items()
            if topic not in self._may_miss
        }
        return {name: count for name, count in found.items() if count > 0}

    def gaps(self, damage: str) -> tuple[str, ...]:
        """Return why the log does not show a whole flight; empty if it does."""
        found = []
        if damage:
            found.append(f'it is cut short ({damage}); `rpo repair` makes a whole file of the rest')
        if self.first > 0:
            found.append(f'it begins at tick {self.first}')
        if self.last < self.base.last_tick:
            found.append(
                f'it ends at tick {self.last} of {self.base.last_tick}'
                + (f' ({self.outcome})' if self.outcome else '')
            )
        found += [f'{count} messages of {name} are missing' for name, count in self.missing.items()]
        return tuple(found)
