# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `fuzzy_controller`: answers each relative state with the force of the fuzzy controller."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from rpo_core import controller, files
from rpo_ros import health, names
from rpo_ros.answering import AnsweringNode
from rpo_ros.parameters import Row, declare
from rpo_ros.running import run_node

PARAMETERS = (
    Row('controller', controller.DEFAULT_CONTROLLER,
        'shipped controller, or path of a controller file', example='path/to/mine.yaml'),
)  # fmt: skip


class FuzzyControllerNode(AnsweringNode):
    """Computes the force from the state alone."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('fuzzy_controller', overrides)
        path = files.find('controller', declare(self, PARAMETERS)['controller'])
        self.controller = controller.load_controller(path)
        self.answer_on(names.CONTROL_FORCE)
        health.publish_manifest(
            self,
            'controller',
            {'controller': self.controller.name},
            {'controller.yaml': files.read_text(path)},
        )
        self.get_logger().info(f'controlling with {self.controller.name}')

    def force_n(self, stamp_ns: int, state: tuple[float, ...]) -> tuple[float, float, float] | str:
        """Return the commanded force [N] of a relative state."""
        return self.controller.force_n(state[:3], state[3:])


def main() -> int:
    """Entry point of `ros2 run rpo_ctrl fuzzy_controller`."""
    return run_node('ros2 run rpo_ctrl fuzzy_controller', FuzzyControllerNode, __doc__, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
