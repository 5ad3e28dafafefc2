# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The reader: the same arrays by every way, and one clear sentence for every bad input."""

from __future__ import annotations

import os
import random
import resource
import shutil
import struct
from dataclasses import replace
from pathlib import Path

import lz4.frame
import messages
import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from log_parts import Parts
from log_runs import FORCE, STATE, STATUS, turned
from mcap.opcode import Opcode
from mcap.writer import Writer

from rpo_core.wire import cdr
from rpo_log.errors import ExitCode, LogError
from rpo_log.format import rosbag2
from rpo_log.format.run import TimeBase
from rpo_log.read import decode, stream
from rpo_log.read.records import MAGIC, RECORD_HEAD
from rpo_log.read.run_log import controller_of, flight_of, read_run
from rpo_log.read.stream import RunReader

QUICK = settings(max_examples=25, deadline=None, derandomize=True, database=None)


def equal(log, flight) -> None:
    rows = slice(int(log.ticks[0]), int(log.ticks[-1]) + 1)
    for ours, theirs in (
        (log.states, flight.states),
        (log.forces_n, flight.forces_n),
        (log.disturbances_n, flight.disturbances_n),
    ):
        assert ours.view(np.uint64).tolist() == theirs[rows].view(np.uint64).tolist()


def put(tmp_path: Path, content: bytes) -> Path:
    path = tmp_path / 'run.mcap'
    path.write_bytes(content)
    return path


def refusal(path: Path) -> str:
    with pytest.raises(LogError) as found:
        read_run(path)
    assert found.value.exit_code == ExitCode.BAD_INPUT
    assert '\n' not in str(found.value)
    return str(found.value)


def test_arrays_are_the_flight(run, log, blocks):
    log = read_run(log)
    equal(log, run.flight)
    assert log.complete and log.non_canonical == ()
    assert log.ticks.tolist() == list(range(401)) and log.base == run.base
    assert log.times_s.tolist() == run.flight.scenario.times_s.tolist()
    assert log.attachments == run.attachments
    assert log.outcome == 'finished' and [tick for tick, _ in log.statuses] == [0, 400]
    flight = flight_of(log)
    assert flight.scenario == run.flight.scenario
    np.testing.assert_array_equal(flight.disturbances_n, run.flight.disturbances_n)
    assert controller_of(log).name == 'handmade'


def test_one_by_one_is_the_same(run, log, monkeypatch):
    stamp = slice(cdr.STAMP_AT, cdr.STAMP_AT + 8)  # zeros in no message of a run
    monkeypatch.setattr(decode, '_fixed_parts', lambda _: (stamp,))
    log = read_run(log)
    equal(log, run.flight)
    assert len(log.non_canonical) == 4 * len(log.ticks)


def test_a_log_that_is_cut_in_its_summary_is_read(run, log_bytes, tmp_path):
    """Some channels are listed there, and others are not."""
    size = log_bytes.rindex(b'/disturbance_force')
    log = read_run(put(tmp_path, log_bytes[:size]))
    equal(log, run.flight)
    assert log.damage and log.ticks[-1] == 400


@QUICK
@given(data=st.data())
def test_cut_anywhere(run, log_bytes, chunks, data, tmp_path_factory):
    records = [chunk.chunk_start_offset for chunk in chunks]
    ends = [c.chunk_start_offset + c.chunk_length for c in chunks]
    near = st.sampled_from([*records, *ends]).flatmap(
        lambda at: st.integers(max(0, at - 10), min(len(log_bytes) - 1, at + 10))
    )
    size = data.draw(st.one_of(st.integers(0, len(log_bytes) - 1), near))
    path = put(tmp_path_factory.mktemp('cut'), log_bytes[:size])
    whole = sum(end <= size for end in ends)
    if size < 8:
        refusal(path)
    elif whole == 0:
        assert 'not the log of a run' in (said := refusal(path)) or 'no message' in said
    else:
        log = read_run(path)
        equal(log, run.flight)
        assert log.damage and not log.complete
        assert log.base.stamp_ns(int(log.ticks[-1])) == chunks[whole - 1].message_end_time
        gaps = '; '.join(log.gaps)
        assert 'cut short' in gaps and 'rpo repair' in gaps
        assert log.ticks[-1] == 400 or f'ends at tick {log.ticks[-1]} of 400' in gaps
        with pytest.raises(LogError, match='whole flight'):
            flight_of(log)


def test_zeros_at_the_end_are_what_a_power_cut_leaves(run, log_bytes, tmp_path):
    log = read_run(put(tmp_path, log_bytes[: len(log_bytes) // 2] + bytes(5000)))
    equal(log, run.flight)
    assert log.damage


def test_a_log_that_grows_is_read_to_its_new_end(run, log_bytes, tmp_path):
    path = put(tmp_path, log_bytes[: len(log_bytes) // 2])
    reader = RunReader(path)
    path.write_bytes(log_bytes)
    equal(read_run(reader), run.flight)
    assert not reader.damage
    path.write_bytes(log_bytes)
    reader = RunReader(path)
    path.write_bytes(log_bytes[: len(log_bytes) // 2])
    with pytest.raises(LogError, match='was changed while it was read'):
        read_run(reader)


@QUICK
@given(data=st.data())
def test_no_flipped_bit_goes_unnoticed(run, log_bytes, data, tmp_path_factory):
    at = data.draw(st.integers(0, len(log_bytes) - 1))
    bit = data.draw(st.integers(0, 7))
    content = bytearray(log_bytes)
    content[at] ^= 1 << bit
    path = put(tmp_path_factory.mktemp('flip'), bytes(content))
    try:
        log = read_run(path)
    except LogError as error:
        assert '\n' not in str(error)
        return
    # a record whose length or opcode is hit looks like the end of the file
    assert log.damage and not log.complete
    equal(log, run.flight)


@pytest.mark.parametrize(('end', 'place'), [(True, -9), (False, 9 + 24)])  # its data, its checksum
def test_a_corrupt_chunk_is_named(log_bytes, chunks, tmp_path, end, place):
    chunk = chunks[20]
    at = chunk.chunk_start_offset + place + end * chunk.chunk_length
    said = refusal(put(tmp_path, turned(log_bytes, at)))
    assert f'chunk at byte {chunk.chunk_start_offset}' in said
    assert end or 'its checksum does not fit' in said


def test_what_is_no_mcap_file(tmp_path):
    assert 'is empty' in refusal(put(tmp_path, b''))
    assert 'begins with 23 20' in refusal(put(tmp_path, b'# no log\n' * 9))
    assert 'does not exist' in refusal(tmp_path / 'nowhere')
    (tmp_path / 'folder').mkdir()
    (tmp_path / 'folder' / 'other.txt').write_text('')
    said = refusal(tmp_path / 'folder')
    assert 'no run.mcap' in said and 'other.txt' in said
    (tmp_path / 'folder' / 'run.mcap').mkdir()
    assert 'cannot be read' in refusal(tmp_path / 'folder')


def test_parts_are_all_of_one_run_and_numbered_in_plain_digits(run, log, short_run, tmp_path):
    run.write(tmp_path / 'a', split_s=10.0)
    short_run.write(tmp_path / 'b')
    shutil.copy(tmp_path / 'b' / 'run.mcap', tmp_path / 'a' / 'run_4.mcap')
    assert 'same run as run_0.mcap' in refusal(tmp_path / 'a')
    (tmp_path / 'a' / 'run_1.mcap').unlink()
    assert 'run_1.mcap' in refusal(tmp_path / 'a')
    shutil.copy(log, tmp_path / 'run_²0.mcap')
    assert 'holds no run.mcap' in refusal(tmp_path)


def hand_made(path, chunk_size, types, messages, base, library='rpo_log/1') -> None:
    """Write a log of one's own: topics with their types, messages (topic, tick, time, data)."""
    with path.open('wb') as stream:
        file = Writer(stream, chunk_size=chunk_size)
        file.start('ros2', library)
        if base is not None:
            file.add_metadata('rpo_run', base if isinstance(base, dict) else base.to_record())
        channels = {}
        for topic, kind in types.items():
            schema = file.register_schema(kind, 'ros2msg', rosbag2.definition(kind).text.encode())
            channels[topic] = file.register_channel(topic, 'cdr', schema, {})
        for topic, tick, time, data in messages:
            file.add_message(channels[topic], time, data, time, tick)
        file.finish()


BASE = TimeBase(1_000_000_000, 100_000_000, 50)
ODOMETRY, WRENCH = 'nav_msgs/msg/Odometry', 'geometry_msgs/msg/WrenchStamped'
STATUS_TYPE = 'diagnostic_msgs/msg/DiagnosticStatus'
USUAL = {STATE: ODOMETRY, FORCE: WRENCH}


def state_at(tick: int):
    stamp = BASE.stamp_ns(tick)
    return STATE, tick, stamp, messages.odometry(stamp, 'target_lvlh', 'chaser', [1.0] * 6)


def force_at(tick: int):
    stamp = BASE.stamp_ns(tick)
    return FORCE, tick, stamp, messages.wrench(stamp, 'target_lvlh', [1.0] * 3)


def both(*ticks: int):
    return [message for tick in ticks for message in (state_at(tick), force_at(tick))]


def late(tick: int, shift_ns: int):
    """Return a state that has the stamp of tick 3, as of a tick, logged so much later."""
    topic, _, time, data = state_at(3)
    return topic, tick, time + shift_ns, data


ONLY_STATUS = cdr.encode_status(0, 'run', 'x', 'none', {'tick': '0'})
# What is in the log, and what is said of it.
HAND_MADE = {
    'no command': (({STATE: ODOMETRY}, [state_at(0)]),
                   ('no topic control_force', '/relative_state')),
    'another type': (({STATE: ODOMETRY, FORCE: ODOMETRY}, [state_at(0)]), (WRENCH, ODOMETRY)),
    'two runs': (({**USUAL, '/beta/control_force': WRENCH}, [state_at(0)]), ('same role',)),
    'no message': ((USUAL, []), ('holds no message',)),
    'only statuses': (({**USUAL, STATUS: STATUS_TYPE}, [(STATUS, 0, BASE.epoch_ns, ONLY_STATUS)]),
                      ('only statuses',)),
    'no time base': ((USUAL, both(0), None), ('rpo_run',)),
    'no tick length': ((USUAL, both(0), {'epoch_ns': '1', 'dt_ns': '0', 'last_tick': '3'}),
                       ('rpo_run',)),
    'half a time base': ((USUAL, both(0), {'epoch_ns': 'x'}), ('rpo_run',)),
    'a newer format': ((USUAL, both(0), BASE, 'rpo_log/2'), ('log format 2',)),
    'a tick twice': ((USUAL, [*both(0), state_at(1), state_at(1)]),
                     ('tick 1 of /relative_state twice',)),
    'time backwards': ((USUAL, both(0, 1, 2, 1)),
                       ('tick 1 of /relative_state comes after tick 2',)),
    'another log time': ((USUAL, [*both(0), late(3, 1)]), ('log time',)),
    'a stamp of another tick': ((USUAL, [*both(0), late(4, 100_000_000)]),
                                ('tick 4 of /relative_state',)),
    'half a message': ((USUAL, [state_at(0), (FORCE, 0, BASE.epoch_ns, force_at(0)[3][:-8])]),
                       ('tick 0 of /control_force', WRENCH)),
    'half a status': (({**USUAL, STATUS: STATUS_TYPE},
                       [(STATUS, 0, BASE.epoch_ns, ONLY_STATUS[:-8]), *both(0)]),
                      ('tick 0 of /run_status', STATUS_TYPE)),
}  # fmt: skip


@pytest.mark.parametrize('chunk_size', [1, 1 << 40])
@pytest.mark.parametrize('case', HAND_MADE)
def test_what_is_wrong_with_a_log_is_said(tmp_path, monkeypatch, case, chunk_size):
    """Also where each chunk, and each block, has one message."""
    monkeypatch.setattr(stream, 'BLOCK_TICKS', min(chunk_size, stream.BLOCK_TICKS))
    (types, messages, *more), said = HAND_MADE[case]
    path = tmp_path / 'run.mcap'
    hand_made(path, chunk_size, types, messages, *(more or (BASE,)))
    sentence = refusal(path)
    assert all(words in sentence for words in said), sentence


@pytest.mark.parametrize(
    ('old', 'new', 'said'),
    [
        (b'rpo/scenario/1', b'rpo/scenario/2', r'`schema` must be .*rpo/scenario/1'),
        (b'dt_s: 0.1', b'dt_s: 0.05', 'must have the ticks of the log'),
        (b'mass_kg: 10.0', b'mass_kg: heavy', '`mass_kg` must be'),
        (b'mass_kg', b'\xff\xfe', 'not UTF-8'),
        (b'schema', b': : [', 'scenario.yaml'),
        (b'', None, r'must carry scenario\.yaml; it carries controller\.yaml'),
    ],
)
def test_bad_attachment(short_run, tmp_path, old, new, said):
    attached = dict(short_run.attachments)
    text = attached.pop('scenario.yaml')
    attached |= {'scenario.yaml': text.replace(old, new)} if new is not None else {}
    replace(short_run, attachments=attached).write(tmp_path)
    with pytest.raises(LogError, match=said) as found:
        flight_of(read_run(tmp_path))
    assert '\n' not in str(found.value)


def foreign(path: Path, *records: bytes) -> Path:
    """Write an MCAP file of raw records, without an end."""
    path.write_bytes(MAGIC + b''.join(records))
    return path


def record(opcode: Opcode, content: bytes, length: int | None = None) -> bytes:
    return RECORD_HEAD.pack(opcode, len(content) if length is None else length) + content


def chunk(data: bytes, compression: str, size: int) -> bytes:
    name, packed = compression.encode(), data
    head = struct.pack('<QQQII', 0, 0, size, 0, len(name)) + name + struct.pack('<Q', len(packed))
    return record(Opcode.CHUNK, head + packed)


HEADER = record(Opcode.HEADER, struct.pack('<I4sI9s', 4, b'ros2', 9, b'rpo_log/1'))


BOMB, SPARSE = 1 << 28, 60 << 30


def zeros() -> bytes:
    data = random.Random(1).randbytes(20_000)  # so that it does not grow too much
    return chunk(zstandard.compress(bytes((1 << 20) - len(data)) + data), 'zstd', 1 << 20)


# A record of a foreign file, and what is said of it.
FOREIGN = {
    'zstd bomb': (lambda: chunk(zstandard.compress(bytes(BOMB)), 'zstd', BOMB),
                  f'it would have {BOMB} bytes; at most'),
    'lz4 bomb': (lambda: chunk(lz4.frame.compress(bytes(BOMB)), 'lz4', BOMB),
                 f'it would have {BOMB} bytes; at most'),
    'zeros': (zeros, 'it holds a record of kind 0'),
    'sparse': (lambda: record(Opcode.ATTACHMENT, b'', SPARSE), f'it has {SPARSE} bytes; at most'),
    'packed in another way': (lambda: chunk(b'data', 'snappy', 4), "unknown compression 'snappy'"),
}  # fmt: skip


@pytest.mark.parametrize('case', FOREIGN)
def test_what_would_fill_the_memory_is_refused_before(tmp_path, case):
    make, said = FOREIGN[case]
    path = foreign(tmp_path / 'run.mcap', HEADER, make())
    if case == 'sparse':
        os.truncate(path, SPARSE + 100)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert said in refusal(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000


@pytest.mark.parametrize('same', [False, True])
def test_two_files_of_one_name_are_refused(log, tmp_path, same):
    def attach(parts: Parts) -> None:
        found = next(r for r in parts.records if getattr(r, 'name', '') == 'scenario.yaml')
        data = found.data if same else found.data + b'# another\n'
        parts.records.insert(5, replace(found, data=data))

    assert "carries two files named 'scenario.yaml'" in refusal(rewritten(log, tmp_path, attach))


def rewritten(log: Path, tmp_path: Path, change) -> Path:
    parts = Parts.of(log)
    change(parts)
    parts.write(tmp_path / 'run.mcap')
    return tmp_path / 'run.mcap'


@pytest.mark.parametrize('version', ['²', '٣', '9' * 5000, ''])
def test_a_version_that_is_no_number_is_no_newer_one(log, tmp_path, version):
    def rename(parts: Parts) -> None:
        parts.records[0] = replace(parts.records[0], library=f'rpo_log/{version}')

    assert read_run(rewritten(log, tmp_path, rename)).complete
