# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Which nodes a scenario needs beside plant and controller: those whose places have a stage."""

from __future__ import annotations

from rpo_core.chain.chain import Chain
from rpo_core.files.scenario import Scenario
from rpo_ctrl.attitude_controller_node import AttitudeControllerNode
from rpo_guidance.guidance_node import GuidanceNode
from rpo_nav.navigation_node import NavigationNode
from rpo_ros.managed_node import PlaceNode
from rpo_safety.assurance_node import AssuranceNode
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode

OPTIONAL: tuple[type[PlaceNode], ...] = (
    NavigationNode,
    GuidanceNode,
    AssuranceNode,
    AttitudeControllerNode,
    DisturbanceInjectorNode,
)


def needed(scenario: Scenario) -> list[type[PlaceNode]]:
    """Return those nodes of which a scenario has a stage."""
    places = {link.place for link in Chain.of(scenario).links}
    return [kind for kind in OPTIONAL if places & set(kind.places)]
