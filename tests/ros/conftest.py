# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes, for tests of a flight."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.node_processes import NodeProcesses, node_processes


@pytest.fixture
def ros(ros_env: dict[str, str], tmp_path: Path) -> Iterator[NodeProcesses]:
    """Start nodes in a ROS domain of the test's own; none is left at its end."""
    with node_processes(ros_env, tmp_path) as started:
        yield started
