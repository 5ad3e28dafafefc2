# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""No other reader is shown a flight that was not judged: each way in which a file can try it."""

from __future__ import annotations

import struct
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import lz4.frame
import messages
import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from log_parts import ELSEWHERE, Raw, joined, packed, parsed, views
from log_runs import STATE, make_run
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    Header,
    Message,
    MessageIndex,
    MetadataIndex,
    Statistics,
    SummaryOffset,
)

from rpo_log.errors import ExitCode, LogError
from rpo_log.read.records import MAGIC, RECORD_HEAD
from rpo_log.read.run_log import read_run
from rpo_log.verify import verify

X_M = 123456.0


def lies(raw: Raw, compression: str = '') -> bytes:
    """Return a chunk with a state of another flight at each tick."""
    channel = next(one for _, one in raw.records(Channel) if one.topic == STATE)
    data = b''
    for tick in range(11):
        stamp = make_run(1.0).base.stamp_ns(tick)
        state = messages.odometry(stamp, 'target_lvlh', 'chaser', [X_M] * 6)
        data += joined(packed(Message(channel.id, stamp, state, stamp, tick)))
    ends = [make_run(1.0).base.stamp_ns(tick) for tick in (10, 0)]
    pressed = lz4.frame.compress(data) if compression else data
    return joined(packed(Chunk(compression, pressed, *ends, 0, len(data))))


def led_to(raw: Raw, chunk: bytes, offset: int) -> None:
    """Let the index lead to another chunk than those of the file."""
    record = parsed(chunk[0], chunk[RECORD_HEAD.size :])
    assert isinstance(record, Chunk)
    index = ChunkIndex(
        len(chunk), offset, record.compression, len(record.data), record.message_end_time, 0, {},
        record.message_start_time, record.uncompressed_size,
    )  # fmt: skip
    first = next(at for at, _ in raw.records(ChunkIndex))
    raw.change(ChunkIndex, lambda _: None)
    raw.summary.insert(first, packed(index))


def behind_the_end_of_the_data(raw: Raw) -> None:
    chunk = lies(raw)
    raw.end = bytes(4) + chunk
    led_to(raw, chunk, raw.free + 4)


def in_an_attachment(raw: Raw) -> None:
    chunk = lies(raw)
    content = packed(Attachment(0, 0, 'more', '', chunk))[1]
    led_to(raw, chunk, raw.free + content.index(chunk))
    raw.data.append((Opcode.ATTACHMENT, content))


def a_second_summary(raw: Raw) -> bytes:
    """The footer leads into a record of the data, where a summary ends with its own footer."""
    other = Raw(raw.bytes())
    chunk = lies(raw)
    led_to(other, chunk, raw.free)
    hidden = b''.join(map(joined, other.summary)) + joined(packed(Footer(1, 0, 0)))
    start = raw.free + len(chunk)
    raw.data.append((0x81, chunk + hidden))
    return raw.bytes(start)


def another_file_behind(raw: Raw) -> bytes:
    whole = raw.bytes()
    chunk = lies(raw)
    led_to(raw, chunk, len(whole))
    summary = b''.join(map(joined, raw.summary))
    footer = joined(packed(Footer(len(whole) + len(chunk), 0, 0)))
    return whole + chunk + summary + footer + MAGIC


def a_chunk_behind_the_data(raw: Raw) -> None:
    raw.summary.insert(0, (Opcode.CHUNK, lies(raw)[RECORD_HEAD.size :]))


def a_second_end_of_the_data(raw: Raw) -> None:
    raw.summary.insert(0, (Opcode.DATA_END, bytes(4)))


def a_second_header(raw: Raw) -> None:
    raw.data.append(packed(Header('ros2', 'another')))


def a_chunk_that_is_not_in_the_index(raw: Raw) -> None:
    last = max(one.chunk_start_offset for _, one in raw.records(ChunkIndex))
    raw.change(ChunkIndex, lambda one: None if one.chunk_start_offset == last else one)


def a_channel_only_in_the_summary(raw: Raw) -> None:
    """A stream of a channel that the data does not declare, which the summary does."""
    channels = list(raw.records(Channel))
    raw.summary.insert(channels[-1][0], packed(replace(channels[0][1], id=77, topic='/other')))
    stamp = make_run(1.0).base.epoch_ns
    content = joined(packed(Message(77, stamp, b'lie', stamp, 0)))
    at = len(MAGIC) + sum(len(joined(record)) for record in raw.data)
    raw.data.append(packed(Chunk('', content, stamp, stamp, 0, len(content))))
    index = ChunkIndex(len(joined(raw.data[-1])), at, '', len(content), stamp, 0, {}, stamp,
                       len(content))  # fmt: skip
    raw.summary.insert(max(at for at, _ in raw.records(ChunkIndex)) + 1, packed(index))


def a_channel_without_messages(raw: Raw) -> None:
    at, one = list(raw.records(Channel))[-1]
    raw.summary.insert(at, packed(replace(one, id=77, topic='/other')))


def another_channel_in_the_summary(raw: Raw) -> None:
    raw.change(Channel, lambda one: replace(one, topic='/other') if one.topic == STATE else one)


def a_channel_less_in_the_summary(raw: Raw) -> None:
    raw.change(Channel, lambda one: None if one.topic == '/clock' else one)


def other_statistics(raw: Raw) -> None:
    raw.change(Statistics, lambda one: replace(one, message_count=one.message_count + 1))


def two_statistics(raw: Raw) -> None:
    at, one = next(raw.records(Statistics))
    raw.summary.insert(at, packed(one))


def groups_elsewhere(raw: Raw) -> None:
    def moved(one: SummaryOffset) -> SummaryOffset:
        away = one.group_opcode == Opcode.CHUNK_INDEX
        return replace(one, group_start=ELSEWHERE + 20) if away else one

    raw.change(SummaryOffset, moved)


def a_group_in_two_parts(raw: Raw) -> None:
    raw.summary.append(raw.summary.pop(next(at for at, _ in raw.records(ChunkIndex))))


def an_index_into_a_message(raw: Raw) -> None:
    at = next(i for i, (opcode, _) in enumerate(raw.data) if opcode == Opcode.MESSAGE_INDEX)
    number, _, time, offset = struct.unpack('<HIQQ', raw.data[at][1])
    content = packed(MessageIndex(number, [(time, offset + 20)]))
    raw.data[at] = content


def an_index_that_swallows_what_follows(raw: Raw) -> None:
    at = next(i for i, (opcode, _) in enumerate(raw.data) if opcode == Opcode.MESSAGE_INDEX)
    content = raw.data[at][1]
    swallowed = len(content) - 6 + len(joined(raw.data[at + 1]))
    raw.data[at] = (Opcode.MESSAGE_INDEX, content[:2] + struct.pack('<I', swallowed) + content[6:])


def chunks_of(raw: Raw) -> dict[int, bytes]:
    return {i: c for i, (opcode, c) in enumerate(raw.data) if opcode == Opcode.CHUNK}


def repacked(raw: Raw, record: Chunk) -> None:
    """Put a chunk in the place of the last one, without message indexes; its index follows it."""
    last = max(chunks_of(raw))
    end = next(i for i in range(last + 1, len(raw.data) + 1)
               if i == len(raw.data) or raw.data[i][0] != Opcode.MESSAGE_INDEX)  # fmt: skip
    offset = len(MAGIC) + sum(len(joined(one)) for one in raw.data[:last])
    moved = sum(len(joined(one)) for one in raw.data[last:end]) - len(joined(packed(record)))
    raw.data[last:end] = [packed(record)]
    length = len(joined(packed(record)))

    def follow(one: ChunkIndex) -> ChunkIndex:
        if one.chunk_start_offset != offset:
            return one
        return replace(
            one, chunk_length=length, compressed_size=len(record.data), message_index_offsets={},
            compression=record.compression, message_index_length=0,
            uncompressed_size=record.uncompressed_size,
        )  # fmt: skip

    raw.change(ChunkIndex, follow)
    raw.change(MetadataIndex, lambda one: replace(one, offset=one.offset - moved)
               if one.offset > offset else one)  # fmt: skip


def unpacked(raw: Raw) -> tuple[Chunk, bytes]:
    content = chunks_of(raw)[max(chunks_of(raw))]
    record = parsed(Opcode.CHUNK, content)
    assert isinstance(record, Chunk)
    return record, zstandard.decompress(record.data)


def more_in_a_frame_than_it_says(raw: Raw) -> None:
    record, data = unpacked(raw)
    more = lies(raw)[RECORD_HEAD.size + 8 * 4 + 8 :]
    frame = lz4.frame.compress(data + more, store_size=False)
    repacked(raw, replace(record, compression='lz4', data=frame, uncompressed_crc=0))


def messages_behind_a_channel_in_a_chunk(raw: Raw) -> None:
    """The library goes on behind the fields, not behind the record."""
    record, data = unpacked(raw)
    channel = next(one for _, one in raw.records(Channel) if one.topic == STATE)
    opcode, content = packed(channel)
    more = lies(raw)[RECORD_HEAD.size + 8 * 4 + 8 :]
    data = joined((opcode, content + more)) + data
    changed = replace(record, compression='', data=data, uncompressed_crc=0)
    repacked(raw, replace(changed, uncompressed_size=len(data)))


def messages_that_no_index_leads_to(raw: Raw) -> None:
    """The last chunk is taken apart: its messages stand in the data."""
    _, data = unpacked(raw)
    place = max(chunks_of(raw))
    at, loose = 0, list[tuple[int, bytes]]()
    while at < len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, at)
        at += RECORD_HEAD.size + length
        loose.append((opcode, data[at - length : at]))
    offset = len(MAGIC) + sum(len(joined(one)) for one in raw.data[:place])
    before = sum(len(joined(one)) for one in raw.data)
    raw.data = [one for i, one in enumerate(raw.data)
                if i < place or one[0] not in (Opcode.CHUNK, Opcode.MESSAGE_INDEX)]  # fmt: skip
    raw.data[place:place] = loose
    moved = sum(len(joined(one)) for one in raw.data) - before
    raw.change(ChunkIndex, lambda one: None if one.chunk_start_offset == offset else one)
    raw.change(MetadataIndex, lambda one: replace(one, offset=one.offset + moved)
               if one.offset > offset else one)  # fmt: skip
    raw.change(Statistics, lambda one: replace(one, chunk_count=one.chunk_count - 1))


LED = 'the chunk index records of its summary do not lead to each chunk in turn'
# What a forger does, and how verify names it; whether a reader is shown another flight by it.
FORGERIES = {
    behind_the_end_of_the_data: ('holds more than its fields', True),
    in_an_attachment: (LED, True),
    a_second_summary: ('of the unknown kind 129', True),
    another_file_behind: ('bytes follow its end', True),
    a_chunk_behind_the_data: ('runs backwards', True),
    a_second_end_of_the_data: ('data end at byte', False),
    a_second_header: ('or is a second', False),
    a_chunk_that_is_not_in_the_index: (LED, True),
    a_channel_only_in_the_summary: ('comes before any record of its channel', True),
    a_channel_without_messages: ("the channel '/other' is in its summary only", False),
    another_channel_in_the_summary: ('two channel records of number', True),
    a_channel_less_in_the_summary: ('its summary lacks the channel', True),
    other_statistics: ('statistics in its summary are not those', True),
    two_statistics: ('two statistics records', False),
    groups_elsewhere: ('do not lead to the groups', False),
    a_group_in_two_parts: ('stands apart from its group', False),
    an_index_into_a_message: ('is not that of the chunk before it', False),
    an_index_that_swallows_what_follows: ('belongs to no chunk', True),
    more_in_a_frame_than_it_says: ('its lengths do not fit', True),
    messages_behind_a_channel_in_a_chunk: ('holds more than its fields', True),
    messages_that_no_index_leads_to: ('messages that are in no chunk', True),
}  # fmt: skip


def test_what_is_not_changed_is_put_together_as_it_was(true):
    assert Raw(true.read_bytes()).bytes() == true.read_bytes()
    assert verify(true).exit_code == ExitCode.OK


@pytest.mark.parametrize('forge', FORGERIES, ids=lambda forge: forge.__name__)
def test_a_log_that_shows_others_something_else_is_not_verified(true, tmp_path, forge):
    words, deceives = FORGERIES[forge]
    path = tmp_path / 'run.mcap'
    raw = Raw(true.read_bytes())
    path.write_bytes(forge(raw) or raw.bytes())
    assert (views(path) != views(true)) == deceives
    try:
        found = verify(path)
    except LogError as error:
        assert words in str(error)
        return
    assert found.exit_code == ExitCode.INCOMPLETE, found.sentence()
    assert words in found.sentence()
    assert not [what for what in found.recomputed if 'indexes' in what]
    # What we read does not follow the index.
    np.testing.assert_array_equal(read_run(path).states, read_run(true).states)


@st.composite
def edits(draw: st.DrawFn) -> tuple[float, float, bytes]:
    """Return which record, where in it, and what is written there."""
    number = st.integers(0, 3000).map(lambda n: struct.pack('<Q', n))
    several = st.binary(min_size=1, max_size=4)
    share = st.floats(0.0, 1.0, exclude_max=True)
    return draw(share), draw(share), draw(st.one_of(number, several))


def judge_an_edit(true: Path, folder: Path, edit: tuple[float, float, bytes]) -> None:
    """A kind of record is chosen first: there are few of most."""
    which, where, new = edit
    raw = Raw(true.read_bytes())
    kinds = defaultdict(list)
    for part in (raw.data, raw.summary):
        for at, (opcode, content) in enumerate(part):
            if content:
                kinds[part is raw.summary, opcode].append((part, at))
    chosen = which * len(kinds)
    places = kinds[sorted(kinds)[int(chosen)]]
    part, at = places[int(chosen % 1 * len(places))]
    opcode, content = part[at]
    begin = int(where * len(content))
    part[at] = opcode, content[:begin] + new + content[begin + len(new) :]
    path = folder / 'run.mcap'
    path.write_bytes(raw.bytes())
    try:
        code = verify(path).exit_code
    except LogError:
        return
    if code == ExitCode.OK:
        assert views(path) == views(true)


@pytest.mark.parametrize('count', [40, pytest.param(1000, marks=pytest.mark.slow)])
def test_where_another_reader_is_shown_something_else_nothing_is_verified(true, tmp_path, count):
    @settings(max_examples=count)
    @given(edit=edits())
    def judge(edit):
        judge_an_edit(true, tmp_path, edit)

    judge()
