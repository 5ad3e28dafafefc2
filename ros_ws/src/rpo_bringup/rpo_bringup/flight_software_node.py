# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes that fly the chaser in one process, as on one on-board computer.

They are navigation, guidance, fuzzy_controller, assurance and attitude_controller, as ever but for
what they tell each other: it does not leave the process, and so costs less. These parameters are
for all of them; `-p fuzzy_controller:controller:=handmade` is for one.
"""

from __future__ import annotations

from rpo_core.chain.chain import Chain
from rpo_core.scenario.scenario import Scenario
from rpo_ctrl.assurance_node import AssuranceNode
from rpo_ctrl.attitude_controller_node import AttitudeControllerNode
from rpo_ctrl.fuzzy_controller_node import ControllerNode
from rpo_ctrl.guidance_node import GuidanceNode
from rpo_ctrl.navigation_node import NavigationNode
from rpo_ros.place_node import PlaceNode
from rpo_ros.running import run
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode

KINDS = NavigationNode, GuidanceNode, ControllerNode, AssuranceNode, AttitudeControllerNode
OPTIONAL: tuple[type[PlaceNode], ...] = (
    NavigationNode,
    GuidanceNode,
    AssuranceNode,
    AttitudeControllerNode,
    DisturbanceInjectorNode,
)
"""Nodes beside plant and controller that not every scenario needs."""


def needed(scenario: Scenario) -> list[type[PlaceNode]]:
    """Return those nodes of which a scenario has a stage."""
    places = {link.place for link in Chain.of(scenario).links}
    return [node for node in OPTIONAL if places & set(node.places)]


def main() -> int:
    """Entry point of `ros2 run rpo_bringup flight_software`."""
    return run(
        lambda: [kind() for kind in KINDS],
        until=lambda nodes: (
            all(n.done for n in nodes) or any(n.exit_code and n.done for n in nodes)
        ),
    )
