# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The common part of the trials: nodes, scenarios, and the results of a run."""

from __future__ import annotations

import os
import platform
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from rpo_core import files
from rpo_core.chain.flight import Flight
from rpo_log.read.run_log import flight_of, read_run
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
