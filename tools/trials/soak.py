# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A long run in lockstep: samples of memory, open files and speed of every node."""

from __future__ import annotations

import os
import time
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray

from rpo_ros import names, qos
from rpo_ros.running import keep_to_this_machine
from tools.node_processes import NodeProcess, NodeProcesses
from tools.trials import links

_NODES = ('plant', 'fuzzy_controller', 'disturbance_injector', 'recorder')
_PAGE = os.sysconf('SC_PAGE_SIZE')
_WARM_SHARE = 0.1
"""Share of the run without a verdict: caches fill, allocators settle."""
_FILE_S = 3600.0
"""Simulated time per file of the log: the index of an MCAP file stays in memory until it closes."""

MOST_GROWTH_MB = 5.0
"""Per node and run, after the warm-up."""
MOST_SLOWER = 1.5
"""Median latency of the last quarter over that of the first, after the warm-up."""


Sample = tuple[int, float, list[tuple[float, int]]]
"""Tick, latency [ms], and of each node memory [MB] and open files."""


class _Health:
    """The last health of the plant on /diagnostics."""

    def __init__(self, namespace: str) -> None:
        keep_to_this_machine()
        rclpy.init()
        self._node = rclpy.create_node('soak', namespace=namespace)
        self._name = f'{namespace.lstrip("/")}/plant: health'
        self.values: dict[str, str] = {}
        self.running = False
        self._node.create_subscription(
            DiagnosticArray, names.DIAGNOSTICS, self._on_array, qos.DIAGNOSTICS
        )

    def _on_array(self, array: DiagnosticArray) -> None:
        for status in array.status:
            if status.name == self._name:
                self.values = {pair.key: pair.value for pair in status.values}
                self.running = status.message == 'running'

    def wait(self, seconds: float) -> None:
        """Listen for a time."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(self._node, timeout_sec=left)

    def close(self) -> None:
        """Leave ROS."""
        self._node.destroy_node()
        rclpy.try_shutdown()


def _sample(node: NodeProcess) -> tuple[float, int]:
    """Return resident memory [MB] and open files of a node."""
    process = Path('/proc', str(node.process.pid))
    pages = int((process / 'statm').read_text().split()[1])
    return pages * _PAGE / 1e6, len(os.listdir(process / 'fd'))


def _start(nodes: NodeProcesses, ticks: int) -> list[NodeProcess]:
    """Return the processes of _NODES."""
    path = links.scenario(nodes.folder, 'paper_test', duration_s=ticks * 0.1)
    return [
        nodes.node('rpo_sim', 'plant', scenario=path, wait_for_recorder=True, publish_clock=False),
        nodes.node('rpo_ctrl', 'fuzzy_controller'),
        nodes.node('rpo_sim', 'disturbance_injector', scenario=path),
        nodes.node('rpo_log', 'recorder', output=nodes.folder / 'run', split_s=_FILE_S),
    ]


def _fly(nodes: NodeProcesses, ticks: int, every_s: float) -> list[Sample]:
    started = _start(nodes, ticks)
    plant, *_, recorder = started
    health = _Health(nodes.namespace)
    samples = []
    try:
        while plant.running:
            health.wait(every_s)
            if not health.running:
                continue
            tick, sample = int(health.values['tick']), [_sample(node) for node in started]
            if tick == ticks or not plant.running:
                break
            latency_ms = float(health.values['recent_latency_p50_ms'])
            samples.append((tick, latency_ms, sample))
            memory = ' | '.join(f'{mb:.1f} MB, {files}' for mb, files in sample)
            rate = float(health.values['tick_rate_hz'])
            print(f'| {tick} | {rate:.0f} /s | {latency_ms:.2f} ms | {memory} |', flush=True)
    finally:
        health.close()
    links.ended(plant, recorder)
    return samples


def _judge(samples: list[Sample], ticks: int) -> list[str]:
    """Return the reasons of a failure, in words."""
    warm = [sample for sample in samples if sample[0] > _WARM_SHARE * ticks]
    if len(warm) < 4:
        return ['too short: fewer than 4 samples after the warm-up']
    found = []
    for index, name in enumerate(_NODES):
        grown = warm[-1][2][index][0] - warm[0][2][index][0]
        files = warm[-1][2][index][1] - warm[0][2][index][1]
        print(f'{name}: {grown:+.2f} MB, {files:+d} files after the warm-up')
        if grown > MOST_GROWTH_MB or files > 0:
            found.append(f'{name} has grown')
    quarter = max(1, len(warm) // 4)
    first, last = (sorted(s[1] for s in part) for part in (warm[:quarter], warm[-quarter:]))
    begin, end = first[len(first) // 2], last[len(last) // 2]
    print(f'latency: {begin:.2f} ms in the first quarter, {end:.2f} ms in the last')
    if end > MOST_SLOWER * begin:
        found.append('the loop has become slower')
    return found


def run(ticks: int, every_s: float) -> int:
    """Run some ticks as four processes; print samples and verdict; return the exit code."""
    begun = time.monotonic()
    print(links.machine())
    heads = ' | '.join(f'{name}: memory, files' for name in _NODES)
    print(f'| tick | rate | latency | {heads} |')
    print('|' + '---|' * (3 + len(_NODES)))
    with links.trial_nodes() as nodes:
        samples = _fly(nodes, ticks, every_s)
        grown = _judge(samples, ticks)
    print(f'{ticks} ticks in {time.monotonic() - begun:.0f} s: {"; ".join(grown) or "no growth"}')
    return int(bool(grown))
