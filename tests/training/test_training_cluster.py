# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Training on a dask cluster of real processes: lost workers, a lost scheduler, the same bits."""

import signal
from pathlib import Path

import pytest
from clusters import cluster
from typer.testing import CliRunner

from rpo_cli.cli import app
from rpo_core.files.validation import InputError
from rpo_montecarlo.cluster import pool
from rpo_training import config as configs
from rpo_training.training import Training

pytestmark = pytest.mark.timeout(180)

SETTINGS = ['ga.generations=12', 'ga.population=24', 'fitness.disturbance=1.0']


def configured():
    return configs.override(configs.PRESETS['paper'], SETTINGS)


def contents(folder: Path):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.mark.slow
def test_a_worker_killed_in_mid_training_changes_no_byte(tmp_path):
    Training.create(configured(), tmp_path / 'alone', 2).run()
    with cluster(2, tmp_path) as (address, (_, first, second)):

        def kill_once(progress):
            if progress.generation == 4:
                first.send_signal(signal.SIGKILL)

        Training.create(configured(), tmp_path / 'together', address=address).run(kill_once)
        assert first.wait() == -signal.SIGKILL
        assert second.poll() is None
    assert contents(tmp_path / 'together') == contents(tmp_path / 'alone')


@pytest.mark.slow
def test_a_lost_scheduler_is_one_sentence_and_the_run_goes_on_elsewhere(tmp_path):
    Training.create(configured(), tmp_path / 'alone', 2).run()
    folder = tmp_path / 'f'
    with cluster(1, tmp_path) as (address, (scheduler, _)):

        def kill(progress):
            if progress.generation == 4:
                scheduler.send_signal(signal.SIGKILL)

        with pytest.raises(InputError, match=f'cluster {address} was lost.*--resume'):
            Training.create(configured(), folder, address=address).run(kill)
    again = Training.resume(folder, 2)
    assert len(again.checkpoint.scores) == 5
    again.run()
    assert contents(folder) == contents(tmp_path / 'alone')


@pytest.mark.slow
def test_a_local_cluster_trains_the_same_bits(tmp_path):
    Training.create(configured(), tmp_path / 'alone', 2).run()
    Training.create(configured(), tmp_path / 'local', 2, 'local').run()
    assert contents(tmp_path / 'local') == contents(tmp_path / 'alone')


def test_a_cluster_that_does_not_answer_is_one_sentence_and_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(pool, 'CONNECT_S', 1)
    arguments = ['train', '-o', str(tmp_path / 'f'), '--cluster', 'tcp://127.0.0.1:9']
    result = CliRunner().invoke(app, arguments, env={'COLUMNS': '300'})
    assert result.exit_code == 2, result.output
    assert 'got tcp://127.0.0.1:9' in result.output.splitlines()[-1]
    assert 'Traceback' not in result.output
    assert not (tmp_path / 'f').exists()
