# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flights of nodes that are processes, one for all or one for each, and what their log must be."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from node_processes import NodeProcess, NodeProcesses

from rpo_core import files
from rpo_core.chain.flight import Flight
from rpo_log.read.run_log import RunLog, read_run
from rpo_log.verify import verify

INJECTOR = 'rpo_sim disturbance_injector'


def lasting(duration_s: float, folder: Path, name: str = 'approach', **changes: Any) -> str:
    """Write a shipped scenario with another duration; return the file's path.

    changes : other fields, None for what it shall not have
    """
    document = yaml.safe_load(files.shipped('scenario')[name].read_text())
    document |= {'duration_s': duration_s, **changes}
    path = folder / f'{name}_{duration_s:g}_s.yaml'
    path.write_text(yaml.safe_dump({k: v for k, v in document.items() if v is not None}))
    return str(path)


def one_process(ros: NodeProcesses, scenario: str, *options: str) -> Path:
    """Fly with all nodes in one process, without a report; return the run's folder."""
    folder = ros.folder / 'run'
    options = ('--scenario', scenario, '--output', str(folder), '--no-report', *options)
    node = ros.node('rpo_bringup', 'final_approach', *options)
    assert node.wait(600.0) == 0, node.output
    return folder


def processes(
    ros: NodeProcesses,
    scenario: str,
    *others: str,
    controller: str = 'handmade',
    **plant: Any,
) -> Path:
    """Fly with each node in a process of its own; return the run's folder.

    others : package and executable of nodes beside controller, recorder and plant
    """
    controls = ros.node('rpo_ctrl', 'fuzzy_controller', controller=controller)
    nodes = started(ros, ros.folder / 'run', *others, scenario=scenario, **plant)
    flown, recorder = nodes.pop('plant'), nodes.pop('recorder')
    for node in (flown, recorder):
        assert node.wait() == 0, node.output
    for node in (controls, *nodes.values()):
        assert node.stop() == 0, node.output
    return ros.folder / 'run'


def started(ros: NodeProcesses, folder: Path, *others: str, **plant: Any) -> dict[str, NodeProcess]:
    """Start some nodes, a recorder and a plant that waits for it; return them by their names."""
    nodes = {words.split()[1]: ros.node(*words.split()) for words in others}
    nodes['recorder'] = ros.node('rpo_log', 'recorder', output=str(folder))
    nodes['plant'] = ros.node('rpo_sim', 'plant', wait_for_recorder='true', **plant)
    return nodes


def assert_flown(folder: Path, flight: Flight, *stages: str) -> None:
    """Hold a log against a flight of the core, each signal bit for bit, and verify it.

    stages : some that are recomputed
    """
    log = read_run(folder)
    assert log.complete, log.gaps
    np.testing.assert_array_equal(log.states, flight.states)
    np.testing.assert_array_equal(log.forces_n, flight.forces_n)
    for name in flight.signals.keys() & log.values.keys():
        np.testing.assert_array_equal(log.values[name], flight.signals[name], err_msg=name)
    found = verify(folder)
    assert found.exit_code == 0, found.sentence()
    assert set(stages) <= set(found.stages)


def verified(folder: Path) -> RunLog:
    """Verify a run; return its log."""
    found = verify(folder)
    assert found.exit_code == 0, found.sentence()
    return read_run(folder)


def told(log: RunLog) -> list[tuple[str, str, int]]:
    """Return stage, state and tick of each stage_status of a log."""
    events = [event.values for event in log.events if event.signal == 'stage_status']
    return [(event['stage'], event['state'], int(event['tick'])) for event in events]
