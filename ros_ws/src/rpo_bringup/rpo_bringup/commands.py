# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the commands of this package; see `rpo_ros.entry_point`."""

import sys
from functools import partial
from importlib import import_module
from pathlib import Path

from rpo_bringup.options import parser
from rpo_core.files.output import standard_output
from rpo_ros.entry_point import EXIT_BAD_INPUT, EXIT_INTERRUPTED, asks_for_help, start, start_node
from rpo_ros.parameter_rows import refusal, tables

_NODES = (
    ('rpo_sim', 'plant'),
    ('rpo_ctrl', 'fuzzy_controller'),
    ('rpo_sim', 'disturbance_injector'),
    ('rpo_nav', 'navigation'),
    ('rpo_log', 'recorder'),
)
"""Nodes that `final_approach` runs."""


@standard_output()
def final_approach() -> int:
    """Run `ros2 run rpo_bringup final_approach`; answer `--help` without ROS."""
    if asks_for_help():
        parser().parse_args(['--help'])
    rows = [row for package, node in _NODES for row in tables(package)[node]]
    if sentence := refusal(sys.argv, rows, 'ros2 run rpo_bringup final_approach'):
        print(sentence, file=sys.stderr)
        return EXIT_BAD_INPUT
    return start('rpo_bringup.final_approach', EXIT_INTERRUPTED)


@standard_output()
def _tool(name: str) -> int:
    """Run a program of `tools/`, which is in the checkout that this package is built from."""
    root = Path(__file__).resolve().parents[4]
    if not (root / 'tools' / f'{name}.py').is_file():
        print(
            f'`{name}` is in tools/ of the source checkout and is not installed',
            file=sys.stderr,
        )
        return 2
    sys.path.insert(0, str(root))
    code: int = import_module(f'tools.{name}').main()
    return code


def flight_software() -> int:
    """Run `ros2 run rpo_bringup flight_software`."""
    return start_node('rpo_bringup.flight_software_node')


trial, ping_pong, node_pages = (
    partial(_tool, name) for name in ('trial', 'ping_pong', 'node_pages')
)
