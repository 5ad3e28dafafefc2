# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Where the commands of this package begin; see `rpo_ros.entry_point`."""

from rpo_ros.entry_point import start


def fuzzy_controller() -> int:
    """Run `ros2 run rpo_ctrl fuzzy_controller`."""
    return start('rpo_ctrl.fuzzy_controller_node')


def rival_controller() -> int:
    """Run `ros2 run rpo_ctrl rival_controller`."""
    return start('rpo_ctrl.rival_controller_node')
