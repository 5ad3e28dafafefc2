# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Where the commands of this package begin; see `rpo_ros.entry_point`."""

from rpo_ros.entry_point import start_node


def fuzzy_controller() -> int:
    """Run `ros2 run rpo_ctrl fuzzy_controller`."""
    return start_node('rpo_ctrl.fuzzy_controller_node', 'fuzzy_controller')


def rival_controller() -> int:
    """Run `ros2 run rpo_ctrl rival_controller`."""
    return start_node('rpo_ctrl.rival_controller_node', 'rival_controller')
