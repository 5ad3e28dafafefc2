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
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mcap.records import Attachment, Channel, Header, McapRecord, Metadata, Schema

from rpo_core.files.validation import shown
from rpo_core.wire import interfaces
from rpo_log.errors import LogError, read_at_most
from rpo_log.format import rosbag2, run
from rpo_log.format.rosbag2 import BagFile
from rpo_log.read.indexes import Indexes
from rpo_log.read.records import FileRecords
from rpo_log.read.stream import RunReader
from rpo_log.signature import Digests, signer
from rpo_log.verify.run_status import Statuses
from rpo_log.verify.verification import Verification
from rpo_log.write.mcap_file import LIBRARY, MEDIA_TYPE, PROFILE

MAX_METADATA_BYTES = 1 << 22


def metadata_fault(reader: RunReader) -> tuple[str, str]:
    """Return why metadata.yaml is not that of the log, empty if it is, and its SHA-256.

    The digest is that of the bytes compared, and empty if there are more. Raises LogError.
    """
    path = reader.path / run.METADATA_FILE
    expected = rosbag2.metadata_text(reader.topics, list(reader.extents.values()))
    content = read_at_most(path, MAX_METADATA_BYTES + 1)
    digest = _sha256(content) if len(content) <= MAX_METADATA_BYTES else ''
    if content == expected.encode():
        return '', digest
    lines = zip(content.decode(errors='replace').split('\n'), expected.split('\n'), strict=False)
    number = next((n for n, (a, b) in enumerate(lines, 1) if a != b), 'the last')
    return f'{run.METADATA_FILE} is not that of the log; line {number} differs', digest


class Evidence:
    """Adds to a verification what is proven beside the flight, and what is not known.

    reader : its records are looked at while its blocks are read
    """

    def __init__(self, reader: RunReader, outcome: Verification) -> None:
        self._reader, self._outcome = reader, outcome
        max_records = 2 * len(reader.topics) + len(reader.attachments) + run.MOST_CONTROLLERS + 8
        reader.judged = self._forms = {path: Form(path, max_records) for path in reader.files}
        self._read: dict[str, str] = {}  # digests of the files that were read, by name

    def of_log(self, statuses: Statuses, unjudged: Sequence[str], foreign: bool) -> None:
        """Judge run_status, and the records of the log that are not messages.

        unjudged : what of the messages is not compared, for people
        foreign : whether the plant is somebody else's
        """
        outcome, reader = self._outcome, self._reader
        if interfaces.RUN_STATUS in (topic.signal for topic in reader.topics):
            outcome.recomputed += ('phases' + ' and figures' * (not foreign) + ' of run_status',)
        else:
            self._do_not_know('how the flight began and ended: no run_status says it')
        self._do_not_know('texts of events', *unjudged)
        if outcome.free_running:
            self._do_not_know('which commands the plant applied, and when')
        outcome.premises = {n: _sha256(data) for n, data in sorted(reader.attachments.items())}
        outcome.premises['events'] = statuses.said
        self._do_not_know(f'whether {run.PARAMETERS} is what the nodes ran with')
        if reader.foreign:
            self._do_not_know('records of the bag beside its messages')
            self._judge_bag()
            return
        self._do_not_know('the order of messages within a tick, and their chunks')
        if reader.damage:
            outcome.gaps += tuple(f.misleading for f in self._forms.values() if f.misleading)
            return
        gaps = list[str]()
        for path, form in self._forms.items():
            gaps += form.deviations(records_of_run(reader, path))
        self._take('; '.join(gaps), 'records beside the messages, indexes and summary')

    def _do_not_know(self, *what: str) -> None:
        self._outcome.unknown += what

    def _judge_bag(self) -> None:
        """Compare the indexes of the files of a bag: rosbags follows them, others do not."""
        for path in self._reader.sources:
            if path.suffix != '.mcap':
                if '.mcap' in path.suffixes:
                    self._do_not_know(f'where the indexes of {path.name} lead')
                continue
            form = Form(path, 0)
            records = FileRecords(path, indexes=form)
            try:
                for _ in records:
                    pass
            except LogError as error:
                gap = f'the indexes of {path.name} were not compared: {error.sentence}'
                self._outcome.gaps += (gap,)
            self._outcome.gaps += tuple(gap for gap in (form.misleading, records.damage) if gap)

    def of_folder(self, trusted: Path | None) -> None:
        """Judge the other files of the folder, and its signature."""
        outcome, folder = self._outcome, self._reader.path
        if not folder.is_dir() or self._reader.foreign:
            if trusted is not None:
                what = 'a bag' if self._reader.foreign else 'a single file'
                outcome.gaps += (f'{what} has no signature',)
            return
        if not self._reader.damage and os.path.lexists(folder / run.METADATA_FILE):
            gap, self._read[run.METADATA_FILE] = metadata_fault(self._reader)
            self._take(gap, run.METADATA_FILE)
        logs = {path.name: digest for path, digest in self._reader.digests.items()}
        self._read.update(logs)
        digests = Digests.of(folder, self._read)
        proven = {*outcome.recomputed, *logs}
        outcome.faults = digests.faults
        outcome.digested = tuple(name for name in digests.matched if name not in proven)
        self._do_not_know(*(name for name in digests.unlisted if name not in proven))
        self._do_not_know(*(f'{name} {what}' for name, what in digests.others.items()))
        self._judge_signature(folder, trusted, digests)

    def _judge_signature(self, folder: Path, trusted: Path | None, digests: Digests) -> None:
        """Say who signed the folder, if all that was read to verify it is as it was signed."""
        outcome = self._outcome
        unsigned = ', '.join(name for name in self._read if name not in digests.listed)
        if trusted is None:
            if os.path.lexists(folder / run.SIGNATURE_FILE):
                self._do_not_know(f'{run.SIGNATURE_FILE}, which was not checked: no key is trusted')
            if digests.content and unsigned:
                self._do_not_know(f'{run.SUMS_FILE} does not list {unsigned}')
            return
        key = signer(folder, digests.content, trusted)
        if key is None:
            outcome.gaps += (f'no key of {trusted} has signed it',)
        elif unsigned:
            gap = f'{key} has not signed {unsigned}: {run.SUMS_FILE} does not list it'
            outcome.gaps += (gap,)
        elif not digests.faults:
            outcome.signed_by, outcome.signed = key, digests.matched

    def _take(self, gap: str, what: str) -> None:
        if gap:
            self._outcome.gaps += (gap,)
        else:
            self._outcome.recomputed += (what,)


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


_CARRIED = (run.SCENARIO, run.CONTROLLER, run.PARAMETERS)
_LAST = {run.TOPICS: 2, run.DIFFERING: 3}
_KNOWN = (*_CARRIED, *_LAST)
_COMMENT = re.compile(rb'[ \t]*(#[^\n]*)?\n')


class Form(Indexes):
    """Keeps the records of one file as they come, too; says which are not as written.

    path : the file
    max_records : more are not kept: no file of the recorder has them
    """

    def __init__(self, path: Path, max_records: int) -> None:
        super().__init__()
        self.path, self.max_records = path, max_records
        self._records: list[McapRecord] = []

    def take(self, opcode: int, offset: int, content: bytes, record: McapRecord | None) -> None:
        """Take the next record of the file."""
        super().take(opcode, offset, content, record)
        if isinstance(record, Header | Metadata | Attachment):
            self._keep(record)

    def declare(self, record: Schema | Channel, content: bytes, begin: int = -1) -> None:
        """Take a schema or a channel."""
        super().declare(record, content, begin)
        self._keep(record)

    def _keep(self, record: McapRecord) -> None:
        """Keep a record of the data; the summary repeats some of them."""
        if not self.ended and len(self._records) <= self.max_records:
            self._records.append(record)

    @property
    def misleading(self) -> str:
        """What may show another reader something else, for people; empty if nothing does."""
        return f'{self.path.name}: {self.fault}' if self.fault else ''

    def deviations(self, expected: Sequence[McapRecord]) -> list[str]:
        """Return what is not as expected, for people.

        Where the chunk with the schemas and channels stands among the others, and how they are
        numbered, does not count; nor do comments of a definition.
        """
        name = self.path.name
        records, expected = _comparable(self._records), _comparable(expected)
        unused = f'{name}: {self.unused}' if self.unused else ''
        gaps = [gap for gap in (self.misleading, unused) if gap]
        if records == expected:
            lacks = self.lacks[:1]
            return gaps + [f'{name}: it has no {what}, as the recorder writes it' for what in lacks]
        others = dict.fromkeys(_label(r) for r in records if r not in expected)
        gaps += [f'{name}: {label} is not as the recorder writes it' for label in others]
        missing = dict.fromkeys(_label(record) for record in expected if record not in records)
        there = {_label(record) for record in records}
        gaps += [f'{name}: {label} is missing' for label in missing if label not in there]
        return gaps or [f'{name}: its records are not once each, in the order of the recorder']


def _comparable(records: Sequence[McapRecord]) -> list[McapRecord]:
    """Return records without the numbers that their writer chose, schemas and channels last."""
    schemas = {one.id: one.name for one in records if isinstance(one, Schema)}
    plain = list[McapRecord]()
    for record in sorted(records, key=lambda r: (isinstance(r, Schema), isinstance(r, Channel))):
        if isinstance(record, Schema):
            record = replace(record, id=0, data=_COMMENT.sub(b'\n', record.data))
        elif isinstance(record, Channel):
            named = {**record.metadata, '': schemas.get(record.schema_id, '')}
            record = replace(record, id=0, schema_id=0, metadata=named)
        plain.append(record)
    return plain


def records_of_run(reader: RunReader, path: Path) -> list[McapRecord]:
    """Return the records that the recorder writes beside the messages of a log; LogError."""
    base, topics = reader.base, reader.topics
    opened = BagFile(path.name, [0] * len(topics))
    types = list(dict.fromkeys(topic.type for topic in topics))
    return [
        Header(PROFILE, LIBRARY),
        Metadata(rosbag2.RECORD, rosbag2.record_values(topics, opened)),
        Metadata(run.RUN_RECORD, base.to_record()),
        *(
            Attachment(base.epoch_ns, base.epoch_ns, name, MEDIA_TYPE, data)
            for name, data in sorted(reader.attachments.items(), key=_order)
            if (name in _KNOWN or run.is_controller(name)) and (path, name) in reader.attached
        ),
        Metadata(rosbag2.RECORD, rosbag2.record_values(topics, reader.extents[path])),
        *(
            Schema(number, rosbag2.definition(type_name).text.encode(), 'ros2msg', type_name)
            for number, type_name in enumerate(types)
        ),
        *(
            Channel(0, topic.name, 'cdr', rosbag2.channel_metadata(topic), types.index(topic.type))
            for topic in topics
        ),
    ]


def _order(attachment: tuple[str, bytes]) -> tuple[int, int, str]:
    """Return the place of an attachment: later controllers by number, topics, what differed."""
    name = attachment[0]
    later = _LAST.get(name, int(name not in _CARRIED))
    return later, len(name) if later else 0, name


def _label(record: McapRecord) -> str:
    record_type = type(record).__name__.lower()
    name = getattr(record, 'topic', None) or getattr(record, 'name', None) or ''
    return f'the {record_type} {shown(name)}' if name else f'the {record_type}'
