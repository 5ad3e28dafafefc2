# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Trials of links: latency and jitter at some rates; faulty messages."""

from __future__ import annotations

import os
import platform
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from rpo_core import files
from rpo_core.chain.flight import Flight
from rpo_core.files import DEFAULT_CONTROLLER
from rpo_core.judge import metrics
from rpo_core.judge.verdicts import verdicts
from rpo_mcap.read.run_log import flight_of, read_run
from tools.node_processes import NodeProcess, NodeProcessError, NodeProcesses, node_processes


@contextmanager
def trial_nodes() -> Iterator[NodeProcesses]:
    """Yield a NodeProcesses in a namespace and a folder of its own, both removed at the end."""
    with (
        tempfile.TemporaryDirectory(prefix='rpo_trial_') as folder,
        node_processes({}, Path(folder), f'/trial_{os.getpid()}') as nodes,
    ):
        yield nodes


def scenario(folder: Path, shipped: str, **changes: Any) -> str:
    """Write a shipped scenario with some fields changed; return its path."""
    document = files.parse_yaml(files.read_text(files.find('scenario', shipped)))
    path = folder / f'{shipped}.yaml'
    path.write_text(yaml.safe_dump({**document, **changes}))
    return str(path)


def free_running_plant(nodes: NodeProcesses, path: str, **parameters: Any) -> NodeProcess:
    """Start a plant in free running that waits for the recorder."""
    free = {'mode': 'free_running', 'wait_for_recorder': True, 'publish_clock': False}
    return nodes.node('rpo_sim', 'plant', scenario=path, **free, **parameters)


def ended(*nodes: NodeProcess) -> None:
    """Wait for nodes; raise NodeProcessError if one fails."""
    for node in nodes:
        if node.wait(None) != 0:
            raise NodeProcessError(node.output)


def flight_and_status(run: Path) -> tuple[Flight, dict[str, str]]:
    """Return the flight of a log, and the values of its last run_status."""
    log = read_run(run)
    return flight_of(log), dict(log.statuses[-1][1].values)


def machine() -> str:
    """Return the machine of the trial, in a line."""
    load = os.getloadavg()[0]
    return (
        f'{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}, '
        f'load {load:.1f} at the start'
    )


RATES_HZ = (10.0, 50.0, 100.0)

_COLUMNS = ('latency_p50', 'latency_p95', 'latency_max', 'tick_lateness_p95', 'tick_lateness_max')
_COUNTS = ('overruns', 'held_ticks', 'stale_ticks')


def _latency_row(rate_hz: float, seconds: float) -> str:
    with trial_nodes() as nodes:
        path = scenario(nodes.folder, 'approach', dt_s=1.0 / rate_hz, duration_s=seconds)
        nodes.node('rpo_ctrl', 'fuzzy_controller')
        recorder = nodes.node('rpo_log', 'recorder', output=nodes.folder / 'run')
        plant = free_running_plant(nodes, path)
        ended(plant, recorder)
        _, values = flight_and_status(nodes.folder / 'run')
    cells = [f'{rate_hz:g} Hz', values['tick']]
    cells += [f'{float(values[f"{name}_ms"]):.2f} ms' for name in _COLUMNS]
    cells += [values[name] for name in _COUNTS]
    return f'| {" | ".join(cells)} |'


def run_latency(rates_hz: list[float], seconds: float) -> None:
    """Run at each rate for some seconds of real time, and print a row of the table."""
    print(machine())
    print(
        '| rate | ticks | latency p50 | p95 | max | tick late p95 | max | overruns | held | zero |'
    )
    print('|---|---|---|---|---|---|---|---|---|---|')
    for rate_hz in rates_hz:
        print(_latency_row(rate_hz, seconds), flush=True)


KINDS = ('drop', 'repeat', 'delay', 'reorder')


def _losses_row(rate: float, kinds: Sequence[str], factor: float, seed: int, stale: int) -> str:
    share: dict[str, Any] = {**dict.fromkeys(kinds, rate), 'seed': seed}
    raw, faulty = 'control_force_raw', 'relative_state_faulty'
    with trial_nodes() as nodes:
        path = scenario(nodes.folder, 'paper_test')
        nodes.node('rpo_sim', 'disturbance_injector', scenario=path)
        remap = {'relative_state': faulty, 'control_force': raw}
        nodes.node('rpo_ctrl', 'fuzzy_controller', remap=remap, controller=DEFAULT_CONTROLLER)
        name = {'__node': 'faults_of_forces'}
        nodes.node('rpo_sim', 'fault_injector', remap=name, scenario=path, **share)
        name = {'__node': 'faults_of_states'}
        share |= {'from_topic': 'relative_state', 'to_topic': faulty, 'seed': seed + 1}
        nodes.node('rpo_sim', 'fault_injector', remap=name, scenario=path, **share)
        recorder = nodes.node('rpo_log', 'recorder', output=nodes.folder / 'run')
        pace = {'real_time_factor': factor, 'stale_after_ticks': stale}
        plant = free_running_plant(nodes, path, **pace)
        ended(plant, recorder)
        flight, values = flight_and_status(nodes.folder / 'run')
    found = {verdict.key: verdict for verdict in verdicts(flight)}
    position, velocity = found['hold_error_per_axis_m'], found['hold_speed_per_axis_m_s']
    ticks = flight.scenario.ticks
    cells = (
        f'{rate:.0%}', f'{int(values["held_ticks"]) / ticks:.0%}',
        f'{int(values["stale_ticks"]) / ticks:.1%}', f'{position.value:.3f} m',
        f'{velocity.value:.4f} m/s', f'{metrics.of_flight(flight).energy_n2s:.2f} N²s',
        'yes' if position.holds and velocity.holds else 'NO',
    )  # fmt: skip
    return f'| {" | ".join(cells)} |'


def run_losses(rates: list[float], kinds: list[str], factor: float, seed: int, stale: int) -> None:
    """Run the paper's test at each rate, the same for all kinds, in both directions; print a table.

    It docks if position and velocity in the last 200 s are within the limits of the paper.
    """
    print(f'{", ".join(kinds)}, in both directions; {factor:g} x real time; {machine()}')
    print(
        '| rate of each | ticks with an older force | with none | position | velocity | J | docks |'
    )
    print('|---|---|---|---|---|---|---|')
    for rate in rates:
        print(_losses_row(rate, kinds, factor, seed, stale), flush=True)
