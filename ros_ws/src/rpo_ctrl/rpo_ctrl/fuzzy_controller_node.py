# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `fuzzy_controller`: answers each relative state with the force of the fuzzy controller.

A managed (lifecycle) node that starts by itself: `ros2 lifecycle set /fuzzy_controller deactivate`
has it command zero; then `ros2 param set /fuzzy_controller controller handmade` and `activate` fly
another file.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from rpo_core import controller, explain
from rpo_ctrl.controller_node import PARAMETERS, ControllerNode
from rpo_ctrl.decision import Reason
from rpo_ros.answering import Force
from rpo_ros.running import run_node

_AXES = tuple(enumerate(explain.AXES))


class FuzzyControllerNode(ControllerNode):
    """Computes the force from the state alone."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('fuzzy_controller', overrides)

    def parse(self, document: Any) -> controller.FuzzyController:
        """Return the fuzzy controller of a parsed file; raises InputError."""
        return controller.only_fuzzy(controller.parse(document))

    def command_n(self, stamp_ns: int, state: tuple[float, ...]) -> Force:
        """Return the commanded force [N] of a relative state."""
        return self.law.force_n(state[:3], state[3:])

    def reasons(self, state: tuple[float, ...], force: Force) -> Sequence[Reason]:
        """Return for each axis the strongest rule in words, grades and strengths."""
        found = [explain.decide(self.law, state[i], state[3 + i], axis) for i, axis in _AXES]
        return [(decision.sentence, decision.pairs()) for decision in found]


def main() -> int:
    """Entry point of `ros2 run rpo_ctrl fuzzy_controller`."""
    return run_node('ros2 run rpo_ctrl fuzzy_controller', FuzzyControllerNode, __doc__, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
