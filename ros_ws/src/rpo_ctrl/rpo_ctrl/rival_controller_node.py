# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `rival_controller`: the same node as `fuzzy_controller`; its default file is an LQR."""

from rpo_ctrl import fuzzy_controller_node


class ControllerNode(fuzzy_controller_node.ControllerNode):
    """The controller node under its other name."""

    node_name = 'rival_controller'


main = ControllerNode.main
