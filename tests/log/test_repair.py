# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Repair: a whole, conformant log of everything sound in a damaged one, which is never lost."""

from __future__ import annotations

import hashlib
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from log_runs import turned
from rosbags.highlevel import AnyReader

from rpo_log.errors import ExitCode, LogError
from rpo_log.format import rosbag2
from rpo_log.read.run_log import read_run
from rpo_log.signature import Digests
from rpo_log.tools.repair import repair


def cut(folder: Path, content: bytes, size: int | None = None) -> Path:
    folder.mkdir()
    (folder / 'run.mcap').write_bytes(content[:size])
    (folder / 'run_info.yaml').write_text('machine: mine\n')
    (folder / 'SHA256SUMS.sig').write_bytes(b'of the whole log')
    return folder


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def half(log_bytes, tmp_path) -> Path:
    """The folder of a log that is cut in its middle."""
    return cut(tmp_path / 'log', log_bytes, len(log_bytes) // 2)


@pytest.mark.parametrize('share', [0.3, 0.6, 0.97])
def test_a_cut_folder_becomes_that_of_a_shorter_recording(run, log_bytes, tmp_path, share):
    """It is what the recorder writes when it stops there: the same bytes, index and all."""
    folder = cut(tmp_path / 'log', log_bytes, int(len(log_bytes) * share))
    before, ticks = digest(folder / 'run.mcap'), len(read_run(folder).ticks)
    done = repair(folder)
    assert done.output == tmp_path / 'log-repaired'
    assert done.exit_code == ExitCode.OK
    assert 'no whole record at byte' in done.lines()[0]
    assert digest(folder / 'run.mcap') == before
    assert (done.output / 'run_info.yaml').read_text() == 'machine: mine\n'
    shorter = run.write(tmp_path / 'shorter', [m for m in run.messages if m[1] < ticks])
    assert done.messages == sum(shorter.messages.values())
    for name in ('run.mcap', 'metadata.yaml'):
        assert (done.output / name).read_bytes() == (tmp_path / 'shorter' / name).read_bytes()
    assert not Digests.of(done.output).faults
    assert not (done.output / 'SHA256SUMS.sig').exists()


def test_nothing_is_overwritten_and_nothing_half_is_left(half, tmp_path, monkeypatch):
    for path, named in ((half, None), (half / 'run.mcap', tmp_path / 'named')):
        done = repair(path, named)
        assert done.output == (named or tmp_path / 'log-repaired')
        assert not read_run(done.output).damage
    before = digest(tmp_path / 'log-repaired' / 'run.mcap')
    with pytest.raises(LogError, match='exists already'):
        repair(half)
    assert digest(tmp_path / 'log-repaired' / 'run.mcap') == before
    monkeypatch.setattr(rosbag2, 'write_metadata', Mock(side_effect=OSError(28, 'disk full')))
    with pytest.raises(LogError, match='disk full'):
        repair(half, tmp_path / 'other')
    assert not (tmp_path / 'other').exists()


def test_a_whole_log_is_copied(run, tmp_path):
    run.write(tmp_path / 'log')
    (tmp_path / 'wanted').write_bytes((tmp_path / 'log' / 'metadata.yaml').read_bytes())
    (tmp_path / 'log' / 'metadata.yaml').unlink()
    done = repair(tmp_path / 'log')
    assert 'it was whole' in done.lines()[0]
    assert digest(done.output / 'run.mcap') == digest(tmp_path / 'log' / 'run.mcap')
    assert digest(done.output / 'metadata.yaml') == digest(tmp_path / 'wanted')


@pytest.mark.parametrize('number', [0, 30])
def test_a_corrupt_chunk_is_left_out_and_said(run, log_bytes, chunks, tmp_path, number):
    """Of the first one, the summary tells the topics."""
    chunk = chunks[number]
    at = chunk.chunk_start_offset + chunk.chunk_length - 9
    done = repair(cut(tmp_path / 'log', turned(log_bytes, at)))
    assert done.exit_code == ExitCode.INCOMPLETE and '1 chunks lost' in done.lines()[0]
    mended = read_run(done.output)
    np.testing.assert_array_equal(mended.states, run.flight.states[mended.ticks])
    first = (chunk.message_start_time - run.base.epoch_ns) // run.base.dt_ns
    assert first not in mended.ticks and (first == 0 or first - 1 in mended.ticks)
    assert ('are missing' if number else 'begins at tick 1') in '; '.join(mended.gaps)


@pytest.mark.parametrize('where', ['schema in the summary', 'index of a chunk'])
def test_what_only_repeats_is_written_anew(log_bytes, chunks, tmp_path, where):
    """The first record of a number counts, as it does when the summary is lost."""
    at = chunks[30].chunk_start_offset + chunks[30].chunk_length + 30
    at = log_bytes.rindex(b'nav_msgs/msg/Odometry') if where.startswith('schema') else at
    folder = cut(tmp_path / 'log', turned(log_bytes, at))
    with pytest.raises(LogError):
        read_run(folder)
    done = repair(folder)
    assert done.exit_code == ExitCode.OK  # nothing was lost
    assert (done.output / 'run.mcap').read_bytes() == log_bytes


def test_a_log_in_parts_becomes_one_file(run, tmp_path):
    run.write(tmp_path / 'log', split_s=15.0)
    part = tmp_path / 'log' / 'run_2.mcap'
    part.write_bytes(part.read_bytes()[:-500])
    done = repair(tmp_path / 'log')
    mended = read_run(done.output)
    assert not mended.damage and 'run_2.mcap' in done.damage
    assert sorted(path.name for path in done.output.glob('*.mcap')) == ['run.mcap']
    with AnyReader([done.output]) as reader:
        assert reader.message_count == done.messages
        assert sum(topic.msgcount for topic in reader.connections) == reader.message_count


def test_nothing_sound_is_said(log_bytes, chunks, tmp_path):
    folder = cut(tmp_path / 'log', log_bytes, chunks[0].chunk_start_offset + 100)
    (tmp_path / 'text.mcap').write_text('no log')
    cases = {folder / 'run.mcap': 'has no topic', tmp_path / 'nowhere': 'not exist',
             tmp_path: 'no run.mcap', tmp_path / 'text.mcap': 'is not an MCAP file'}  # fmt: skip
    for path, said in cases.items():
        with pytest.raises(LogError, match=said):
            repair(path)
