# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Where the commands of this package begin; see `rpo_ros.entry_point`."""

from rpo_ros.entry_point import start_node


def recorder() -> int:
    """Run `ros2 run rpo_log recorder`."""
    return start_node('rpo_log.recorder_node', 'recorder')


def replay() -> int:
    """Run `ros2 run rpo_log replay`."""
    return start_node('rpo_log.replay_node', 'replay')
