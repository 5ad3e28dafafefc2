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
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import yaml
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Metadata, Schema

from rpo_mcap.errors import ExitCode, LogError, NotARun, cannot_write, exists
from rpo_mcap.format import rosbag2, sums
from rpo_mcap.format.run import (
    DECISIONS_FILE,
    HEALTH_FILE,
    METADATA_FILE,
    SIGNATURE_FILE,
    SUMS_FILE,
    log_files,
)
from rpo_mcap.read.records import FileRecords, RawMessage, message_at
from rpo_mcap.write.mcap_file import McapFile

DAMAGED = '.damaged'
"""What is added to the name of a damaged file that a repaired one replaces."""

_BESIDE = (HEALTH_FILE, DECISIONS_FILE)
"""Files of a run folder that are no part of its bag."""

_SUMS = (SUMS_FILE, SIGNATURE_FILE)


@dataclass
class FileRepair:
    """One file: what was found, what was kept.

    damage : what was wrong with it; empty if nothing was
    chunks, lost_chunks : chunks that could be read, and that could not
    first_ns, last_ns : stamps of the messages
    schemas, channels, counts : records, and numbers of messages, by their ids
    attachments : whether it has any
    """

    path: Path
    damage: str = ''
    chunks: int = 0
    lost_chunks: int = 0
    first_ns: int = 0
    last_ns: int = 0
    header: Header = field(default_factory=lambda: Header('', ''))
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    attachments: bool = False

    @property
    def is_whole(self) -> bool:
        """Whether nothing is wrong with the file."""
        return not self.damage and not self.lost_chunks

    @property
    def messages(self) -> int:
        """Messages kept."""
        return sum(topic.messages for topic in _bag_topics([self]))

    def bag_file(self, name: str) -> rosbag2.BagFile:
        """Return the file as rosbag2 describes it."""
        return rosbag2.BagFile(name, self.first_ns, self.last_ns, self.messages)

    def sentence(self) -> str:
        """Return one line for people."""
        if not self.damage:
            return f'{self.path}: whole, {self.messages} messages'
        lost = f', {self.lost_chunks} chunks lost' if self.lost_chunks else ''
        return (
            f'{self.path}: repaired, {self.messages} messages in {self.chunks} chunks kept'
            f'{lost} ({self.damage})'
        )

    def read(self) -> Iterator[McapRecord | list[RawMessage]]:
        """Yield the sound records, and in place of each sound chunk its messages.

        Schemas and channels are taken on the way; afterwards `damage` and `lost_chunks` are known.
        """
        records = FileRecords(self.path, tolerant=True)
        for record in records:
            if isinstance(record, Chunk):
                try:
                    data = records.content_of(record)
                    at = records.messages_in(data, self._take)
                except LogError as error:
                    records.pass_over(Opcode.CHUNK, error)
                    continue
                yield [message_at(data, place) for place in at]
            else:
                self._take(record)
                yield record
        self.damage, self.lost_chunks = records.damage, records.lost_chunks

    def _take(self, record: McapRecord) -> None:
        if isinstance(record, Header):
            self.header = record
        elif isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, Attachment):
            self.attachments = True


def _bag_topics(files: Iterable[FileRepair]) -> list[rosbag2.BagTopic]:
    """Return the topics of some files, with the messages kept; each channel needs a schema."""
    topics: dict[str, rosbag2.BagTopic] = {}
    for found in files:
        for number, channel in found.channels.items():
            schema = found.schemas.get(channel.schema_id)
            if schema is not None:
                topic = topics.get(channel.topic) or _bag_topic(channel, schema)
                messages = topic.messages + found.counts[number]
                topics[channel.topic] = replace(topic, messages=messages)
    return list(topics.values())


def _bag_topic(channel: Channel, schema: Schema) -> rosbag2.BagTopic:
    try:
        qos = yaml.safe_load(channel.metadata.get('offered_qos_profiles', '[]'))
    except yaml.YAMLError:
        qos = []
    type_hash = channel.metadata.get('topic_type_hash', '')
    return rosbag2.BagTopic(
        channel.topic, schema.name, type_hash, qos if isinstance(qos, list) else []
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

    def lines(self) -> list[str]:
        """Return what was done, one line for each file."""
        return [file.sentence() for file in self.files]


def examine(path: Path) -> FileRepair:
    """Return what a file holds and what is wrong with it; raises LogError."""
    found = FileRepair(path)
    for messages in found.read():
        if isinstance(messages, list):
            found.chunks += 1
            found.counts.update(message.channel for message in messages)
            times = [message.log_ns for message in messages] or [0]
            found.first_ns = min(found.first_ns or times[0], min(times))
            found.last_ns = max(found.last_ns, max(times))
    return found


def rebuild(path: Path, target: Path) -> FileRepair:
    """Write the sound part of a file as a whole one; raises LogError if there is nothing sound."""
    found = examine(path)
    if not found.messages:
        why = f' ({found.damage})' if found.damage else ''
        raise LogError(path, f'cannot be repaired: no whole chunk is in it{why}')
    if target.exists():
        raise exists(target)
    draft = target.with_name(target.name + '.part')
    try:
        draft.unlink(missing_ok=True)
        _write(found, draft, target.name)
        draft.replace(target)
    except OSError as error:
        raise cannot_write(target, error) from None
    found.path = target
    return found


def _write(found: FileRepair, draft: Path, name: str) -> None:
    """Write the draft of a file that has been read through, so that every channel is known."""
    file = McapFile(
        draft, found.header.profile, found.header.library, summary_offsets=found.attachments
    )
    open_record, channels = True, None
    try:
        for record in found.read():
            if isinstance(record, list):
                channels = _add_channels(found, file) if channels is None else channels
                for message in record:
                    if message.channel in channels:
                        pair = channels[message.channel], message.data
                        file.add_messages(message.log_ns, message.sequence, [pair])
                file.flush()
            elif isinstance(record, Metadata):
                if record.name != rosbag2.RECORD or open_record:
                    file.add_metadata(record.name, record.metadata)
                open_record = open_record and record.name != rosbag2.RECORD
            elif isinstance(record, Attachment):
                file.add_attachment(
                    record.log_time, record.log_time, record.name, record.media_type, record.data
                )
        values = rosbag2.record_values(_bag_topics([found]), found.bag_file(name))
        file.add_metadata(rosbag2.RECORD, values)
        file.finish()
    finally:
        file.close()


def _add_channels(found: FileRepair, file: McapFile) -> dict[int, int]:
    """Add the channels that have a schema; return the new id of each."""
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    for number, channel in found.channels.items():
        schema = found.schemas.get(channel.schema_id)
        if schema is None:
            continue
        if schema.id not in schemas:
            schemas[schema.id] = file.register_schema(schema.name, schema.encoding, schema.data)
        channels[number] = file.register_channel(
            channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
        )
    return channels


def repair(path: str | Path, output: str | Path | None = None, *, in_place: bool = False) -> Repair:
    """Make a whole log of the damaged one at a run folder or .mcap file; raises LogError.

    output : folder or file of the result; by default beside the damaged one, <name>-repaired
    in_place : the result takes the place of the damaged file, which is kept as <name>.damaged

    A log in which nothing is wrong is left as it is.
    """
    source = Path(path)
    if not source.exists():
        raise NotARun(source, 'does not exist')
    if source.is_dir():
        return _repair_folder(source, output, in_place)
    found = examine(source)
    if found.is_whole:
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
        raise exists(aside, 'a damaged log is never overwritten')
    try:
        os.rename(path, aside)
    except OSError as error:
        raise cannot_write(path, error) from None
    return path


def _repair_folder(folder: Path, output: str | Path | None, in_place: bool) -> Repair:
    files = log_files(folder)
    if not files:
        raise NotARun(folder, 'holds no run.mcap')
    beside = [folder / name for name in _BESIDE if (folder / name).exists()]
    examined = {file: examine(file) for file in [*files, *beside]}
    if all(found.is_whole for found in examined.values()) and (folder / METADATA_FILE).exists():
        return Repair(folder, tuple(examined.values()))
    target = folder if in_place else Path(output or folder.with_name(f'{folder.name}-repaired'))
    if not in_place:
        _copy_rest(folder, target, examined)
    done = []
    for file, found in examined.items():
        if found.is_whole:
            done.append(found)
        elif in_place:
            done += repair(file, in_place=True).files
        else:
            done.append(rebuild(file, target / file.name))
    log = [found for found in done if found.path.name not in _BESIDE]
    try:
        rosbag2.write_metadata(target, _bag_topics(log), [f.bag_file(f.path.name) for f in log])
    except OSError as error:
        raise cannot_write(target / METADATA_FILE, error) from None
    if (folder / SUMS_FILE).exists():
        sums.write_sums(target)
    return Repair(target, tuple(done))


def _copy_rest(folder: Path, target: Path, examined: dict[Path, FileRepair]) -> None:
    """Copy what needs no repair to a new folder."""
    damaged = {file.name for file, found in examined.items() if not found.is_whole}
    try:
        target.mkdir(parents=True)
        for path in sorted(folder.iterdir()):
            if path.is_file() and path.name not in {*damaged, METADATA_FILE, *_SUMS}:
                shutil.copy2(path, target / path.name)
    except FileExistsError:
        raise exists(target, 'name another output') from None
    except OSError as error:
        raise cannot_write(target, error) from None
