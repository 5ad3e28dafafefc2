# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What is proven of a log and the folder around it, beside the flight itself.

Some files follow from the flight and are recomputed, some have the digest that they had, and of
some nothing is known.
"""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from mcap.records import Attachment, Channel, Chunk, DataEnd, Header, McapRecord, Metadata, Schema

from rpo_core.files.validation import shown
from rpo_core.wire import interfaces
from rpo_log.signature import Digests, signer
from rpo_log.verify.run_status import Statuses
from rpo_mcap.errors import LogError, read_at_most
from rpo_mcap.format import rosbag2
from rpo_mcap.format.rosbag2 import BagFile, BagTopic
from rpo_mcap.format.run import (
    CONTROLLER,
    METADATA_FILE,
    MOST_CONTROLLERS,
    PARAMETERS,
    RUN_RECORD,
    SCENARIO,
    SIGNATURE_FILE,
    SUMS_FILE,
    TOPICS,
    is_controller,
)
from rpo_mcap.read.indexes import Indexes
from rpo_mcap.read.records import FileRecords
from rpo_mcap.read.stream import RunReader
from rpo_mcap.write.mcap_file import LIBRARY, MEDIA_TYPE, PROFILE, bag_topics

MAX_METADATA_BYTES = 1 << 22


def metadata_fault(reader: RunReader) -> tuple[str, str]:
    """Return why metadata.yaml is not that of the log, empty if it is, and its SHA-256.

    The digest is that of the bytes compared, and empty if there are more. Raises LogError.
    """
    path = reader.path / METADATA_FILE
    counts, bag = [0] * len(reader.topics), []
    for file in reader.files:
        found, first_ns, last_ns = reader.extent_of(file)
        counts = [sum(pair) for pair in zip(counts, found, strict=True)]
        bag.append(BagFile(file.name, first_ns, last_ns, sum(found)))
    expected = rosbag2.metadata_text(bag_topics(reader.topics, counts), bag)
    content = read_at_most(path, MAX_METADATA_BYTES + 1)
    digest = _sha256(content) if len(content) <= MAX_METADATA_BYTES else ''
    if content == expected.encode():
        return '', digest
    lines = zip(content.decode(errors='replace').split('\n'), expected.split('\n'), strict=False)
    number = next((n for n, (a, b) in enumerate(lines, 1) if a != b), 'the last')
    return f'{METADATA_FILE} is not that of the log; line {number} differs', digest


class Evidence:
    """Gathers what is proven beside the flight, what it rests on, and what is not known.

    reader : its records are looked at while its blocks are read

    The others are as in `Verification`.
    """

    def __init__(self, reader: RunReader) -> None:
        self._reader = reader
        most = 2 * len(reader.topics) + len(reader.attachments) + MOST_CONTROLLERS + 8
        self._forms = {path: Form(path, most) for path in reader.files}
        reader.witness = lambda path, record: self._forms[path].take(record)
        reader.judged = {path: form.indexes for path, form in self._forms.items()}
        self.gaps: list[str] = []
        self.recomputed: list[str] = []
        self.unknown: list[str] = []
        self.premises: dict[str, str] = {}
        self.faults: tuple[str, ...] = ()
        self.digested: tuple[str, ...] = ()
        self.signed_by: str | None = None
        self.signed: Mapping[str, str] = {}
        self._read: dict[str, str] = {}  # digests of the files that were read, by name

    def of_log(
        self, statuses: Statuses, free: bool, unjudged: Sequence[str], foreign: bool = False
    ) -> None:
        """Judge run_status, and the records of the log that are not messages.

        unjudged : what of the messages is not compared, for people
        """
        if interfaces.RUN_STATUS in (topic.signal for topic in self._reader.topics):
            self.recomputed.append('phases' + ' and figures' * (not foreign) + ' of run_status')
        else:
            self.unknown.append('how the flight began and ended: no run_status says it')
        self.unknown += ['texts of events', *unjudged]
        if free:
            self.unknown.append('when forces came')
        carried = self._reader.attachments
        self.premises = {name: _sha256(data) for name, data in sorted(carried.items())}
        self.premises['events'] = statuses.said
        self.unknown.append(f'whether {PARAMETERS} is what the nodes ran with')
        if self._reader.foreign:
            self.unknown.append('records of the bag beside its messages')
        if self._reader.foreign:
            self._judge_bag()
            return
        self.unknown.append('the order of the messages within a tick, and how chunks part them')
        if self._reader.damage:
            self.gaps += [f.misleading for f in self._forms.values() if f.misleading]
            return
        gaps = list[str]()
        for path, form in self._forms.items():
            gaps += form.deviations(records_of_run(self._reader, path))
        self._take('; '.join(gaps), 'records beside the messages, indexes and summary')

    def _judge_bag(self) -> None:
        """Compare the indexes of the files of a bag: rosbags follows them, others do not."""
        for path in self._reader.sources:
            if path.suffix != '.mcap':
                if '.mcap' in path.suffixes:
                    self.unknown.append(f'where the indexes of {path.name} lead')
                continue
            form = Form(path, 0)
            records = FileRecords(path, indexes=form.indexes)
            try:
                for record in records:
                    if isinstance(record, Chunk):
                        records.messages_in(records.content_of(record), form.take)
            except LogError as error:
                self.gaps.append(f'the indexes of {path.name} were not compared: {error.sentence}')
            self.gaps += [gap for gap in (form.misleading, records.damage) if gap]

    def of_folder(self, trusted: Path | None) -> None:
        """Judge the other files of the folder, and its signature."""
        folder = self._reader.path
        if not folder.is_dir() or self._reader.foreign:
            if trusted is not None:
                what = 'a bag' if self._reader.foreign else 'a single file'
                self.gaps.append(f'{what} has no signature')
            return
        if not self._reader.damage and os.path.lexists(folder / METADATA_FILE):
            gap, self._read[METADATA_FILE] = metadata_fault(self._reader)
            self._take(gap, METADATA_FILE)
        logs = {path.name: digest for path, digest in self._reader.digests.items()}
        self._read.update(logs)
        digests = Digests.of(folder, self._read)
        proven = {*self.recomputed, *logs}
        self.faults = digests.faults
        self.digested = tuple(name for name in digests.matched if name not in proven)
        self.unknown += [name for name in digests.unlisted if name not in proven]
        self.unknown += [f'{name} {what}' for name, what in digests.others.items()]
        self._judge_signature(folder, trusted, digests)

    def _judge_signature(self, folder: Path, trusted: Path | None, digests: Digests) -> None:
        """Say who signed the folder, if all that was read to verify it is as it was signed."""
        unsigned = ', '.join(name for name in self._read if name not in digests.listed)
        if trusted is None:
            if os.path.lexists(folder / SIGNATURE_FILE):
                self.unknown.append(f'{SIGNATURE_FILE}, which was not checked: no key is trusted')
            if digests.content and unsigned:
                self.unknown.append(f'{SUMS_FILE} does not list {unsigned}')
            return
        key = signer(folder, digests.content, trusted)
        if key is None:
            self.gaps.append(f'no key of {trusted} has signed it')
        elif unsigned:
            self.gaps.append(f'{key} has not signed {unsigned}: {SUMS_FILE} does not list it')
        elif not digests.faults:
            self.signed_by, self.signed = key, digests.matched

    def _take(self, gap: str, what: str) -> None:
        if gap:
            self.gaps.append(gap)
        else:
            self.recomputed.append(what)


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


_CARRIED = (SCENARIO, CONTROLLER, PARAMETERS)
_COMMENT = re.compile(rb'[ \t]*(#[^\n]*)?\n')
_COMPARED = (Header, Metadata, Attachment, Schema, Channel)


@dataclass
class Form:
    """Keeps the records of one file as they come; says which are not as written.

    path : the file
    excess : whether there were more records than any file of the recorder has
    indexes : what leads other readers through the file
    """

    path: Path
    most: int
    excess: bool = False
    indexes: Indexes = field(default_factory=Indexes)
    _found: list[McapRecord] = field(default_factory=list)
    _ended: bool = False

    def take(self, record: McapRecord) -> None:
        """Take the next record that is not a message; the summary repeats what was before it."""
        self._ended = self._ended or isinstance(record, DataEnd)
        if self._ended or not isinstance(record, _COMPARED):
            return
        if len(self._found) < self.most:
            self._found.append(record)
        else:
            self.excess = True

    @property
    def misleading(self) -> str:
        """What may show another reader something else, for people; empty if nothing does."""
        return f'{self.path.name}: {self.indexes.fault}' if self.indexes.fault else ''

    def deviations(self, expected: Sequence[McapRecord]) -> list[str]:
        """Return what is not as expected, for people.

        Where the chunk with the schemas and channels stands among the others does not count. Where
        another writer wrote the same records, numbers and order are not named, what they say is.
        """
        name = self.path.name
        expected = sorted(expected, key=_is_declaration)
        found = sorted(self._found, key=_is_declaration)
        unused = f'{name}: {self.indexes.unused}' if self.indexes.unused else ''
        gaps = [gap for gap in (self.misleading, unused) if gap]
        if not self.excess and len(found) == len(expected) and all(map(_same, found, expected)):
            lacks = self.indexes.lacks[:1]
            return gaps + [f'{name}: it has no {what}, as the recorder writes it' for what in lacks]
        other, missing = _without(found, expected), _without(expected, found)
        names = [_name(record) for record in found]
        gaps += [f'{name}: {_name(record)} is not as the recorder writes it' for record in other]
        gaps += [f'{name}: {_name(r)} is missing' for r in missing if _name(r) not in names]
        if self.excess:
            gaps.append(f'{name}: it has too many records')
        return gaps or [f'{name}: its records are not in the order of the recorder']


def _without(records: Sequence[McapRecord], others: Sequence[McapRecord]) -> list[McapRecord]:
    """Return the records that say something else than all others; each name once."""
    schemas = [{one.id: one.name for one in each if isinstance(one, Schema)}
               for each in (records, others)]  # fmt: skip
    rest = [_unnumbered(record, schemas[1]) for record in others]
    found: dict[str, McapRecord] = {}
    for record in records:
        plain = _unnumbered(record, schemas[0])
        at = next((i for i, other in enumerate(rest) if _same(plain, other)), -1)
        if at < 0:
            found.setdefault(_name(record), record)
        elif not _is_declaration(record):  # which may be repeated
            del rest[at]
    return list(found.values())


def _unnumbered(record: McapRecord, schemas: Mapping[int, str]) -> McapRecord:
    """Return a schema or a channel without the numbers that its writer chose."""
    if isinstance(record, Schema):
        return replace(record, id=0)
    if isinstance(record, Channel):
        named = {**record.metadata, '': schemas.get(record.schema_id, '')}
        return replace(record, id=0, schema_id=0, metadata=named)
    return record


def records_of_run(reader: RunReader, path: Path) -> list[McapRecord]:
    """Return the records that the recorder writes beside the messages of a log; LogError."""
    counts, first_ns, last_ns = reader.extent_of(path)
    base = reader.base
    attached = [
        Attachment(base.epoch_ns, base.epoch_ns, name, MEDIA_TYPE, data)
        for name, data in sorted(reader.attachments.items(), key=_order)
        if (name in (*_CARRIED, TOPICS) or is_controller(name)) and (path, name) in reader.attached
    ]
    file = BagFile(path.name, first_ns, last_ns, sum(counts))
    between = [Metadata(RUN_RECORD, base.to_record()), *attached]
    return records_of_file(bag_topics(reader.topics, counts), file, between)


def records_of_file(
    topics: Sequence[BagTopic], file: BagFile, between: Sequence[McapRecord] = ()
) -> list[McapRecord]:
    """Return the records beside the messages of a file, with some before its schemas; LogError."""
    opened = [replace(topic, messages=0) for topic in topics]
    return [
        Header(PROFILE, LIBRARY),
        Metadata(rosbag2.RECORD, rosbag2.record_values(opened, BagFile(file.path))),
        *between,
        *declarations(opened),
        Metadata(rosbag2.RECORD, rosbag2.record_values(topics, file)),
    ]


def _order(attachment: tuple[str, bytes]) -> tuple[int, int, str]:
    """Return the place of an attachment: later controllers by number, then topics come last."""
    name = attachment[0]
    later = 2 if name == TOPICS else int(name not in _CARRIED)
    return later, len(name) if later else 0, name


def declarations(topics: Sequence[BagTopic]) -> Iterator[McapRecord]:
    """Yield the schema and channel records of some topics, as the recorder numbers them."""
    numbers: dict[str, int] = {}
    for channel, topic in enumerate(topics, 1):
        if topic.type not in numbers:
            numbers[topic.type] = len(numbers) + 1
            text = rosbag2.definition(topic.type).text
            yield Schema(numbers[topic.type], text.encode(), 'ros2msg', topic.type)
        yield Channel(channel, topic.name, 'cdr', topic.channel_metadata, numbers[topic.type])


def _is_declaration(record: McapRecord) -> bool:
    return isinstance(record, Schema | Channel)


def _same(found: McapRecord, wanted: McapRecord) -> bool:
    """Return whether two records are equal; of a definition, comments do not count."""
    if isinstance(found, Schema) and isinstance(wanted, Schema):
        bare = _COMMENT.sub(b'\n', found.data) == _COMMENT.sub(b'\n', wanted.data)
        found = Schema(found.id, wanted.data, found.encoding, found.name) if bare else found
    return found == wanted


def _name(record: McapRecord) -> str:
    kind = type(record).__name__.lower()
    name = getattr(record, 'topic', None) or getattr(record, 'name', None) or ''
    return f'the {kind} {shown(name)}' if name else f'the {kind}'
