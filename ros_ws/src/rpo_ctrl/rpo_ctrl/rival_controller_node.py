# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `rival_controller`: answers each relative state with the force of a baseline, like LQR."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from rpo_core import controller
from rpo_core.baselines import Baseline
from rpo_core.scenario import load_scenario
from rpo_core.validation import InputError
from rpo_ctrl import controller_node
from rpo_ctrl.controller_node import ControllerNode
from rpo_ros.answering import Force
from rpo_ros.parameters import Row
from rpo_ros.running import run_node

PARAMETERS = (
    replace(controller_node.PARAMETERS[0], default='lqr', example='mpc'),
    *controller_node.PARAMETERS[1:],
    Row('scenario', 'approach', 'shipped scenario, or path of a scenario file: whose epoch and '
        'ticks a law that depends on time counts by', example='paper_test'),
)  # fmt: skip


class RivalControllerNode(ControllerNode):
    """Computes the force from the state and, for some laws, the tick of its stamp."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('rival_controller', overrides, PARAMETERS)

    def parse(self, document: Any) -> Baseline:
        """Return the baseline of a parsed file, checked against the scenario; raises InputError."""
        law = controller.parse(document)
        if not isinstance(law, Baseline):
            raise InputError(
                f'`controller` must be a baseline here; {law.name} is fuzzy: fly it with '
                '`ros2 run rpo_ctrl fuzzy_controller`'
            )
        self._scenario = load_scenario(self.values['scenario'])
        law.refuse_other_ticks(self._scenario.dt_s)
        law.force_n((0.0,) * 3, (0.0,) * 3)  # tables and kernels are ready before the first state
        return law

    def force_n(self, stamp_ns: int, state: tuple[float, ...]) -> Force | str:
        """Return the force [N], or why the state is not answered."""
        timed = self.active and self.law.clock_s is not None
        if timed and self._scenario.tick_of(stamp_ns) is None:
            return 'foreign_stamp'
        return super().force_n(stamp_ns, state)

    def command_n(self, stamp_ns: int, state: tuple[float, ...]) -> Force:
        """Return the commanded force [N] of a relative state."""
        return self.law.force_n(state[:3], state[3:], self._scenario.tick_of(stamp_ns) or 0)


def main() -> int:
    """Entry point of `ros2 run rpo_ctrl rival_controller`."""
    return run_node('ros2 run rpo_ctrl rival_controller', RivalControllerNode, __doc__, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
