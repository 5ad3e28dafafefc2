# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the commands of this package; see `rpo_ros.entry_point`."""

from functools import partial

from rpo_ros.entry_point import start_node

assurance = partial(start_node, 'rpo_ctrl.assurance_node')
attitude_controller = partial(start_node, 'rpo_ctrl.attitude_controller_node')
fuzzy_controller = partial(start_node, 'rpo_ctrl.fuzzy_controller_node')
guidance = partial(start_node, 'rpo_ctrl.guidance_node')
navigation = partial(start_node, 'rpo_ctrl.navigation_node')
operator = partial(start_node, 'rpo_ctrl.operator_node', interpreted=True)
rival_controller = partial(start_node, 'rpo_ctrl.rival_controller_node')
