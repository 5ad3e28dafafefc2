# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Repair: a whole, conformant log of everything sound in a damaged one, which is never lost."""

from __future__ import annotations

import hashlib
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import yaml
from log_runs import turned
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader

from rpo_log.tools.repair import FileRepair, repair
from rpo_mcap.errors import ExitCode, LogError
from rpo_mcap.format import rosbag2
from rpo_mcap.read.run_log import read_run
from rpo_mcap.write.side_file import HealthLogWriter


def cut(folder: Path, content: bytes, size: int | None = None) -> Path:
    folder.mkdir()
    (folder / 'run.mcap').write_bytes(content[:size])
    (folder / 'run_info.yaml').write_text('machine: mine\n')
    return folder


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def strict(path: Path) -> list:
    with path.open('rb') as stream:
        return list(StreamReader(stream, validate_crcs=True).records)


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
    assert done.files[0].sentence().startswith(f'{done.output / "run.mcap"}: repaired, ')
    assert digest(folder / 'run.mcap') == before
    assert (done.output / 'run_info.yaml').read_text() == 'machine: mine\n'
    shorter = run.write(tmp_path / 'shorter', [m for m in run.messages if m[1] < ticks])
    assert done.files[0].messages == sum(shorter.messages.values())
    for name in ('run.mcap', 'metadata.yaml'):
        assert (done.output / name).read_bytes() == (tmp_path / 'shorter' / name).read_bytes()


def test_in_place_keeps_the_damaged_file(half):
    before = digest(half / 'run.mcap')
    done = repair(half, in_place=True)
    assert done.output == half
    assert digest(half / 'run.mcap.damaged') == before
    assert not read_run(half).damage
    names = sorted(path.name for path in half.iterdir())
    assert names == ['metadata.yaml', 'run.mcap', 'run.mcap.damaged', 'run_info.yaml']


def test_one_file(half, tmp_path):
    for named in (None, tmp_path / 'named.mcap'):
        done = repair(half / 'run.mcap', named)
        assert done.output == (named or half / 'run-repaired.mcap')
        assert not read_run(done.output).damage


def test_nothing_is_overwritten(half, tmp_path):
    repair(half)
    taken = tmp_path / 'taken.mcap'
    for path in (taken, half / 'run.mcap.damaged'):
        path.write_text('mine')
    for source, output, in_place in (
        (half, None, False), (half, None, True), (half / 'run.mcap', taken, False),
    ):  # fmt: skip
        with pytest.raises(LogError, match='exists already'):
            repair(source, output, in_place=in_place)
    assert taken.read_text() == (half / 'run.mcap.damaged').read_text() == 'mine'


def test_a_whole_log_is_left_alone(run, tmp_path):
    run.write(tmp_path / 'log')
    before = {p.name: digest(p) for p in (tmp_path / 'log').iterdir()}
    done = repair(tmp_path / 'log')
    assert done.output == tmp_path / 'log'
    assert 'whole' in done.files[0].sentence()
    assert {p.name: digest(p) for p in (tmp_path / 'log').iterdir()} == before
    assert not (tmp_path / 'log-repaired').exists()


def test_only_metadata_yaml_lacks(run, tmp_path, monkeypatch):
    run.write(tmp_path / 'log')
    wanted = (tmp_path / 'log' / 'metadata.yaml').read_bytes()
    (tmp_path / 'log' / 'metadata.yaml').unlink()
    with monkeypatch.context() as full:
        full.setattr(rosbag2, 'write_metadata', Mock(side_effect=OSError(28, 'the disk is full')))
        with pytest.raises(LogError, match=r'metadata\.yaml.*the disk is full'):
            repair(tmp_path / 'log', in_place=True)
    repair(tmp_path / 'log', in_place=True)
    assert (tmp_path / 'log' / 'metadata.yaml').read_bytes() == wanted


def test_a_corrupt_chunk_is_left_out_and_said(run, log_bytes, chunks, tmp_path):
    at = chunks[30].chunk_start_offset + chunks[30].chunk_length - 9
    done = repair(cut(tmp_path / 'log', turned(log_bytes, at)))
    assert done.exit_code == ExitCode.INCOMPLETE
    assert '1 chunks lost' in done.files[0].sentence()
    mended = read_run(done.output)
    assert sum(mended.missing.values()) > 0
    there = mended.ticks
    np.testing.assert_array_equal(mended.states, run.flight.states[there])
    first = (chunks[30].message_start_time - run.base.epoch_ns) // run.base.dt_ns
    assert first not in there and first - 1 in there


def test_the_first_chunk_is_corrupt_but_the_summary_tells_the_topics(log_bytes, chunks, tmp_path):
    at = chunks[0].chunk_start_offset + chunks[0].chunk_length - 9
    mended = read_run(repair(cut(tmp_path / 'log', turned(log_bytes, at))).output)
    assert mended.ticks[0] == 1
    assert any('begins at tick 1' in gap for gap in mended.gaps)


def test_corrupt_index_only(run, log_bytes, chunks, tmp_path):
    at = chunks[30].chunk_start_offset + chunks[30].chunk_length + 30
    done = repair(cut(tmp_path / 'log', turned(log_bytes, at)))
    assert done.exit_code == ExitCode.OK  # nothing was lost
    assert (done.output / 'run.mcap').read_bytes() == log_bytes


def test_split_logs(run, tmp_path):
    run.write(tmp_path / 'log', split_s=15.0)
    part = tmp_path / 'log' / 'run_2.mcap'
    part.write_bytes(part.read_bytes()[:-500])
    (tmp_path / 'log' / 'metadata.yaml').unlink()
    done = repair(tmp_path / 'log')
    assert [file.damage == '' for file in done.files] == [True, True, False]
    mended = read_run(done.output)
    assert not mended.damage
    with AnyReader([done.output]) as reader:
        assert reader.message_count == sum(file.messages for file in done.files)
        assert sum(topic.msgcount for topic in reader.connections) == reader.message_count


def test_the_health_log_too(short_run, tmp_path):
    short_run.write(tmp_path / 'log')
    health = HealthLogWriter(tmp_path / 'log')
    health.write(1, b'\x00\x01\x00\x00' + bytes(16))
    health.close()
    path = tmp_path / 'log' / 'health.mcap'
    path.write_bytes(path.read_bytes()[:-40])
    done = repair(tmp_path / 'log')
    strict(done.output / 'health.mcap')
    info = yaml.safe_load((done.output / 'metadata.yaml').read_text())
    assert info['rosbag2_bagfile_information']['relative_file_paths'] == ['run.mcap']


def test_nothing_sound_is_said(log_bytes, chunks, tmp_path):
    folder = cut(tmp_path / 'log', log_bytes, chunks[0].chunk_start_offset + 100)
    with pytest.raises(LogError, match='cannot be repaired: no whole chunk'):
        repair(folder / 'run.mcap')
    assert FileRepair(folder).bag_file('a') == rosbag2.BagFile('a', 0, 0, 0)
    for path, said in ((tmp_path / 'nowhere', 'not exist'), (tmp_path, 'no run.mcap')):
        with pytest.raises(LogError, match=said):
            repair(path)
    (tmp_path / 'text.mcap').write_text('no log')
    with pytest.raises(LogError, match='is not an MCAP file'):
        repair(tmp_path / 'text.mcap')
