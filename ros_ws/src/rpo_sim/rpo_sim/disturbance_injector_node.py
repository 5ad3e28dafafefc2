# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `disturbance_injector`: answers each state with the disturbance of the scenario."""

from __future__ import annotations

from rpo_core.chain.chain import Chain, Link
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place
from rpo_core.world.disturbance import DisturbanceStage
from rpo_ros.place_node import PLACES, PlaceNode


class DisturbanceInjectorNode(PlaceNode):
    """Computes the disturbance from the stamp alone."""

    node_name = 'disturbance_injector'
    package = 'rpo_sim'
    places = PLACES['rpo_sim disturbance_injector']
    what = ('disturbing', 'disturbance')
    role = 'disturbance'
    off = 'no disturbance'
    bare = True

    def chain_of(self, scenario: Scenario) -> Chain:
        """Return the disturbance; a plug-in may add stages, without any this one is alone."""
        if not self._run.bare:
            return super().chain_of(scenario)
        stage = DisturbanceStage(scenario.disturbance, scenario.dt_ns)
        return Chain([] if scenario.disturbance.is_zero else [Link(Place.DISTURBANCE, stage, ())])


main = DisturbanceInjectorNode.main
