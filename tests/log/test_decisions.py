# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""decisions.mcap: what is due, whatever arrives; the same bytes; bytes that are not ours."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from log_runs import record

from rpo_core.wire import cdr
from rpo_core.wire.interfaces import ARRAY_TYPE as TYPE
from rpo_core.wire.interfaces import Decimation
from rpo_log.verify import verify
from rpo_mcap.errors import LogError
from rpo_mcap.format.run import DECISIONS_FILE, TimeBase
from rpo_mcap.read.run_log import decision_at, read_decisions
from rpo_mcap.write.side_file import DecisionLogWriter

BASE = TimeBase(1_767_225_600_000_000_000, 100_000_000, 40)
RATE_HZ = 2.0


def said(tick: int, text: str = 'because') -> bytes:
    statuses = [
        cdr.Status(0, f'decision: {axis}', text, 'handmade', (('force_n', str(tick)),))
        for axis in 'xyz'
    ]
    return cdr.encode_array(BASE.stamp_ns(tick), 'target_lvlh', statuses)


def written(folder, messages) -> bytes:
    folder.mkdir()
    writer = DecisionLogWriter(folder, '/decision', BASE, RATE_HZ)
    for message in messages:
        writer.record(message, 1_000_000)
    writer.close()
    assert writer.failure is None
    return (folder / DECISIONS_FILE).read_bytes()


def test_only_what_is_due_is_kept_once_and_in_order(tmp_path):
    due = [said(tick) for tick in range(0, 41, 5)]
    clean = written(tmp_path / 'clean', due)
    noise = [said(tick) for tick in (3, 7, 12)] + [b'', b'\x00\x01\x00\x00', said(0)[:30]]
    mixed = [m for message in due for m in (message, *random.Random(1).sample(noise, 2), message)]
    assert written(tmp_path / 'mixed', mixed) == clean
    found = list(read_decisions(tmp_path / 'clean' / DECISIONS_FILE))
    assert [BASE.tick_of(decision.stamp_ns) for decision in found] == list(range(0, 41, 5))
    assert [d.numbers[2]['force_n'] for d in found] == [str(tick) for tick in range(0, 41, 5)]


def test_the_decision_at_an_instant_is_the_last_one_before(tmp_path):
    written(tmp_path / 'run', [said(tick) for tick in (0, 5, 10)])
    assert decision_at(tmp_path / 'run', BASE.stamp_ns(9)).stamp_ns == BASE.stamp_ns(5)
    assert decision_at(tmp_path / 'run' / 'run.mcap', BASE.stamp_ns(40)).stamp_ns == (
        BASE.stamp_ns(10)
    )
    assert decision_at(tmp_path, BASE.stamp_ns(9)) is None


def test_a_spoilt_file_is_refused_in_one_sentence(tmp_path):
    written(tmp_path / 'run', [said(0)])
    path = tmp_path / 'run' / DECISIONS_FILE
    path.write_bytes(b'garbage' * 100)
    with pytest.raises(LogError, match='is not an MCAP file'):
        decision_at(tmp_path / 'run', BASE.stamp_ns(0))


@given(st.lists(st.integers(1, 10**9), min_size=1, max_size=50), st.floats(0.01, 1e3))
def test_each_period_has_exactly_one_first_stamp(steps, rate_hz):
    cadence = Decimation(rate_hz)
    stamps = [BASE.epoch_ns + sum(steps[:k]) for k in range(len(steps) + 1)]
    due = [b for a, b in zip([None, *stamps], stamps, strict=False) if cadence.due(b, a)]
    assert len(due) == len({stamp // cadence.length_ns for stamp in stamps})


TEXT = st.text(st.characters(codec='utf-8', exclude_characters='\x00'), max_size=9)
STATUS = st.builds(
    cdr.Status, st.integers(0, 3), TEXT, TEXT, TEXT,
    st.lists(st.tuples(TEXT, TEXT), max_size=3).map(tuple),
)  # fmt: skip


@settings(max_examples=40)
@given(st.integers(0, 2**31 * 10**9 - 1), TEXT, st.lists(STATUS, max_size=4).map(tuple))
def test_an_array_round_trips_in_one_way(stamp_ns, frame, axes):
    data = cdr.encode_array(stamp_ns, frame, axes)
    assert cdr.decode_array(data) == (stamp_ns, axes)
    assert cdr.canonical(TYPE, data) == data


@given(st.binary(max_size=200))
def test_bytes_that_are_no_array_are_a_cdr_error(data):
    for candidate in (data, cdr.HEADER + data, said(0)[:40] + data):
        try:
            cdr.decode_array(candidate)
        except cdr.CdrError:
            continue


def test_a_log_owes_decisions_up_to_the_last_tick_and_takes_no_more_after_its_end(tmp_path):
    writer = DecisionLogWriter(tmp_path, '/decision', BASE, RATE_HZ)
    assert writer.expects(0)
    writer.record(said(0), 0)
    assert not writer.expects(4) and writer.expects(5)
    writer.close()
    content = (tmp_path / DECISIONS_FILE).read_bytes()
    writer.record(said(5), 5)
    writer.close()
    assert writer.failure is None
    assert (tmp_path / DECISIONS_FILE).read_bytes() == content


@pytest.mark.parametrize('control', ['time_to_go', 'more_words'])
def test_the_decisions_of_a_family_verify(control, tmp_path):
    """`time_to_go` counts ticks: its reasons depend on the tick."""
    found = verify(record(tmp_path / 'run', control=control))
    assert found.exit_code == 0, found.sentence()
