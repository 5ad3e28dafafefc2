# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""P4, the ROS loop: real nodes with the paper's test, compared with two bare rclpy processes.

`ros2 run` starts each in a ROS domain of its own. The time is from `flying` to `finished` in the
log lines of the plant, without start and discovery.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from rpo_core.scenario import load_scenario
from rpo_core.validation import InputError

SCENARIO = 'paper_test'
DOMAIN = '98'
"""Not the default 0, and not the first domains of the tests."""

_DEADLINE_S = 300.0
_LINE = re.compile(r'\[(\d+\.\d+)\] \[plant\]: (flying|finished)')


class Loop(NamedTuple):
    """A flight through the nodes: wall time, ticks, and seconds simulated."""

    wall_s: float
    ticks: int
    duration_s: float

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per second."""
        return self.duration_s / self.wall_s

    @property
    def ticks_per_s(self) -> float:
        """Ticks per second of wall time."""
        return self.ticks / self.wall_s


def _environment(folder: str) -> dict[str, str]:
    if shutil.which('ros2') is None:
        raise InputError('`rpo bench ros` starts ROS nodes: `source ros_ws/env.bash` first')
    return {
        **os.environ,
        'ROS_DOMAIN_ID': DOMAIN,
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_LOG_DIR': folder,
    }


@contextmanager
def _started(commands: Sequence[Sequence[str]], folder: str) -> Iterator[None]:
    """Run nodes in the background, and end them."""
    environment, quiet = _environment(folder), subprocess.DEVNULL
    nodes = [
        subprocess.Popen(
            ['ros2', 'run', *command],
            env=environment,
            stdout=quiet,
            stderr=quiet,
            start_new_session=True,
        )
        for command in commands
    ]
    try:
        yield
    finally:
        for node in nodes:
            os.killpg(node.pid, signal.SIGTERM)  # a stock `ros2 run` passes no signal on
        for node in nodes:
            node.wait()


def _output(command: Sequence[str], folder: str) -> str:
    """Return the output of a command; raises InputError if it fails."""
    done = subprocess.run(
        ['ros2', 'run', *command],
        env=_environment(folder),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=_DEADLINE_S,
    )
    if done.returncode:
        lines = [x for x in done.stdout.splitlines() if x and not x.startswith('[ros2run]')]
        last = lines[-1] if lines else 'nothing'
        raise InputError(f'`ros2 run {" ".join(command)}` ended with {done.returncode}: {last}')
    return done.stdout


def _loop(output: str) -> Loop:
    times = {phase: float(moment) for moment, phase in _LINE.findall(output)}
    if set(times) != {'flying', 'finished'}:
        raise InputError(f'no times of the flight in the output of the plant: {output[-300:]!r}')
    scenario = load_scenario(SCENARIO)
    return Loop(times['finished'] - times['flying'], scenario.ticks, scenario.duration_s)


def one_process() -> Loop:
    """Run plant, controller, disturbance and recorder in one process."""
    with tempfile.TemporaryDirectory() as folder:
        output = str(Path(folder) / 'run')
        command = ['rpo_bringup', 'final_approach', '--scenario', SCENARIO, '--no-report']
        return _loop(_output([*command, '--output', output], folder))


def four_processes() -> Loop:
    """Run plant, controller, disturbance and recorder as four processes."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = ['--ros-args', '-p', f'scenario:={SCENARIO}']
        output = ['--ros-args', '-p', f'output:={folder}/run']
        others = [
            ['rpo_ctrl', 'fuzzy_controller'],
            ['rpo_sim', 'disturbance_injector', *scenario],
            ['rpo_log', 'recorder', *output],
        ]
        with _started(others, folder):
            plant = ['rpo_sim', 'plant', *scenario, '-p', 'wait_for_recorder:=true']
            return _loop(_output(plant, folder))


def ping_pong() -> float:
    """Return round trips per second of two bare rclpy processes."""
    with tempfile.TemporaryDirectory() as folder:
        return float(_output(['rpo_bringup', 'ping_pong'], folder).split()[0])
