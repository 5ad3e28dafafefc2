# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Logs that many tests read."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from invoking import invoke
from log_runs import Run, make_key, make_run, record
from mcap.records import ChunkIndex
from mcap.stream_reader import StreamReader

from rpo_log.read import stream


@pytest.fixture(scope='session')
def short_run() -> Run:
    """Five seconds: 51 ticks."""
    return make_run(5.0)


@pytest.fixture
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Read a log in blocks of seven ticks."""
    monkeypatch.setattr(stream, 'BLOCK_TICKS', 7)


@pytest.fixture(params=[4096, 7], ids=['one block', 'blocks of 7'])
def blocks(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Read a log in blocks of so many ticks."""
    monkeypatch.setattr(stream, 'BLOCK_TICKS', request.param)


@pytest.fixture(scope='session')
def run() -> Run:
    """Forty seconds: 401 ticks, chunks of all lengths."""
    return make_run(40.0)


@pytest.fixture(scope='session')
def true(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of one second, to be forged or rewritten elsewhere."""
    folder = tmp_path_factory.mktemp('true')
    make_run(1.0).write(folder)
    return folder / 'run.mcap'


@pytest.fixture(scope='session')
def log(run: Run, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of `run`, in its folder; to be read only."""
    folder = tmp_path_factory.mktemp('whole')
    assert run.write(folder).whole
    return folder / 'run.mcap'


@pytest.fixture(scope='session')
def turning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run folder of 5 s of tumbling_docking, flown without ROS."""
    folder = tmp_path_factory.mktemp('turning') / 'run'
    options = '--set', 'duration_s=5.0', '--no-fail', '--output', folder
    assert invoke('simulate', 'tumbling_docking', *options).exit_code == 0
    return folder


@pytest.fixture(scope='session')
def log_bytes(log: Path) -> bytes:
    """The bytes of `log`."""
    return log.read_bytes()


@pytest.fixture(scope='session')
def chunks(log: Path) -> list[ChunkIndex]:
    """Where the chunks of `log` lie."""
    with log.open('rb') as stream:
        return [r for r in StreamReader(stream).records if isinstance(r, ChunkIndex)]


@pytest.fixture(scope='session')
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run folder as the recorder leaves it."""
    return record(tmp_path_factory.mktemp('proof') / 'run')


@pytest.fixture
def folder(recorded: Path, tmp_path: Path) -> Path:
    """A copy of `recorded`."""
    return Path(shutil.copytree(recorded, tmp_path / 'run'))


@pytest.fixture(scope='session')
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of two private keys: me.pem, of which trusted/ has the public one, and other.pem."""
    folder = tmp_path_factory.mktemp('keys')
    (folder / 'trusted').mkdir()
    for name in ('me', 'other'):
        make_key(folder / f'{name}.pem')
    (folder / 'me.pub.pem').rename(folder / 'trusted' / 'me.pub.pem')
    return folder
