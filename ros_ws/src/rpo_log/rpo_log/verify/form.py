# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Whether the records of a log beside its messages are those that the recorder writes.

Header, metadata, attachments, schemas, channels: all of them follow from the ticks and topics of
the run and the files that it carries. A record more, or another text in one, is not of the run.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Attachment, Channel, DataEnd, Header, McapRecord, Metadata, Schema

from rpo_core.files.validation import shown
from rpo_log.format import rosbag2, schemas
from rpo_log.format.rosbag2 import BagFile, BagTopic
from rpo_log.format.run import CONTROLLER, PARAMETERS, RUN_RECORD, SCENARIO, is_controller
from rpo_log.read.stream import RunReader
from rpo_log.write.bag_file import MEDIA_TYPE, bag_topics
from rpo_log.write.mcap_file import LIBRARY, PROFILE

_CARRIED = (SCENARIO, CONTROLLER, PARAMETERS)
_COMMENT = re.compile(rb'[ \t]*(#[^\n]*)?\n')
_COMPARED = (Header, Metadata, Attachment, Schema, Channel)


@dataclass
class Form:
    """Keeps the records of one file as they come; says the first that is not as written.

    path : the file
    excess : whether there were more records than any file of the recorder has
    """

    path: Path
    most: int
    excess: bool = False
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

    def deviation(self, expected: Sequence[McapRecord]) -> str:
        """Return the first record that is not as expected, for people; empty if there is none.

        Where the chunk with the schemas and channels stands among the others does not count.
        """
        expected = sorted(expected, key=_is_declaration)
        for number, record in enumerate(sorted(self._found, key=_is_declaration)):
            wanted = expected[number] if number < len(expected) else None
            if wanted is None or not _same(record, wanted):
                return f'{self.path.name}: {_name(record)} is not as the recorder writes it'
        if len(self._found) < len(expected):
            return f'{self.path.name}: {_name(expected[len(self._found)])} is missing'
        return f'{self.path.name}: it has too many records' if self.excess else ''


def records_of_run(reader: RunReader, path: Path) -> list[McapRecord]:
    """Return the records that the recorder writes beside the messages of a file; LogError."""
    counts, first_ns, last_ns = reader.extent_of(path)
    base = reader.base
    open_topics = bag_topics(reader.topics, [0] * len(reader.topics))
    attached = [
        Attachment(base.epoch_ns, base.epoch_ns, name, MEDIA_TYPE, data)
        for name, data in sorted(reader.attachments.items(), key=_order)
        if (name in _CARRIED or is_controller(name)) and reader.carries(path, name)
    ]
    file = BagFile(path.name, first_ns, last_ns, sum(counts))
    return [
        Header(PROFILE, LIBRARY),
        Metadata(rosbag2.RECORD, rosbag2.record_values(open_topics, BagFile(path.name))),
        Metadata(RUN_RECORD, base.to_record()),
        *attached,
        *declarations(open_topics),
        Metadata(rosbag2.RECORD, rosbag2.record_values(bag_topics(reader.topics, counts), file)),
    ]


def _order(attachment: tuple[str, bytes]) -> tuple[int, int, str]:
    """Return the place of an attachment: later controllers come after all others, by number."""
    name = attachment[0]
    later = name not in _CARRIED
    return later, len(name) if later else 0, name


def declarations(topics: Sequence[BagTopic]) -> Iterator[McapRecord]:
    """Yield the schema and channel records of some topics, as the recorder numbers them."""
    numbers: dict[str, int] = {}
    for channel, topic in enumerate(topics, 1):
        if topic.type not in numbers:
            numbers[topic.type] = len(numbers) + 1
            text = schemas.definition(topic.type).text
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
