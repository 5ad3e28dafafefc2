# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Where the commands of this package begin; see `rpo_ros.entry_point`."""

from rpo_ros.entry_point import start


def plant() -> int:
    """Run `ros2 run rpo_sim plant`."""
    return start('rpo_sim.plant_node')


def navigation() -> int:
    """Run `ros2 run rpo_sim navigation`."""
    return start('rpo_sim.navigation_node')


def disturbance_injector() -> int:
    """Run `ros2 run rpo_sim disturbance_injector`."""
    return start('rpo_sim.disturbance_injector_node')


def fault_injector() -> int:
    """Run `ros2 run rpo_sim fault_injector`."""
    return start('rpo_sim.fault_injector_node')
