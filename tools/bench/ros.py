# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""P4 and P5, the ROS loop: real nodes, compared with two bare rclpy processes.

P4 flies the paper's test; P5 a scenario with navigation, guidance and assurance. Flights and peer
take turns, so that other work on the machine meets both.

`ros2 run` starts each in a ROS domain of its own. The time is from `flying` to `finished` in the
log lines of the plant, without start and discovery.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from rpo_core.files.scenario import load_scenario
from rpo_core.files.validation import InputError

SCENARIO, FULL = 'paper_test', 'docking_leo'
PLANT = ('ros2', 'run', 'rpo_sim', 'plant')
DOMAIN = '98'
"""Not the default 0, and not the first domains of the tests."""

TURNS = 3
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
    options: dict[str, Any] = {'env': environment, 'stdout': quiet, 'stderr': quiet}
    nodes = [
        subprocess.Popen(['ros2', 'run', *command], **options, start_new_session=True)
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
        command,
        env=_environment(folder),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=_DEADLINE_S,
    )
    if done.returncode:
        lines = [x for x in done.stdout.splitlines() if x and not x.startswith('[ros2run]')]
        last = lines[-1] if lines else 'nothing'
        raise InputError(f'`{" ".join(command)}` ended with {done.returncode}: {last}')
    return done.stdout


def _loop(output: str, name: str = SCENARIO) -> Loop:
    times = {phase: float(moment) for moment, phase in _LINE.findall(output)}
    if set(times) != {'flying', 'finished'}:
        raise InputError(f'no times of the flight in the output of the plant: {output[-300:]!r}')
    scenario = load_scenario(name)
    return Loop(times['finished'] - times['flying'], scenario.ticks, scenario.duration_s)


def one_process() -> Loop:
    """Run plant, controller, disturbance and recorder in one process."""
    with tempfile.TemporaryDirectory() as folder:
        output = str(Path(folder) / 'run')
        command = ['ros2', 'run', 'rpo_bringup', 'final_approach', '--scenario', SCENARIO]
        return _loop(_output([*command, '--no-report', '--output', output], folder))


def _processes(scenario: str, *others: Sequence[str], plant: Sequence[str] = PLANT) -> Loop:
    """Run plant, controller, disturbance, recorder and other nodes as processes."""
    with tempfile.TemporaryDirectory() as folder:
        nodes = [
            ['rpo_ctrl', 'fuzzy_controller'],
            ['rpo_sim', 'disturbance_injector'],
            ['rpo_log', 'recorder', '--ros-args', '-p', f'output:={folder}/run'],
            *others,
        ]
        with _started(nodes, folder):
            options = ['-p', f'scenario:={scenario}', '-p', 'wait_for_recorder:=true']
            return _loop(_output([*plant, '--ros-args', *options], folder), scenario)


def four_processes() -> Loop:
    """Run plant, controller, disturbance and recorder as four processes."""
    return _processes(SCENARIO)


def basilisk_plant() -> Loop:
    """Run the four processes, the plant with Basilisk as its dynamics."""
    return _processes(SCENARIO, plant=(sys.executable, '-m', 'tools.basilisk_plant'))


def seven_processes() -> Loop:
    """Run the full chain: also navigation, guidance and assurance."""
    return _processes(
        FULL, ['rpo_nav', 'navigation'], ['rpo_guidance', 'guidance'], ['rpo_safety', 'assurance']
    )


def ping_pong() -> float:
    """Return round trips per second of two bare rclpy processes."""
    with tempfile.TemporaryDirectory() as folder:
        return float(_output(['ros2', 'run', 'rpo_bringup', 'ping_pong'], folder).split()[0])


class Turns(NamedTuple):
    """Medians of flights and of the peer, and the median of the ratios of neighbours in time."""

    loop: Loop
    trips_per_s: float
    ratio: float


def in_turns(fly: Callable[[], Loop], turns: int = TURNS) -> Turns:
    """Run the peer and a flight in turns."""
    pairs = [(ping_pong(), fly()) for _ in range(turns)]
    trips, loops = zip(*pairs, strict=True)
    loop = sorted(loops, key=lambda loop: loop.wall_s)[turns // 2]
    return Turns(loop, median(trips), median(loop.ticks_per_s / rate for rate, loop in pairs))


LOOPS: tuple[tuple[str, str, Callable[[], Loop], float], ...] = (
    ('P4', 'ROS loop, as 4 processes', four_processes, 200.0),
    ('P4', 'ROS loop, in one process', one_process, 400.0),
    ('P5', 'full chain, as 7 processes', seven_processes, 50.0),
    ('–', 'Basilisk as the plant, 4 processes', basilisk_plant, 50.0),
)[: 4 if find_spec('Basilisk') else 3]
"""Target, name, flight, and the least real-time factor."""
