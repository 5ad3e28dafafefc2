# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `disturbance_injector`: answers each state with the disturbance of the scenario."""

from __future__ import annotations

from rpo_core.chain.stage import Place
from rpo_ros.managed_node import PlaceNode


class DisturbanceInjectorNode(PlaceNode):
    """Computes the disturbance from the stamp alone."""

    node_name = 'disturbance_injector'
    package = 'rpo_sim'
    places = (Place.DISTURBANCE,)
    what = ('disturbing', 'disturbance')
    role = 'disturbance'
    off = 'no disturbance'


main = DisturbanceInjectorNode.main
