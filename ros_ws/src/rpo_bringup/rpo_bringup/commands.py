# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Where the commands of this package begin; see `rpo_ros.entry_point`."""

import sys
from importlib import import_module
from pathlib import Path

from rpo_ros.entry_point import start, start_node


def final_approach() -> int:
    """Run `ros2 run rpo_bringup final_approach`."""
    return start('rpo_bringup.final_approach')


def monitor() -> int:
    """Run `ros2 run rpo_bringup monitor`."""
    return start_node('rpo_bringup.monitor_node', 'monitor')


def trial() -> int:
    """Run `ros2 run rpo_bringup trial`."""
    return _tool('trial')


def ping_pong() -> int:
    """Run `ros2 run rpo_bringup ping_pong`."""
    return _tool('ping_pong')


def node_pages() -> int:
    """Run `ros2 run rpo_bringup node_pages`."""
    return _tool('node_pages')


def _tool(name: str) -> int:
    """Run a program of `tools/`, which is in the checkout that this package is built from."""
    root = Path(__file__).resolve().parents[4]
    if not (root / 'tools' / f'{name}.py').is_file():
        print(f'`{name}` is in tools/ of the source checkout, and not installed', file=sys.stderr)
        return 2
    sys.path.insert(0, str(root))
    code: int = import_module(f'tools.{name}').main()
    return code
