# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes in a ROS namespace of their own, gone when the trial ends."""

from __future__ import annotations

import os
import platform
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from rpo_core import files
from rpo_core.flight import Flight
from rpo_log.reader import flight_of, read_run

PLANT, INJECTOR, FAULTS = (
    f'rpo_sim.{name}_node' for name in ('plant', 'disturbance_injector', 'fault_injector')
)
CONTROLLER, RECORDER = 'rpo_ctrl.fuzzy_controller_node', 'rpo_log.recorder_node'

_STOP_S = 10.0


class TrialError(Exception):
    """A node ended as it should not; says what it said."""


class Fleet:
    """Starts nodes and remembers them.

    folder : for logs, scenarios and what the nodes say; gone at the end
    namespace : of all their topics
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.namespace = f'/trial_{os.getpid()}'
        self.processes: dict[str, subprocess.Popen[bytes]] = {}

    def start(
        self, module: str, name: str = '', remap: Mapping[str, str] | None = None, **parameters: Any
    ) -> str:
        """Start a node of a module; return the name under which it is remembered."""
        name = name or module.split('.')[1].removesuffix('_node')
        rules = {'__ns': self.namespace, '__node': name, **(remap or {})}
        command = [sys.executable, '-m', module, '--ros-args']
        for key, value in rules.items():
            command += ['-r', f'{key}:={value}']
        for key, value in parameters.items():
            shown = str(value).lower() if isinstance(value, bool) else value
            command += ['-p', f'{key}:={shown}']
        with self.said(name).open('wb') as output:
            self.processes[name] = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT
            )
        return name

    def said(self, name: str) -> Path:
        """Return the file of what a node said."""
        return self.folder / f'{name}.txt'

    def scenario(self, shipped: str, **changes: Any) -> str:
        """Write a shipped scenario with some fields changed; return its path."""
        document = files.parse_yaml(files.read_text(files.find('scenario', shipped)))
        path = self.folder / f'{shipped}.yaml'
        path.write_text(yaml.safe_dump({**document, **changes}))
        return str(path)

    def flown(self, run: str) -> tuple[Flight, dict[str, str]]:
        """Wait for the end; return the flight and the values of the last run_status."""
        self.ended()
        log = read_run(self.folder / run)
        return flight_of(log), dict(log.statuses[-1][1].values)

    def ended(self) -> None:
        """Wait for plant and recorder; raise TrialError if they end otherwise than well."""
        for name in ('plant', 'recorder'):
            if self.processes[name].wait() != 0:
                raise TrialError(f'{name}: {self.said(name).read_text()}')

    def stop(self) -> None:
        """End what still runs."""
        for process in self.processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in self.processes.values():
            try:
                process.wait(_STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@contextmanager
def fleet() -> Iterator[Fleet]:
    """Yield a Fleet; end its nodes and remove its folder."""
    with tempfile.TemporaryDirectory(prefix='rpo_trial_') as folder:
        found = Fleet(Path(folder))
        try:
            yield found
        finally:
            found.stop()


def machine() -> str:
    """Return what the trial runs on, in a line."""
    load = os.getloadavg()[0]
    return (
        f'{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}, '
        f'load {load:.1f} at the start'
    )
