# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `fuzzy_controller`: answers each relative state with the force of a controller file.

It loads any controller file, fuzzy or not. Where the scenario has navigation, it answers
`navigation_state` instead of `relative_state`.

It is a managed (lifecycle) node that activates itself. To make it command zero:
`ros2 lifecycle set /fuzzy_controller deactivate`. To load another file then:
`ros2 param set /fuzzy_controller controller handmade`, and `activate`.
"""

from rpo_ctrl.controller_node import ControllerNode

main = ControllerNode.main
