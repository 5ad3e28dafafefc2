# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo simulate --output`: a run folder that every command takes, without ROS."""

from __future__ import annotations

import itertools

import pytest
from typer.testing import CliRunner

from rpo_cli.cli import app
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import overrides
from rpo_log.verify import verify
from rpo_mcap.read.run_log import read_run


def rpo(*words: object):
    return CliRunner().invoke(app, [*map(str, words)], env={'COLUMNS': '200'})


@pytest.mark.parametrize(
    'words',
    [
        ('quick', '--controller', 'pace'),
        ('paper_test_measured', '--set', 'duration_s=40.0'),
        ('world_leo', '--set', 'duration_s=20.0', '--set', 'max_force_n=0.05'),
    ],
    ids=lambda words: words[0],
)
def test_a_flight_without_ros_leaves_a_log_that_verifies(words, tmp_path):
    run = tmp_path / 'run'
    said = rpo('simulate', *words, '--output', run, '--no-fail')
    assert said.exit_code == 0 and f'{run}: ' in said.output, said.output
    verified = verify(run)
    assert verified.exit_code == 0, verified.sentence()
    log = read_run(run)
    assert log.complete and log.outcome == 'finished'
    name = words[words.index('--controller') + 1] if '--controller' in words else 'allround'
    changes = [change for flag, change in itertools.pairwise(words) if flag == '--set']
    flown = fly(overrides.load(words[0], changes), load_controller(name))
    assert (log.states == flown.states).all() and (log.forces_n == flown.forces_n).all()


def test_every_command_takes_it(tmp_path):
    run = tmp_path / 'run'
    assert rpo('simulate', 'quick', '-o', run).exit_code == 0
    assert 'The logged force is the same' in rpo('explain', run, '--at', 2.5).output
    assert 'ticks 0 to 50 of 50' in rpo('log', 'info', run).output
    seen = rpo('watch', run, '--rate', 0).output.splitlines()
    assert len(seen) == 2 and seen[0].split()[0] == '0.0' and 'reached the last tick' in seen[1]
    refused = rpo('simulate', 'quick', '-o', run)
    assert refused.exit_code == 2 and 'holds a log already' in refused.stderr
    assert rpo('simulate', 'quick', '-o', run, '--overwrite').exit_code == 0
    assert verify(run).exit_code == 0
