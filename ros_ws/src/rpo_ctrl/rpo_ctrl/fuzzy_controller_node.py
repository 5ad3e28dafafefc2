# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `fuzzy_controller`: answers each relative state with the force of a controller file.

A managed (lifecycle) node that starts by itself: `ros2 lifecycle set /fuzzy_controller deactivate`
has it command zero; then `ros2 param set /fuzzy_controller controller handmade` and `activate` fly
another file. It loads any controller file, fuzzy or not.
"""

from rpo_ctrl.controller_node import ControllerNode
from rpo_ros.running import run_node


def main() -> int:
    """Entry point of `ros2 run rpo_ctrl fuzzy_controller`."""
    return run_node(ControllerNode)
