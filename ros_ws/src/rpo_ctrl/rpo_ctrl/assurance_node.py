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

from rpo_core.assurance.abort import COMMANDS, AbortMachine
from rpo_core.assurance.assurance import AssuranceStage, Decision
from rpo_core.chain.chain import Chain, Signals
from rpo_core.scenario.scenario import Scenario
from rpo_core.wire import interfaces
from rpo_ros import health
from rpo_ros.place_node import PLACES, CommandedNode
from rpo_ros.signals import to_status


class AssuranceNode(CommandedNode):
    """Answers each state and command with an assured force."""

    node_name = 'assurance'
    package = 'rpo_ctrl'
    places = PLACES['rpo_ctrl assurance']
    what = ('shaping or assuring', 'shaping or runtime assurance')
    off = 'passing commands on unchanged'
    commands = COMMANDS
    status = interfaces.ASSURANCE_STATUS
    deaf = 'no scenario with `assurance.abort` is here'
    _constraint, _interventions = '', 0

    @property
    def _stage(self) -> AssuranceStage | None:
        return self.stage_of(AssuranceStage)

    @property
    def listener(self) -> AbortMachine | None:
        """The abort table."""
        return self._stage.abort if self._stage is not None else None

    def new_run(self) -> None:
        """Forget the run before."""
        self._constraint, self._interventions = '', 0
        super().new_run()

    def part(self, scenario: Scenario) -> Chain | None:
        """Return the filter of the scenario as a stage; without one, the node ends."""
        chain = super().part(scenario)
        for link in chain.links if chain is not None else ():
            if isinstance(link.stage, AssuranceStage) and link.stage.abort is not None:
                link.stage.abort.ready()
        return chain

    def after_answer(self, stamp_ns: int, signals: Signals) -> None:
        """Publish an intervention when it begins, when its constraint changes, and its end."""
        stage = self._stage
        if stage is None or not self.active:
            return
        if stage.decision is not None:
            self._publish(stage.decision)
        for change in self.begun():
            self.publish_stage_status(stage.name, change.state, change.tick, change.reason)
            self.get_logger().warning(f'{change.state}: {change.reason}')

    def _publish(self, decision: Decision) -> None:
        if decision.constraint == self._constraint:
            return
        self._constraint = decision.constraint
        self._interventions += bool(decision.constraint)
        level = health.WARN if decision.constraint else health.OK
        self._status.publish(
            to_status(level, self.get_name(), decision.sentence, decision.values(self.last_tick))
        )

    def health(self) -> health.Health:
        """Return the health of this node for /diagnostics."""
        level, doing, values = super().health()
        decision = self._stage.decision if self._stage is not None else None
        newest = dict(decision.values(self.last_tick)) if decision is not None else {}
        values = {**values, **newest, 'interventions': self._interventions}
        machine = self.listener
        if machine is not None:
            values |= {'table': 'armed' if machine.armed else 'inhibited', 'phase': machine.phase}
            level = health.WARN if machine.reaction else level
        return level, doing, values


main = AssuranceNode.main
