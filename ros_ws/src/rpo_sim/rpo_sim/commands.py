# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Entry points of the commands of this package; see `rpo_ros.entry_point`."""

from functools import partial

from rpo_ros.entry_point import start_node

plant = partial(start_node, 'rpo_sim.plant_node')
disturbance_injector = partial(start_node, 'rpo_sim.disturbance_injector_node', interpreted=True)
fault_injector = partial(start_node, 'rpo_sim.fault_injector_node', interpreted=True)
