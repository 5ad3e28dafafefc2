# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `rival_controller`: the same node as `fuzzy_controller`; without a file it loads an LQR."""

import sys
from dataclasses import replace

from rpo_ctrl import controller_node
from rpo_ros.running import run_node

PARAMETERS = (
    replace(controller_node.PARAMETERS[0], default='lqr', example='mpc'),
    *controller_node.PARAMETERS[1:],
)


class ControllerNode(controller_node.ControllerNode):
    """The controller node under its other name."""

    node_name = 'rival_controller'
    rows = PARAMETERS


def main() -> int:
    """Entry point of `ros2 run rpo_ctrl rival_controller`."""
    return run_node('ros2 run rpo_ctrl rival_controller', ControllerNode, __doc__, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
