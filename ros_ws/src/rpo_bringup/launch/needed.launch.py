# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Switches off, by their launch arguments, the nodes that the scenario does not need.

It reads the scenario once; started, each such node would read it, say so and end.
"""

from launch import LaunchContext, LaunchDescription
from launch.actions import OpaqueFunction, SetLaunchConfiguration

from rpo_bringup.flight_software_node import OPTIONAL, needed
from rpo_core.scenario.scenario import load_scenario


def _switch_off(context: LaunchContext) -> list[SetLaunchConfiguration]:
    flown = needed(load_scenario(context.launch_configurations['scenario']))
    return [
        SetLaunchConfiguration(kind.node_name, 'false') for kind in OPTIONAL if kind not in flown
    ]


def generate_launch_description() -> LaunchDescription:
    """Return what sets the arguments, before the nodes are started."""
    return LaunchDescription([OpaqueFunction(function=_switch_off)])
