# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The log of a run, block by block: whole or cut short, in bounded memory, and never a guess.

A log that is cut short (the recorder was killed, the disk was full) is read as far as its chunks
are whole; the reader says until when. Everything else that is wrong with a log is a `LogError`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
from mcap.records import Attachment, Channel, DataEnd, Header, McapRecord, Metadata, Schema

from rpo_core import files
from rpo_core.files.validation import InputError, printable, shown
from rpo_core.scenario import scenario
from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import interfaces
from rpo_log import topics
from rpo_log.errors import LogError, NotARun
from rpo_log.format.rosbag2 import BagFile
from rpo_log.format.run import DIFFERING, LOG_FORMAT, RUN_RECORD, SCENARIO, TimeBase, log_files
from rpo_log.read.decode import Gathering, Message, Messages, TickBlock
from rpo_log.read.indexes import Indexes
from rpo_log.read.records import Content, FileRecords
from rpo_log.topics import Topic

BLOCK_TICKS = 4096
"""Ticks that are decoded at once, about 4 MB."""

MAX_BYTES = 1 << 27
"""A log whose messages of one tick are longer is no log of a run."""

_NUMBER = re.compile('[0-9]{1,9}')

Declarations = list[Schema | Channel]


class RunReader:
    """Opens the log of a run: its folder, or one .mcap file of it.

    After the constructor: `base`, `topics`, `attachments`. `blocks` then reads all ticks in bounded
    memory. Raises LogError.

    tolerant : whether corrupt chunks are passed over
    lost_chunks : those passed over by `blocks` or `messages`
    foreign : whether it is a bag that our recorder did not write
    lacks : what such a bag does not hold, and a log does; which messages differed from the first
        of their tick
    sources : the files of the log or bag
    attached : files of the log and names of attachments in them, by what was read
    extents : per file, what `blocks` read of it
    digests : per file, SHA-256 of the bytes that `blocks` read; empty if they were not all read
    judged : per file, what takes all its records to compare its indexes, while `blocks` reads
    """

    judged: Mapping[Path, Indexes] = MappingProxyType({})
    foreign = False
    lacks: tuple[str, ...] = ()

    def __init__(self, path: str | Path, *, tolerant: bool = False) -> None:
        self.path, self._tolerant = Path(path), tolerant
        self.files = self.sources = files_of(self.path)
        self.damage, self.lost_chunks = '', 0
        self.attachments: dict[str, bytes] = {}
        self.attached: set[tuple[Path, str]] = set()
        self.extents: dict[Path, BagFile] = {}
        self.digests: dict[Path, str] = {}
        self.topics: tuple[Topic, ...] = ()
        self._bases: list[TimeBase] = []
        self._declared: dict[tuple[Path, type, int], Schema | Channel] = {}
        self._outlines: dict[Path, tuple[int, bytes]] = {}  # as the constructor found the files
        self._begin(self.files[0])
        self._read_heads()
        differing = self.attachments.get(DIFFERING, b'').decode(errors='replace').splitlines()
        self.lacks += tuple(printable(line.removeprefix('- ')) for line in differing)

    def blocks(self) -> Iterator[TickBlock]:
        """Yield all ticks in order; afterwards `damage` says whether the log ends early."""
        empty = True
        for messages in self._read():
            empty = False
            yield messages.block()
        if empty:
            raise self._empty(self.damage)

    def messages(self) -> Iterator[Message]:
        """Yield every message as it was logged, in order; afterwards `damage` as for `blocks`."""
        for messages in self._read():
            yield from messages

    def _empty(self, damage: str) -> LogError:
        return LogError(self.path, 'holds no message' + (f' ({damage})' if damage else ''))

    def _begin(self, path: Path) -> None:
        self._path = path
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Topic] = {}

    def _read_heads(self) -> None:
        """Find the ticks, the topics and the files that the log carries, wherever they stand."""
        heads = {path: self._skim(path) for path in self.files}
        damage = next((damage for _, damage, _ in heads.values() if damage), '')
        if not self._bases:
            self._base_of_scenario()
        if not self._bases:
            why = f' ({damage})' if damage else ''
            sentence = f'has no record {RUN_RECORD}: it is not the log of a run{why}'
            raise NotARun(self.files[0], sentence)
        if not any(filled for *_, filled in heads.values()):
            raise self._empty(damage)
        self.base = self._bases[0]
        recorded: dict[Topic, None] = {}
        for path, (declared, *_) in heads.items():
            self._begin(path)
            for record in sorted(declared, key=lambda record: isinstance(record, Channel)):
                self._take(record)
            recorded |= dict.fromkeys(self._channels.values())
        self.topics = topics.resolve(recorded, str(self.files[0]))
        for signal in topics.REQUIRED:
            if signal not in [topic.signal for topic in self.topics]:
                there = ', '.join(topic.name for topic in recorded) or 'no topic of a run'
                raise LogError(self.files[0], f'has no topic {signal}; it has {there}')

    def _skim(self, path: Path) -> tuple[Declarations, str, bool]:
        """Take the records beside messages, schemas and channels.

        Return its schemas and channels, its damage, and whether it has messages. The channels are
        in the summary; where they are not, the chunks are read for them.
        """
        self._begin(path)
        records = FileRecords(path, self._tolerant, skim=True)
        declared, in_summary = Declarations(), Declarations()
        ended = False
        for record in records:
            ended = ended or isinstance(record, DataEnd)
            if isinstance(record, Schema | Channel):
                declared.append(record)
                in_summary += [record] if ended else []
            elif not isinstance(record, Content):
                self._take(record)
        self._outlines[path] = records.outline
        cut = self._tolerant or records.damage  # then the summary may lack some
        if records.filled and (cut or not _is_whole(in_summary, declared)):
            all_records = FileRecords(path, self._tolerant)
            channels = {repr(r): r for r in all_records if isinstance(r, Schema | Channel)}
            declared, records.damage = list(channels.values()), all_records.damage
        return declared, records.damage, records.filled

    def _take(self, record: McapRecord) -> None:
        """Take a record that is not of the time line."""
        path = self._path
        if isinstance(record, Header):
            name, _, version = record.library.partition('/')
            if name == 'rpo_log' and _NUMBER.fullmatch(version) and int(version) > LOG_FORMAT:
                upto = f'this version reads formats up to {LOG_FORMAT}'
                raise LogError(path, f'is of log format {version}; {upto}')
        elif isinstance(record, Metadata) and record.name == RUN_RECORD:
            self._bases.append(TimeBase.from_record(record.metadata, path))
            if (base := self._bases[-1]) != self._bases[0]:
                ours = f'{self.files[0].name}, {self._bases[0]}'
                raise NotARun(path, f'must be of the same run as {ours}; got {base}')
        elif isinstance(record, Attachment):
            # Each file of a log carries it once, and all the same one.
            before = self.attachments.setdefault(record.name, record.data)
            if (path, record.name) in self.attached or before != record.data:
                raise LogError(path, f'carries two files named {shown(record.name)}')
            self.attached.add((path, record.name))
        elif isinstance(record, Schema | Channel):
            self._declare(path, record)

    def _declare(self, path: Path, record: Schema | Channel) -> None:
        """Take the first record of a number; refuse another: messages would change their type."""
        first = self._declared.setdefault((path, type(record), record.id), record)
        if first != record and not self._tolerant:
            kind, name = type(record).__name__.lower(), getattr(record, 'topic', None)
            named = shown(name or getattr(record, 'name', ''))
            sentence = f'has two {kind} records of number {record.id}, the second for {named}'
            raise LogError(path, sentence)
        if isinstance(first, Schema):
            self._schemas[first.id] = first.name
        else:
            self._take_channel(path, first)

    def _base_of_scenario(self) -> None:
        """Take the ticks of the scenario that the log carries, if it has no record of them."""
        data = self.attachments.get(SCENARIO)
        try:
            flown = files.loads((data or b'').decode(), scenario.parse, SCENARIO)
        except (InputError, UnicodeDecodeError):
            return
        if isinstance(flown, Scenario):
            self._bases.append(TimeBase.of(flown))

    def _take_channel(self, path: Path, channel: Channel) -> None:
        topic = topics.find(channel.topic, channel.metadata.get(topics.SIGNAL, ''))
        if topic is None:
            return
        type_name = self._schemas.get(channel.schema_id, 'no type')
        if type_name != topic.type or channel.message_encoding != 'cdr':
            got = f'{type_name} in {channel.message_encoding or "no encoding"}'
            raise LogError(path, f'{channel.topic} must be {topic.type} in cdr; got {got}')
        if self.topics and topic not in self.topics:
            raise LogError(path, f'its summary lacks the channel {shown(channel.topic)}')
        self._channels[channel.id] = topic

    def _read(self) -> Iterator[Messages]:
        """Yield the messages of all files, so many whole ticks at a time."""
        self.damage, self.lost_chunks, newest = '', 0, -1
        self.attached.clear()  # the records of the head are read again with the messages
        for path in self.files:
            self._begin(path)
            known, indexes = self._outlines[path], self.judged.get(path)
            records = FileRecords(path, self._tolerant, known=known, indexes=indexes)
            gathering = Gathering(path, self.base, self.topics, self._channels, newest)
            counts, stamps = np.zeros(len(self.topics), dtype=np.int64), [0, 0]
            for messages in filter(len, self._gathered(records, gathering)):
                ends = [self.base.stamp_ns(int(messages.places['tick'][at])) for at in (0, -1)]
                stamps = [stamps[0] if counts.any() else ends[0], ends[1]]
                counts += np.bincount(messages.places['topic'], minlength=len(counts))
                yield messages
            newest = gathering.newest
            self.extents[path] = BagFile(path.name, counts.tolist(), *stamps)
            self.lost_chunks += records.lost_chunks
            if records.damage:
                self.damage = f'{path.name}: {records.damage}'
            self.digests[path] = records.digest

    def _gathered(self, records: FileRecords, gathering: Gathering) -> Iterator[Messages]:
        """Yield the messages of a file, and take its other records."""
        most = BLOCK_TICKS * max(1, sum(not topic.is_event for topic in self.topics))
        for record in records:
            if not isinstance(record, Content):
                self._take(record)
                continue
            gathering.add(*record)
            if len(gathering) > most or gathering.size > MAX_BYTES:
                yield gathering.take()
                if gathering.size > MAX_BYTES:
                    tick = gathering.newest + 1
                    raise LogError(records.path, f'is corrupt: tick {tick} is too long to be read')
        yield gathering.take(last=True)


def _is_whole(in_summary: Declarations, declared: Declarations) -> bool:
    """Return whether the summary seems to have all channels of a run, with known schemas."""
    schemas = {record.id for record in declared if isinstance(record, Schema)}
    listed = [record for record in in_summary if isinstance(record, Channel)]
    topics_of_run = [topics.find(one.topic, one.metadata.get(topics.SIGNAL, '')) for one in listed]
    signals = {topic.signal for topic in topics_of_run if topic is not None}
    return signals.issuperset(topics.REQUIRED) and schemas.issuperset(c.schema_id for c in listed)


def files_of(path: Path) -> list[Path]:
    """Return the MCAP files of a run folder, or the file itself; raises LogError."""
    if not path.exists():
        raise NotARun(path, 'does not exist')
    if not path.is_dir():
        return [path]
    files = log_files(path)
    if not files:
        there = ', '.join(sorted(entry.name for entry in path.iterdir())[:8]) or 'nothing'
        raise NotARun(path, f'holds no run.mcap; it holds {there}')
    names = [file.name for file in files]
    for number, name in enumerate(names):
        if len(names) > 1 and name != f'run_{number}.mcap':
            raise NotARun(path, f'must hold run_{number}.mcap too; it holds {", ".join(names)}')
    return files


class Completeness:
    """Counts the messages that are due at each tick of a log, block by block."""

    def __init__(self, reader: RunReader) -> None:
        self.base = reader.base
        self._due = dict.fromkeys(topics.due(reader.topics), 0)  # before it is expected no more
        self.dropped: dict[str, int] = {}
        self.first = self.last = -1
        self.outcome: str | None = None

    def add(self, block: TickBlock) -> None:
        """Take the next block."""
        for event in block.events:
            if event.signal == interfaces.RUN_STATUS:
                self.outcome = event.values.get('phase', self.outcome)
                self.dropped = topics.dropped(event.status) | self.dropped  # the first counts
        for topic in self._due:
            ticks = block.ticks[block.present[topic.signal]]
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
        counts = {
            topic.name: min(self.last + 1, self._until(topic)) - max(self.first, 0) - count
            for topic, count in self._due.items()
        }
        return {name: count for name, count in counts.items() if count > 0}

    def gaps(self, damage: str) -> tuple[str, ...]:
        """Return why the log does not show a whole flight; empty if it does."""
        texts = []
        if damage:
            texts.append(f'it is cut short ({damage}); `rpo repair` makes a whole file of the rest')
        if self.first > 0:
            texts.append(f'it begins at tick {self.first}')
        if self.last < self.base.last_tick:
            outcome = f' ({self.outcome})' if self.outcome else ''
            texts.append(f'it ends at tick {self.last} of {self.base.last_tick}{outcome}')
        texts += [f'{count} messages of {name} are missing' for name, count in self.missing.items()]
        return tuple(texts)
