# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `navigation`: the relative state as the chaser knows it, with the errors of the scenario.

It runs the stages that a scenario has between the true state and guidance. The controller then
listens to their output, `navigation_state`.
"""

from __future__ import annotations

from rpo_core.chain.chain import Chain
from rpo_core.scenario.scenario import Scenario
from rpo_ros.place_node import PLACES, PlaceNode

_ALL = PLACES['rpo_ctrl navigation']
_STAGES = {'all': _ALL, 'sensors': _ALL[:2], 'estimator': _ALL[2:]}
"""Value of the parameter `stages` -> places of the chain."""


class NavigationNode(PlaceNode):
    """Answers each true state with the navigation solution, a function of state and tick."""

    node_name = 'navigation'
    package = 'rpo_ctrl'
    places = _ALL
    what = ('navigating', 'errors of navigation')
    off = 'passing the true state on'

    def part(self, scenario: Scenario) -> Chain | None:
        """Return the stages that it runs; without any, the node ends."""
        self.places = _STAGES[self.values['stages']]
        return super().part(scenario)


main = NavigationNode.main
