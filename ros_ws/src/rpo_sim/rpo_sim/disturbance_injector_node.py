# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `disturbance_injector`: answers each state with the scenario's disturbance at its time."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

from rpo_core import files, scenario
from rpo_ros import health, names
from rpo_ros.answering import AnsweringNode
from rpo_ros.parameters import Row, declare
from rpo_ros.running import run_node

PARAMETERS = (
    Row('scenario', 'paper_test', 'shipped scenario, or path of a scenario file',
        example='paper_test_phase'),
)  # fmt: skip


class DisturbanceInjectorNode(AnsweringNode):
    """Computes the disturbance from the stamp alone."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('disturbance_injector', overrides)
        values = declare(self, PARAMETERS)
        self.scenario = scenario.load_scenario(files.find('scenario', values['scenario']))
        if self.scenario.disturbance.is_zero:
            # So one launch file serves every scenario.
            self.get_logger().info(f'{self.scenario.name} has no disturbance: nothing to do')
            self.done = True
            return
        self.answer_on(names.DISTURBANCE_FORCE)
        health.publish_manifest(self, 'disturbance', {'scenario': self.scenario.name}, {})
        self.get_logger().info(f'disturbing as in {self.scenario.name}')

    def force_n(self, stamp_ns: int, state: tuple[float, ...]) -> tuple[float, float, float] | str:
        """Return the disturbance [N] at the time of a stamp."""
        tick = self.scenario.tick_of(stamp_ns)
        if tick is None:
            return 'foreign_stamp'
        return self.scenario.disturbance.force_n(self.scenario.time_s(tick))


def main() -> int:
    """Entry point of `ros2 run rpo_sim disturbance_injector`."""
    return run_node(
        'ros2 run rpo_sim disturbance_injector', DisturbanceInjectorNode, __doc__, PARAMETERS
    )


if __name__ == '__main__':
    sys.exit(main())
