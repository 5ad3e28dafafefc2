# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The README's commands, run as printed."""

import os
import re
import shlex
import signal
import subprocess
from contextlib import suppress
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / 'README.md').read_text()
BLOCKS = [block.strip().splitlines() for block in re.findall(r'```sh\n(.*?)```', README, re.S)]
DEADLINE_S = 50


def commands(first_word: str) -> list[list[str]]:
    """Return the block that begins with a command, each line split."""
    return next(
        [shlex.split(line) for line in block if not line.startswith('source ')]
        for block in BLOCKS
        if any(line.startswith(first_word) for line in block)
    )


class Shells:
    """What is typed one after the other, and what goes into several shells."""

    def __init__(self, folder: Path, env: dict[str, str]) -> None:
        self.folder, self.env = folder, {**os.environ, **env}
        self.log = folder / 'log.txt'
        self.started: list[subprocess.Popen[bytes]] = []

    def start(self, command: list[str]) -> subprocess.Popen[bytes]:
        """Start a command in a process group of its own, as a shell with job control does."""
        with self.log.open('a') as log:
            process = subprocess.Popen(
                command,
                cwd=self.folder,
                env=self.env,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self.started.append(process)
        return process

    def ends_well(self, process: subprocess.Popen[bytes]) -> None:
        assert process.wait(DEADLINE_S) == 0, (process.args, self.log.read_text())

    def one_after_the_other(self, first_word: str) -> None:
        """Type a block; the report takes long and is written by the slow test of its page."""
        for command in commands(first_word):
            if command[:2] != ['rpo', 'report']:
                self.ends_well(self.start(command))

    def side_by_side(self, first_word: str) -> None:
        """Type a block into several shells; the plant ends by itself, the recorder after it."""
        started = {tuple(command[2:4]): self.start(command) for command in commands(first_word)}
        self.ends_well(started.pop(('rpo_sim', 'plant')))
        for name, process in started.items():
            if name != ('rpo_log', 'recorder'):
                os.killpg(process.pid, signal.SIGINT)  # Ctrl-C
            self.ends_well(process)

    def close(self) -> None:
        """Kill what is left, the nodes behind a stock `ros2 run` too."""
        for process in self.started:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.fixture
def shells(ros_env, tmp_path):
    opened = Shells(tmp_path, ros_env)
    yield opened
    opened.close()


@pytest.mark.every_landing
@pytest.mark.timeout(3 * DEADLINE_S)
def test_the_readme_flies(shells):
    shells.one_after_the_other('ros2 run rpo_bringup')
    assert (shells.folder / 'runs/first/report/time_histories.png').exists()


@pytest.mark.every_landing
@pytest.mark.timeout(3 * DEADLINE_S)
def test_the_readme_flies_in_two_shells(shells):
    shells.side_by_side('ros2 run rpo_sim plant')


@pytest.mark.slow
@pytest.mark.timeout(3 * DEADLINE_S)
def test_the_readme_records_and_replays(shells):
    shells.one_after_the_other('ros2 run rpo_bringup')
    shells.side_by_side('ros2 run rpo_log recorder')
    shells.one_after_the_other('ros2 run rpo_log replay')
    first, second = (shells.folder / 'runs' / name / 'run.mcap' for name in ('first', 'second'))
    assert first.read_bytes() == second.read_bytes()
