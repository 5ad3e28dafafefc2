# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes: start them, wait for their output, signal them; none is left at the end.

The executable is found as `ros2 run` finds it, and started directly, in a process group of its own:
a stock `ros2 run` in between would not pass signals on.
"""

from __future__ import annotations

import fcntl
import os
import random
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

DEADLINE_S = 240.0
"""A busy machine is no failure."""

DOMAINS = range(1, 102)
"""0 is everybody's default; above 101 the ports are not safe on Linux."""


class NodeProcessError(Exception):
    """A node does not start, does not end or does not print a text; holds its output."""


def executable(package: str, name: str, ament_prefix_path: str) -> Path:
    """Return the executable of a package; raises NodeProcessError if there is none."""
    for prefix in filter(None, ament_prefix_path.split(os.pathsep)):
        path = Path(prefix, 'lib', package, name)
        if os.access(path, os.X_OK):
            return path
    raise NodeProcessError(
        f'{package} {name} is not on AMENT_PREFIX_PATH: `source ros_ws/env.bash` first'
    )


def arguments(rules: Mapping[str, str], parameters: Mapping[str, object]) -> list[str]:
    """Return the words of a command line that remap names and set parameters."""
    ros = [part for key, value in rules.items() for part in ('-r', f'{key}:={value}')]
    for key, value in parameters.items():
        shown = str(value).lower() if isinstance(value, bool) else value
        ros += ['-p', f'{key}:={shown}']
    return ['--ros-args', *ros] if ros else []


class NodeProcess:
    """One executable of a package; its output goes to the file `log`."""

    def __init__(self, command: Sequence[str], env: Mapping[str, str], log: Path) -> None:
        self.log = log
        with log.open('wb') as output:
            self.process = subprocess.Popen(
                command,
                env=dict(env),
                stdout=output,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )

    @property
    def output(self) -> str:
        """Its output so far, stdout and stderr together."""
        return self.log.read_text(errors='replace')

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None

    def says(self, text: str, deadline_s: float = DEADLINE_S) -> None:
        """Wait until it printed `text`; raise NodeProcessError if it ends or takes too long."""
        end = time.monotonic() + deadline_s
        while text not in self.output:
            ended = not self.running and text not in self.output
            if ended or time.monotonic() > end:
                raise NodeProcessError(f'{text!r} is missing in the output:\n{self.output}')
            time.sleep(0.02)

    def send(self, number: int) -> None:
        """Send a signal to the node and all processes that it started."""
        if self.running:
            os.killpg(self.process.pid, number)

    def stop(self, number: int = signal.SIGINT) -> int:
        """Send a signal and return the exit code."""
        self.send(number)
        return self.wait()

    def wait(self, deadline_s: float | None = DEADLINE_S) -> int:
        """Return the exit code; raise NodeProcessError if it does not end in time."""
        try:
            return self.process.wait(deadline_s)
        except subprocess.TimeoutExpired:
            text = f'still running after {deadline_s} s:\n{self.output}'
            raise NodeProcessError(text) from None

    def discard(self) -> None:
        """Kill it if it still runs."""
        self.send(signal.SIGKILL)
        self.process.wait()


class NodeProcesses:
    """Starts nodes with the same environment and remembers them.

    folder : of their output
    namespace : of all their topics; '' for none
    prefix : words before the command of the next nodes, such as `ip netns exec NAME`
    """

    def __init__(self, env: Mapping[str, str], folder: Path, namespace: str = '') -> None:
        self.env = dict(env)
        self.folder = folder
        self.namespace = namespace
        self.nodes: list[NodeProcess] = []
        self.prefix: list[str] = []

    def node(
        self,
        package: str,
        name: str,
        *args: str,
        remap: Mapping[str, str] | None = None,
        command: Sequence[str] = (),
        **parameters: object,
    ) -> NodeProcess:
        """Start an executable; `remap` holds ROS names, other keyword arguments parameters.

        command : to start in its place
        """
        rules = {**({'__ns': self.namespace} if self.namespace else {}), **(remap or {})}
        command = command or [str(executable(package, name, self.env.get('AMENT_PREFIX_PATH', '')))]
        command = [*self.prefix, *command, *args, *arguments(rules, parameters)]
        log = self.folder / f'{len(self.nodes)}_{name}.txt'
        self.nodes.append(NodeProcess(command, self.env, log))
        return self.nodes[-1]


@contextmanager
def node_processes(
    env: Mapping[str, str], folder: Path, namespace: str = ''
) -> Iterator[NodeProcesses]:
    """Yield a NodeProcesses; kill what is left of them. `env` comes on top of this process's."""
    started = NodeProcesses({**os.environ, **env}, folder, namespace)
    try:
        yield started
    finally:
        for node in started.nodes:
            node.discard()


@contextmanager
def own_domain() -> Iterator[int]:
    """Hold a ROS domain that no other test or benchmark on this machine holds.

    Domains take turns: DDS may remember a process that was killed for as long as 20 s. The first
    is drawn: a container beside this one may share its network, but not its folder of locks.
    """
    folder = Path(tempfile.gettempdir(), f'rpo_ros_domains_{os.getuid()}')
    folder.mkdir(exist_ok=True)
    for domain in _in_turn(folder):
        with (folder / str(domain)).open('w') as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    raise NodeProcessError('all ROS domains are held by other tests and benchmarks')


def _in_turn(folder: Path) -> Sequence[int]:
    """Return the domains, the one that was given the longest time ago first."""
    with (folder / 'last').open('a+') as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        text = file.read()
        last = int(text) if text.isdigit() and int(text) in DOMAINS else random.choice(DOMAINS)
        turned = [*range(last + 1, DOMAINS[-1] + 1), *range(DOMAINS[0], last + 1)]
        file.truncate(0)
        file.write(str(turned[0]))
    return turned
