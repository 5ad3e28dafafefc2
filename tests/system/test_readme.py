# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The README's commands, run as printed."""

import os
import re
import shlex
import signal
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / 'README.md').read_text()
BLOCKS = [block.strip().splitlines() for block in re.findall(r'```sh\n(.*?)```', README, re.S)]
DEADLINE_S = 50


def test_every_make_target_exists():
    targets = set(re.findall(r'^([a-z-]+):', (ROOT / 'Makefile').read_text(), re.M))
    named = set(re.findall(r'`make ([a-z-]+)`|^make ([a-z-]+)$', README, re.M))
    assert {a or b for a, b in named} <= targets


def test_every_link_and_picture_exists():
    for target in re.findall(r'\]\(([^)#]+)\)', README):
        assert (ROOT / target).exists(), target


def commands(first_word: str) -> list[list[str]]:
    """Return the block that begins with a command, each line split."""
    return next(
        [shlex.split(line) for line in block if not line.startswith('source ')]
        for block in BLOCKS
        if any(line.startswith(first_word) for line in block)
    )


@pytest.mark.timeout(3 * DEADLINE_S)
def test_the_readme_flies(ros_env, tmp_path):
    """One after the other what is to be typed so, side by side what goes in several shells.

    The report takes long and is written by the slow test of docs/reports.md.
    """
    env = {**os.environ, **ros_env}
    log = (tmp_path / 'log.txt').open('w+')

    def start(command: list[str]) -> subprocess.Popen[bytes]:
        return subprocess.Popen(command, cwd=tmp_path, env=env, stdout=log, stderr=log)

    def ends_well(process: subprocess.Popen[bytes]) -> None:
        code = process.wait(DEADLINE_S)
        log.seek(0)
        assert code == 0, (process.args, log.read())

    for command in commands('ros2 run rpo_bringup'):
        if command[:2] != ['rpo', 'report']:
            ends_well(start(command))
    for block in (commands('ros2 run rpo_sim plant'), commands('ros2 run rpo_log recorder')):
        started = {tuple(command[2:4]): start(command) for command in block}
        ends_well(started.pop(('rpo_sim', 'plant')))
        for name, process in started.items():
            if name != ('rpo_log', 'recorder'):
                process.send_signal(signal.SIGINT)
            ends_well(process)
    for command in commands('ros2 run rpo_log replay'):
        ends_well(start(command))
    assert (tmp_path / 'runs/first/report/time_histories.png').exists()
    first, second = (tmp_path / 'runs' / name / 'run.mcap' for name in ('first', 'second'))
    log.close()
    assert first.read_bytes() == second.read_bytes()
