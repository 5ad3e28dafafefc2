# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Real nodes as real processes: `ros2 run`, signals, waiting with a deadline, what they said."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

DEADLINE_S = 40.0


class RunningNode:
    """One `ros2 run PACKAGE EXECUTABLE` under test; its output goes to a file."""

    def __init__(self, command: Sequence[str], env: Mapping[str, str], log: Path) -> None:
        self.log = log
        self._file = log.open('wb')
        self.process = subprocess.Popen(
            command,
            env=dict(env),
            stdout=self._file,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
        )

    @property
    def output(self) -> str:
        """What it printed so far, stdout and stderr together."""
        return self.log.read_text(errors='replace')

    def says(self, text: str, deadline_s: float = DEADLINE_S) -> None:
        """Wait until it printed `text`; fail if it ends or the deadline passes before."""
        end = time.monotonic() + deadline_s
        while text not in self.output:
            ended = self.process.poll() is not None and text not in self.output
            if ended or time.monotonic() > end:
                raise AssertionError(f'{text!r} was not said in:\n{self.output}')
            time.sleep(0.02)

    def stop(self, number: int = signal.SIGINT) -> int:
        """Send a signal and return the exit code."""
        if self.process.poll() is None:
            self.process.send_signal(number)
        return self.wait()

    def wait(self, deadline_s: float = DEADLINE_S) -> int:
        """Return the exit code; fail if it does not end in time."""
        try:
            return self.process.wait(deadline_s)
        except subprocess.TimeoutExpired:
            raise AssertionError(f'still running after {deadline_s} s:\n{self.output}') from None

    def discard(self) -> None:
        """Kill it if it still runs."""
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self._file.close()


class Flight:
    """Starts nodes in one ROS domain; all are gone at the end.

    prefix : words before the command of the next nodes, such as `ip netns exec NAME`
    """

    def __init__(self, env: Mapping[str, str], folder: Path) -> None:
        self.env = dict(env)
        self.folder = folder
        self.nodes: list[RunningNode] = []
        self.prefix: list[str] = []

    def node(self, package: str, executable: str, *args: str, **parameters: object) -> RunningNode:
        """Start a node; keyword arguments are ROS parameters."""
        ros = [part for key, value in parameters.items() for part in ('-p', f'{key}:={value}')]
        command = [
            *self.prefix,
            'ros2',
            'run',
            package,
            executable,
            *args,
            *(['--ros-args', *ros] if ros else []),
        ]
        log = self.folder / f'{len(self.nodes)}_{executable}.txt'
        self.nodes.append(RunningNode(command, self.env, log))
        return self.nodes[-1]


@contextmanager
def flight(env: Mapping[str, str], folder: Path) -> Iterator[Flight]:
    """Yield a Flight and kill what is left of it."""
    started = Flight({**os.environ, **env}, folder)
    try:
        yield started
    finally:
        for node in started.nodes:
            node.discard()
