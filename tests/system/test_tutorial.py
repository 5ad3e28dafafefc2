# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The tutorial's commands that need nodes, run as printed."""

import os

import pytest
from doc_blocks import DOCS, blocks, folder_like_the_checkout, run_block

DEADLINE_S = 50.0
BLOCKS = list(blocks(DOCS / 'tutorial.md'))

pytestmark = pytest.mark.timeout(3 * DEADLINE_S)


@pytest.fixture
def folder(tmp_path):
    return folder_like_the_checkout(tmp_path / 'checkout')


@pytest.fixture
def typed(ros_env, folder):
    """Return a function that types the first block with a command."""

    def typed(command):
        block = next(b for b in BLOCKS if any(line.startswith(command) for line in b.lines))
        run_block(block, folder, {**os.environ, **ros_env}, DEADLINE_S)

    return typed


@pytest.mark.every_landing
def test_the_tutorial_flies(typed, folder):
    typed('ros2 run rpo_bringup')
    assert (folder / 'runs/first/report/time_histories.png').exists()


@pytest.mark.every_landing
def test_the_tutorial_flies_in_two_shells(typed):
    typed('ros2 run rpo_sim plant')


@pytest.mark.slow
def test_the_tutorial_records_and_replays(typed, folder):
    typed('ros2 run rpo_bringup')
    typed('ros2 run rpo_log recorder')
    typed('ros2 run rpo_log replay')
    first, second = (folder / 'runs' / name / 'run.mcap' for name in ('first', 'second'))
    assert first.read_bytes() == second.read_bytes()
