# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `guidance`: the reference that the controller follows, and the commands of an operator."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import Trigger

from rpo_core.chain.chain import Chain, Signals
from rpo_core.chain.stage import Place
from rpo_core.files.scenario import Scenario
from rpo_core.wire import interfaces
from rpo_guidance.guidance import COMMANDS, GuidanceStage
from rpo_ros import health, qos
from rpo_ros.conversions import to_status
from rpo_ros.managed_node import PlaceNode


class GuidanceNode(PlaceNode):
    """Answers each state with the reference of the plan.

    Services `~/go`, `~/hold`, `~/retreat`, `~/abort` act from the next state on. Each command is an
    event on `stage_status`, each phase one on `guidance_status`.
    """

    node_name = 'guidance'
    package = 'rpo_guidance'
    places = (Place.GUIDANCE, Place.POINTING)
    what = ('guiding', 'guidance')
    off = 'the reference is the goal of the scenario'

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        self._stage: GuidanceStage | None = None
        self._said = 0
        super().__init__(overrides)
        self._status = self.create_publisher(
            DiagnosticStatus, interfaces.GUIDANCE_STATUS, qos.LATCHED
        )
        for name in COMMANDS:
            self.create_service(Trigger, f'~/{name}', partial(self._on_command, name))

    def part(self, scenario: Scenario) -> Chain | None:
        """Return the plan of the scenario as a stage; without one, the node ends."""
        if scenario.target is not None:
            self.off = 'the reference is the chaser itself, and needs no force'
        chain = super().part(scenario)
        if chain is not None:
            found = [x.stage for x in chain.links if isinstance(x.stage, GuidanceStage)]
            self._stage = found[0] if found else None
        return chain

    def after_answer(self, stamp_ns: int, signals: Signals) -> None:
        """Publish the phases that began with this answer."""
        changes = self._stage.changes if self._stage is not None else []
        if len(changes) < self._said:  # a new run
            self._said = 0
        for change in changes[self._said :]:
            values = [('phase', change.phase), ('tick', change.tick), ('reason', change.reason)]
            self._status.publish(
                to_status(health.OK, self.get_name(), f'{change.phase}: {change.reason}', values)
            )
            self.get_logger().info(f'{change.phase}: {change.reason}')
        self._said = len(changes)

    def _on_command(
        self, name: str, _request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Take a command, or refuse it with the reason."""
        stage = self._stage
        if stage is None:
            response.success, response.message = False, 'no plan: the scenario is not known yet'
            return response
        refused = stage.command(name) if self.active else 'guidance is inactive'
        response.success = not refused
        response.message = refused or f'{name} from tick {stage.next_tick} on'
        if not refused:
            self.publish_stage_status('guidance', name, stage.next_tick, f'command `{name}`')
        return response


main = GuidanceNode.main
