# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes of a flight: as processes, or in the process of the test."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from flights import lasting
from inside import Inside, inside
from node_processes import NodeProcesses, arguments, node_processes

from rpo_bringup import final_approach
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode


@pytest.fixture
def ros(ros_env: dict[str, str], tmp_path: Path) -> Iterator[NodeProcesses]:
    """Start nodes in a ROS domain of the test's own; none is left at its end."""
    with node_processes(ros_env, tmp_path) as started:
        yield started


@pytest.fixture
def inner(ros_env: dict[str, str]) -> Iterator[Inside]:
    """Start nodes in this process; none is left at the test's end."""
    with inside() as found:
        yield found


@pytest.fixture
def straight(ros_env: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the run of 20 s of `paper_test`, flown once by nodes here; ask before `inner`."""
    run = tmp_path_factory.getbasetemp() / 'straight'
    if not run.exists():
        with inside() as found:
            found.fly(run, lasting(20.0, run.parent, 'paper_test'), DisturbanceInjectorNode)
            assert found.ends() == 0
    return run


@pytest.fixture
def command(
    ros_env: dict[str, str], monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str]]:
    """Return what runs the `main` of a command here: its exit code, and what it said."""

    def run(main: Callable[[], int], *words: object, **parameters: object) -> tuple[int, str]:
        monkeypatch.setattr('sys.argv', ['command', *map(str, words), *arguments({}, parameters)])
        capfd.readouterr()
        code = main()
        said = capfd.readouterr()
        return code, said.out + said.err

    return run


@pytest.fixture
def together(command: Callable[..., tuple[int, str]], tmp_path: Path) -> Callable[..., Path]:
    """Return what flies all nodes as `final_approach` does, without a report: the run's folder."""

    def fly(scenario: str, *options: object) -> Path:
        words = ('--scenario', scenario, '--output', tmp_path / 'run', '--no-report', *options)
        code, said = command(final_approach.main, *words)
        assert code == 0, said
        return tmp_path / 'run'

    return fly
