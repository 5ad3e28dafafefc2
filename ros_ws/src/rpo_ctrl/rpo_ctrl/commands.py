# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the commands of this package; see `rpo_ros.entry_point`."""

from functools import partial

from rpo_ros.entry_point import start_node

attitude_controller = partial(start_node, 'rpo_ctrl.attitude_controller_node')
fuzzy_controller = partial(start_node, 'rpo_ctrl.fuzzy_controller_node')
rival_controller = partial(start_node, 'rpo_ctrl.rival_controller_node')
