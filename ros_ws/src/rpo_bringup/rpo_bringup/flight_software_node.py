# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes that fly the chaser in one process, as on one on-board computer.

They are navigation, guidance, fuzzy_controller, assurance and attitude_controller, as ever but for
what they tell each other: it does not leave the process, and so costs less. These parameters are
for all of them; `-p fuzzy_controller:controller:=handmade` is for one.
"""

from __future__ import annotations

from rpo_ctrl.attitude_controller_node import AttitudeControllerNode
from rpo_ctrl.controller_node import ControllerNode
from rpo_guidance.guidance_node import GuidanceNode
from rpo_nav.navigation_node import NavigationNode
from rpo_ros.running import run
from rpo_safety.assurance_node import AssuranceNode

KINDS = NavigationNode, GuidanceNode, ControllerNode, AssuranceNode, AttitudeControllerNode


def main() -> int:
    """Entry point of `ros2 run rpo_bringup flight_software`."""
    return run(
        lambda: [kind() for kind in KINDS],
        until=lambda nodes: (
            all(n.done for n in nodes) or any(n.exit_code and n.done for n in nodes)
        ),
    )
