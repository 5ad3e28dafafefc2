# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `guidance`: the reference that the controller follows, and the commands of an operator."""

from __future__ import annotations

from rpo_core.chain.chain import Chain, Signals
from rpo_core.guidance.guidance import COMMANDS, GuidanceStage
from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import interfaces
from rpo_ros import health
from rpo_ros.place_node import PLACES, CommandedNode
from rpo_ros.signals import to_status


class GuidanceNode(CommandedNode):
    """Answers each state with the reference of the plan.

    Services `~/go`, `~/hold`, `~/retreat`, `~/abort` act from the next state on. Each command is an
    event on `stage_status`, each phase one on `guidance_status`.
    """

    node_name = 'guidance'
    package = 'rpo_ctrl'
    places = PLACES['rpo_ctrl guidance']
    what = ('guiding', 'guidance')
    off = 'the reference is the goal of the scenario'

    commands = COMMANDS
    status = interfaces.GUIDANCE_STATUS
    deaf = 'no plan: the scenario is not known yet'

    @property
    def listener(self) -> GuidanceStage | None:
        """The plan."""
        return self.stage_of(GuidanceStage)

    def part(self, scenario: Scenario) -> Chain | None:
        """Return the plan of the scenario as a stage; without one, the node ends."""
        if scenario.target is not None:
            self.off = 'the reference is the chaser itself, and needs no force'
        return super().part(scenario)

    def after_answer(self, stamp_ns: int, signals: Signals) -> None:
        """Publish the phases that began with this answer."""
        for change in self.begun():
            values = [('phase', change.phase), ('tick', change.tick), ('reason', change.reason)]
            self._status.publish(
                to_status(health.OK, self.get_name(), f'{change.phase}: {change.reason}', values)
            )
            self.get_logger().info(f'{change.phase}: {change.reason}')


main = GuidanceNode.main
