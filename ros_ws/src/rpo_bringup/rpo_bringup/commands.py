# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the commands of this package; see `rpo_ros.entry_point`."""

import sys

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


def flight_software() -> int:
    """Run `ros2 run rpo_bringup flight_software`."""
    return start_node('rpo_bringup.flight_software_node')


def ping_pong() -> int:
    """Run `ros2 run rpo_bringup ping_pong`, the peer of `rpo bench ros`."""
    return start('rpo_bringup.ping_pong', EXIT_INTERRUPTED)
