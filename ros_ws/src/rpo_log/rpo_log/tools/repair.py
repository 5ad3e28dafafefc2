# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A whole log from one that is cut short or corrupt: every sound chunk, as the recorder writes it.

Chunks keep their bounds, so that the sound part of the file keeps its bytes. A new file is written
aside and takes its name when it is whole; the damaged one is never lost.
"""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import yaml
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Metadata, Schema

from rpo_log.errors import ExitCode, Fault, LogError
from rpo_log.format import rosbag2
from rpo_log.format.run import DECISIONS_FILE, HEALTH_FILE, METADATA_FILE, cannot_write, log_files
from rpo_log.read.records import FileRecords, RawMessage, message_at
from rpo_log.write.mcap_file import McapFile

DAMAGED = '.damaged'
"""What is added to the name of a damaged file that a repaired one replaces."""

_BESIDE = (HEALTH_FILE, DECISIONS_FILE)
"""Files of a run folder that are no part of its bag."""


@dataclass
class FileRepair:
    """One file: what was found, what was kept.

    damage : what was wrong with it; empty if nothing was
    lost_chunks : chunks that could not be read
    """

    path: Path
    damage: str = ''
    chunks: int = 0
    lost_chunks: int = 0
    first_ns: int = 0
    last_ns: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    topics: dict[str, rosbag2.BagTopic] = field(default_factory=dict)

    @property
    def messages(self) -> int:
        """Messages kept."""
        return sum(self.counts.values())

    def bag_topics(self) -> list[rosbag2.BagTopic]:
        """Return the topics with the messages kept."""
        return [
            rosbag2.BagTopic(t.name, t.type, t.type_hash, t.qos, self.counts[t.name])
            for t in self.topics.values()
        ]

    def bag_file(self) -> rosbag2.BagFile:
        """Return the file as rosbag2 describes it."""
        return rosbag2.BagFile(self.path.name, self.first_ns, self.last_ns, self.messages)

    def sentence(self) -> str:
        """Return one line for people."""
        if not self.damage:
            return f'{self.path}: whole, {self.messages} messages'
        lost = f', {self.lost_chunks} chunks lost' if self.lost_chunks else ''
        return (
            f'{self.path}: repaired, {self.messages} messages in {self.chunks} chunks kept'
            f'{lost} ({self.damage})'
        )


@dataclass(frozen=True)
class Repair:
    """What `repair` did: its files, and where the result is."""

    output: Path
    files: tuple[FileRepair, ...]

    @property
    def exit_code(self) -> ExitCode:
        """OK, or INCOMPLETE if chunks before the end of a file are lost."""
        lost = any(file.lost_chunks for file in self.files)
        return ExitCode.INCOMPLETE if lost else ExitCode.OK


class _Source:
    """Reads what is sound in a damaged file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.damage = ''
        self.lost_chunks = 0
        self.header = Header('', '')
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}

    def chunks(self) -> Iterator[list[RawMessage]]:
        """Yield the messages of each sound chunk; learns schemas and channels on the way."""
        return (found for found in self._walk() if isinstance(found, list))

    def records(self) -> Iterator[McapRecord]:
        """Yield the records that are no chunks, up to where the file ends."""
        return (found for found in self._walk() if isinstance(found, McapRecord))

    def _walk(self) -> Iterator[McapRecord | list[RawMessage]]:
        records = FileRecords(self.path, tolerant=True)
        for record in records:
            if isinstance(record, Chunk):
                try:
                    data = records.content_of(record)
                    at = records.messages_in(data, self._learn)
                except LogError as error:
                    records.pass_over(Opcode.CHUNK, error)
                    continue
                yield [message_at(data, place) for place in at]
            else:
                self._learn(record)
                yield record
        self.damage, self.lost_chunks = records.damage, records.lost_chunks

    def _learn(self, record: McapRecord) -> None:
        if isinstance(record, Header):
            self.header = record
        elif isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self.channels[record.id] = record


def examine(path: Path) -> FileRepair:
    """Return what a file holds and what is wrong with it; raises LogError."""
    return _examine(_Source(path))


def _examine(source: _Source) -> FileRepair:
    found = FileRepair(source.path)
    numbers: Counter[int] = Counter()
    for messages in source.chunks():
        found.chunks += 1
        numbers.update(message.channel for message in messages)
        times = [message.log_ns for message in messages] or [0]
        found.first_ns = min(found.first_ns or times[0], min(times))
        found.last_ns = max(found.last_ns, max(times))
    found.damage, found.lost_chunks = source.damage, source.lost_chunks
    for number, channel in source.channels.items():
        schema = source.schemas.get(channel.schema_id)
        if schema is not None:
            found.topics[channel.topic] = _bag_topic(channel, schema)
            found.counts[channel.topic] += numbers[number]
    return found


def _bag_topic(channel: Channel, schema: Schema) -> rosbag2.BagTopic:
    try:
        qos = yaml.safe_load(channel.metadata.get('offered_qos_profiles', '[]'))
    except yaml.YAMLError:
        qos = []
    return rosbag2.BagTopic(
        channel.topic,
        schema.name,
        channel.metadata.get('topic_type_hash', ''),
        qos if isinstance(qos, list) else [],
    )


def rebuild(path: Path, target: Path) -> FileRepair:
    """Write the sound part of a file as a whole one; raises LogError if there is nothing sound."""
    source = _Source(path)
    found = _examine(source)
    if not found.messages:
        raise LogError(
            Fault.EMPTY,
            path,
            'cannot be repaired: no whole chunk is in it'
            + (f' ({found.damage})' if found.damage else ''),
        )
    if target.exists():
        raise LogError(Fault.EXISTS, target, 'exists already; a log is never overwritten')
    draft = target.with_name(target.name + '.part')
    try:
        draft.unlink(missing_ok=True)
        _write(source, found, draft)
        draft.replace(target)
    except OSError as error:
        raise cannot_write(target, error) from None
    found.path = target
    return found


def _write(source: _Source, found: FileRepair, draft: Path) -> None:
    """Write the draft; `source` has been read through, so that it knows every channel."""
    file = McapFile(draft, source.header.profile, source.header.library)
    try:
        open_record = True
        for record in source.records():
            if isinstance(record, Metadata):
                if record.name != rosbag2.RECORD or open_record:
                    file.add_metadata(record.name, record.metadata)
                open_record = open_record and record.name != rosbag2.RECORD
            elif isinstance(record, Attachment):
                file.add_attachment(record.name, record.media_type, record.data, record.log_time)
        _write_messages(source, file)
        name = draft.name.removesuffix('.part')
        entry = rosbag2.BagFile(name, found.first_ns, found.last_ns, found.messages)
        file.add_metadata(
            rosbag2.RECORD, rosbag2.record_values(rosbag2.metadata(found.bag_topics(), [entry]))
        )
        file.finish()
    finally:
        file.close()


def _write_messages(source: _Source, file: McapFile) -> None:
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    for number, channel in source.channels.items():
        schema = source.schemas.get(channel.schema_id)
        if schema is None:
            continue
        if schema.id not in schemas:
            schemas[schema.id] = file.add_schema(schema.name, schema.data, schema.encoding)
        channels[number] = file.add_channel(
            channel.topic, schemas[schema.id], channel.metadata, channel.message_encoding
        )
    for messages in source.chunks():
        for message in messages:
            if message.channel in channels:
                file.add_message(
                    channels[message.channel], message.log_ns, message.sequence, message.data
                )
        file.close_chunk()


def repair(path: str | Path, output: str | Path | None = None, *, in_place: bool = False) -> Repair:
    """Make a whole log of the damaged one at a run folder or .mcap file; raises LogError.

    output : folder or file of the result; by default beside the damaged one, <name>-repaired
    in_place : the result takes the place of the damaged file, which is kept as <name>.damaged

    A log in which nothing is wrong is left as it is.
    """
    source = Path(path)
    if not source.exists():
        raise LogError(Fault.NOT_FOUND, source, 'does not exist')
    if source.is_dir():
        return _repair_folder(source, output, in_place)
    found = examine(source)
    if not found.damage and not found.lost_chunks:
        return Repair(source, (found,))
    target = Path(output or source.with_name(f'{source.stem}-repaired{source.suffix}'))
    if in_place:
        target = _set_aside(source)
        source = target.with_name(target.name + DAMAGED)
    return Repair(target, (rebuild(source, target),))


def _set_aside(path: Path) -> Path:
    """Rename a damaged file; return its old name."""
    aside = path.with_name(path.name + DAMAGED)
    if aside.exists():
        raise LogError(Fault.EXISTS, aside, 'exists already; a damaged log is never overwritten')
    try:
        os.rename(path, aside)
    except OSError as error:
        raise cannot_write(path, error) from None
    return path


def _repair_folder(folder: Path, output: str | Path | None, in_place: bool) -> Repair:
    files = log_files(folder)
    if not files:
        raise LogError(Fault.NOT_FOUND, folder, 'holds no run.mcap')
    beside = [folder / name for name in _BESIDE if (folder / name).exists()]
    examined = {file: examine(file) for file in [*files, *beside]}
    sound = not any(found.damage or found.lost_chunks for found in examined.values())
    if sound and (folder / METADATA_FILE).exists():
        return Repair(folder, tuple(examined.values()))
    target = folder if in_place else Path(output or folder.with_name(f'{folder.name}-repaired'))
    if not in_place:
        _copy_rest(folder, target, examined)
    done = []
    for file, found in examined.items():
        if not (found.damage or found.lost_chunks):
            done.append(found)
        elif in_place:
            done += repair(file, in_place=True).files
        else:
            done.append(rebuild(file, target / file.name))
    _write_metadata(target, [found for found in done if found.path.name not in _BESIDE])
    return Repair(target, tuple(done))


def _copy_rest(folder: Path, target: Path, examined: dict[Path, FileRepair]) -> None:
    """Copy what needs no repair to a new folder."""
    damaged = {file.name for file, found in examined.items() if found.damage or found.lost_chunks}
    try:
        target.mkdir(parents=True)
        for path in sorted(folder.iterdir()):
            if path.is_file() and path.name not in {*damaged, METADATA_FILE}:
                shutil.copy2(path, target / path.name)
    except FileExistsError:
        raise LogError(Fault.EXISTS, target, 'exists already; name another output') from None
    except OSError as error:
        raise cannot_write(target, error) from None


def _write_metadata(folder: Path, files: list[FileRepair]) -> None:
    topics: dict[str, rosbag2.BagTopic] = {}
    for topic in (topic for found in files for topic in found.bag_topics()):
        before = topics[topic.name].messages if topic.name in topics else 0
        topics[topic.name] = rosbag2.BagTopic(
            topic.name, topic.type, topic.type_hash, topic.qos, before + topic.messages
        )
    document = rosbag2.metadata(topics.values(), [found.bag_file() for found in files])
    draft = folder / (METADATA_FILE + '.part')
    try:
        draft.write_text(rosbag2.metadata_yaml(document), encoding='utf-8')
        draft.replace(folder / METADATA_FILE)
    except OSError as error:
        raise cannot_write(draft, error) from None
