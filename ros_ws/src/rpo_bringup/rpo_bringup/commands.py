# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Where the commands of this package begin; see `rpo_ros.entry_point`."""

from rpo_ros.entry_point import start, start_node


def final_approach() -> int:
    """Run `ros2 run rpo_bringup final_approach`."""
    return start('rpo_bringup.final_approach')


def monitor() -> int:
    """Run `ros2 run rpo_bringup monitor`."""
    return start_node('rpo_bringup', 'monitor')
