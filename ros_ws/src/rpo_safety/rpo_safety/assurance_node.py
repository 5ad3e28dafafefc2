# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `assurance`: what the controller commands, changed where it would break a limit.

It reads the state that the controller reads, and `control_force`; the plant then takes
`assured_force`. Each intervention, from its first tick, is published on `assurance_status`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from rpo_core import interfaces
from rpo_core.chain import Signals
from rpo_core.stage import Place
from rpo_ros import health, qos
from rpo_ros.conversions import to_status
from rpo_ros.place_node import PlaceNode
from rpo_ros.running import run_node
from rpo_safety.assurance import ASSURANCE_STATUS, AssuranceStage, Decision


class AssuranceNode(PlaceNode):
    """Answers each state and command with an assured force."""

    node_name = 'assurance'
    places = (Place.ASSURANCE,)
    what = ('assuring', 'runtime assurance')

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        self._acting = ''
        self._decision: Decision | None = None
        self.interventions = 0
        super().__init__(overrides)

    def begin(self) -> None:
        """Make the publisher of interventions, and start to listen."""
        self._status = self.create_publisher(
            DiagnosticStatus, ASSURANCE_STATUS, qos.of(interfaces.row_of(ASSURANCE_STATUS).qos)
        )
        super().begin()

    def new_run(self) -> None:
        """Forget the run before."""
        self._acting, self._decision = '', None
        self.interventions = 0
        super().new_run()

    def after_answer(self, stamp_ns: int, signals: Signals) -> None:
        """Publish an intervention when it begins, when its constraint changes, and its end."""
        for link in self.chain.links if self.chain is not None else ():
            stage = link.stage
            if isinstance(stage, AssuranceStage) and stage.decision is not None:
                self._publish(stage.decision)

    def _publish(self, decision: Decision) -> None:
        self._decision = decision
        if decision.constraint == self._acting:
            return
        self._acting = decision.constraint
        self.interventions += bool(decision.constraint)
        level = health.WARN if decision.constraint else health.OK
        self._status.publish(
            to_status(level, self.get_name(), decision.sentence, decision.values(self.last_tick))
        )

    def health(self) -> health.Health:
        """Return the health of this node for /diagnostics."""
        level, doing, values = super().health()
        newest = {} if self._decision is None else dict(self._decision.values(self.last_tick))
        return level, doing, {**values, **newest, 'interventions': self.interventions}


def main() -> int:
    """Entry point of `ros2 run rpo_safety assurance`."""
    return run_node(AssuranceNode)
