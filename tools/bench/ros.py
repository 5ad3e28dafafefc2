# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""P4 and P5, the ROS loop: real nodes, compared with two bare rclpy processes.

P4 flies the paper's test; P5 a scenario with navigation, guidance and assurance; B7 one whose
chaser turns. The peer runs before and after each flight, which is compared with the mean of both:
the same peer, on the same machine, differs by a factor of two from one start to the next, and a
machine that becomes faster or slower meets both alike.

Each run has a ROS domain of its own: a node that one left behind does not reach the next. The time
is from `flying` to `finished` in the log lines of the plant, without start and discovery.
"""

from __future__ import annotations

import re
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import NamedTuple

from rpo_core.files.scenario import load_scenario
from rpo_core.files.validation import InputError
from tools.node_processes import (
    NodeProcess,
    NodeProcessError,
    NodeProcesses,
    node_processes,
    own_domain,
)

SCENARIO, FULL, TURNING = 'paper_test', 'docking_leo', 'tumbling_docking'
ANSWERING = ('rpo_ctrl', 'fuzzy_controller'), ('rpo_sim', 'disturbance_injector')
FURTHER = ('rpo_nav', 'navigation'), ('rpo_guidance', 'guidance'), ('rpo_safety', 'assurance')
BASILISK = sys.executable, '-m', 'tools.basilisk_plant'

TURNS = {'P4': 7, 'P5': 7}
LEAST_TURNS = 3
"""Flights whose medians are taken; more of those that are judged by their ratio to the peer."""
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


@contextmanager
def _nodes() -> Iterator[NodeProcesses]:
    """Start nodes in a domain and a folder of their own; raises InputError if one does not work."""
    try:
        with tempfile.TemporaryDirectory() as folder, own_domain() as domain:
            environment = {'ROS_DOMAIN_ID': str(domain), 'ROS_LOG_DIR': folder}
            environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
            with node_processes(environment, Path(folder)) as started:
                yield started
                for node in started.nodes:
                    node.stop(signal.SIGTERM)
    except NodeProcessError as error:
        raise InputError(f'`rpo bench ros` starts ROS nodes: {error}') from None


def _output(node: NodeProcess) -> str:
    """Return what a node prints until it ends; raises InputError if it fails."""
    code = node.wait(_DEADLINE_S)
    if code:
        raise InputError(f'a node ended with {code}: {node.output[-300:]!r}')
    return node.output


def _loop(output: str, name: str = SCENARIO) -> Loop:
    times = {phase: float(moment) for moment, phase in _LINE.findall(output)}
    if set(times) != {'flying', 'finished'}:
        raise InputError(f'no times of the flight in the output of the plant: {output[-300:]!r}')
    scenario = load_scenario(name)
    return Loop(times['finished'] - times['flying'], scenario.ticks, scenario.duration_s)


def one_process() -> Loop:
    """Run plant, controller, disturbance and recorder in one process."""
    with _nodes() as nodes:
        options = ('--scenario', SCENARIO, '--no-report', '--output', f'{nodes.folder}/run')
        return _loop(_output(nodes.node('rpo_bringup', 'final_approach', *options)))


def _processes(
    scenario: str, others: Sequence[tuple[str, str]] = ANSWERING, plant: Sequence[str] = ()
) -> Loop:
    """Run plant, recorder and other nodes as processes.

    plant : command of another plant than ours
    """
    with _nodes() as nodes:
        for name in others:
            nodes.node(*name)
        nodes.node('rpo_log', 'recorder', output=f'{nodes.folder}/run')
        flown = nodes.node(
            'rpo_sim', 'plant', command=plant, scenario=scenario, wait_for_recorder=True
        )
        return _loop(_output(flown), scenario)


def ping_pong() -> float:
    """Return round trips per second of two bare rclpy processes."""
    with _nodes() as nodes:
        return float(_output(nodes.node('rpo_bringup', 'ping_pong')).split()[0])


def in_turns(fly: Callable[[], Loop], turns: int = LEAST_TURNS) -> tuple[Loop, float, list[float]]:
    """Run the peer, a flight, the peer, and so on; `turns` is odd.

    Returns the medians of the flights and of the peer's round trips per second, and all ratios of a
    flight to the mean of the peers before and after it, the least first.
    """
    trips, loops = [ping_pong()], []
    for _ in range(turns):
        loops.append(fly())
        trips.append(ping_pong())
    rates = [2.0 * loop.ticks_per_s for loop in loops]
    ratios = sorted(rate / sum(two) for rate, two in zip(rates, pairwise(trips), strict=True))
    loop = sorted(loops, key=lambda loop: loop.wall_s)[turns // 2]
    return loop, median(trips), ratios


four_processes = partial(_processes, SCENARIO)
seven_processes = partial(_processes, FULL, (*ANSWERING, *FURTHER))
TURNED = *ANSWERING, *FURTHER, ('rpo_ctrl', 'attitude_controller')
eight_processes = partial(_processes, TURNING, TURNED)
one_computer = partial(_processes, TURNING, [('rpo_bringup', 'flight_software'), ANSWERING[1]])
basilisk_plant = partial(_processes, SCENARIO, plant=BASILISK)
PEER, REAL_TIME = 'the peer', 'real time'
LOOPS: tuple[tuple[str, str, Callable[[], Loop], float, str], ...] = (
    ('P4', 'ROS loop, as 4 processes', four_processes, 0.6, PEER),
    ('P4', 'ROS loop, in one process', one_process, 1.2, PEER),
    ('P5', 'full chain, as 7 processes', seven_processes, 0.15, PEER),
    ('B7', 'six degrees of freedom, as 8 processes', eight_processes, 40.0, REAL_TIME),
    ('B7', 'six degrees of freedom, flight software in one process', one_computer, 40.0, REAL_TIME),
    ('–', 'Basilisk as the plant, 4 processes', basilisk_plant, 50.0, REAL_TIME),
)[: 6 if find_spec('Basilisk') else 5]
"""Target, name, flight, how fast it must be at least, and compared with what.

Machines differ by a factor of three; the peer meets the same one.
"""
