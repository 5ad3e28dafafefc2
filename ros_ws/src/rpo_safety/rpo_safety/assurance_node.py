# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `assurance`: what the controller commands, shaped, and changed where it would break a limit.

It runs the stages between controller and thrusters. It reads the state that the controller reads,
and `control_force`; the plant then takes `assured_force`, or `shaped_force` where there is no
runtime assurance. Each intervention, from its first tick, is published on `assurance_status`. Where
the scenario has an abort table, what it does is published on `stage_status`; the services `~/arm`,
`~/inhibit`, `~/resume`, `~/hold`, `~/retreat`, `~/drift` and `~/abort` act from the next state on.
"""

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
from rpo_ros import health, qos
from rpo_ros.conversions import to_status
from rpo_ros.managed_node import PlaceNode
from rpo_safety.abort import COMMANDS
from rpo_safety.assurance import ASSURANCE_STATUS, AssuranceStage, Decision


class AssuranceNode(PlaceNode):
    """Answers each state and command with an assured force."""

    node_name = 'assurance'
    package = 'rpo_safety'
    places = (Place.SHAPING, Place.ASSURANCE)
    what = ('shaping or assuring', 'shaping or runtime assurance')
    off = 'passing commands on unchanged'

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        self._constraint = ''
        self._decision: Decision | None = None
        self.interventions = 0
        self._stage: AssuranceStage | None = None
        self._said = 0
        super().__init__(overrides)
        for name in COMMANDS:
            self.create_service(Trigger, f'~/{name}', partial(self._on_command, name))

    def begin(self) -> None:
        """Make the publisher of interventions, and start to listen."""
        self._status = self.create_publisher(
            DiagnosticStatus, ASSURANCE_STATUS, qos.of(interfaces.row_of(ASSURANCE_STATUS).qos)
        )
        super().begin()

    def new_run(self) -> None:
        """Forget the run before."""
        self._constraint, self._decision = '', None
        self.interventions, self._said = 0, 0
        super().new_run()

    def part(self, scenario: Scenario) -> Chain | None:
        """Return the filter of the scenario as a stage; without one, the node ends."""
        chain = super().part(scenario)
        if chain is not None:
            found = [x.stage for x in chain.links if isinstance(x.stage, AssuranceStage)]
            self._stage = found[0] if found else None
            if self._stage is not None and self._stage.abort is not None:
                self._stage.abort.ready()
        return chain

    def after_answer(self, stamp_ns: int, signals: Signals) -> None:
        """Publish an intervention when it begins, when its constraint changes, and its end."""
        stage = self._stage
        if stage is None or not self.active:
            return
        if stage.decision is not None:
            self._publish(stage.decision)
        changes = stage.abort.changes if stage.abort is not None else []
        if len(changes) < self._said:  # it began anew
            self._said = 0
        for change in changes[self._said :]:
            self.publish_stage_status(stage.name, change.state, change.tick, change.reason)
            self.get_logger().warning(f'{change.state}: {change.reason}')
        self._said = len(changes)

    def _publish(self, decision: Decision) -> None:
        self._decision = decision
        if decision.constraint == self._constraint:
            return
        self._constraint = decision.constraint
        self.interventions += bool(decision.constraint)
        level = health.WARN if decision.constraint else health.OK
        self._status.publish(
            to_status(level, self.get_name(), decision.sentence, decision.values(self.last_tick))
        )

    def _on_command(
        self, name: str, _request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Take a command to the abort table, or refuse it with the reason."""
        machine = self._stage.abort if self._stage is not None else None
        if machine is None:
            response.success, response.message = False, 'no scenario with `assurance.abort` is here'
            return response
        tick = machine.next_tick
        refused = machine.command(name) if self.active else 'assurance is inactive'
        response.success, response.message = not refused, refused or f'{name} from tick {tick} on'
        if not refused:
            self.publish_stage_status('assurance', name, tick, f'command `{name}`')
        return response

    def health(self) -> health.Health:
        """Return the health of this node for /diagnostics."""
        level, doing, values = super().health()
        newest = {} if self._decision is None else dict(self._decision.values(self.last_tick))
        values = {**values, **newest, 'interventions': self.interventions}
        machine = self._stage.abort if self._stage is not None else None
        if machine is not None:
            values |= {'table': 'armed' if machine.armed else 'inhibited', 'phase': machine.phase}
            level = health.WARN if machine.reaction else level
        return level, doing, values


main = AssuranceNode.main
