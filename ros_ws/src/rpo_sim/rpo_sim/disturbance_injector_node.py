# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `disturbance_injector`: answers each state with the scenario's disturbance at its time."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry

from rpo_core import files, scenario
from rpo_ros import conversions, health, names, qos
from rpo_ros.parameters import Row, declare
from rpo_ros.running import FlightNode, run_node

PARAMETERS = (
    Row('scenario', 'paper_test', 'shipped scenario, or path of a scenario file',
        example='paper_test_phase'),
)  # fmt: skip


class DisturbanceInjectorNode(FlightNode):
    """Computes the force from the stamp alone, so it may start, stop and repeat at any time."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('disturbance_injector', overrides)
        values = declare(self, PARAMETERS)
        path = files.find('scenario', values['scenario'])
        self.scenario = scenario.load_scenario(path)
        self.answered = 0
        self.ignored: Counter[str] = Counter()
        self._force = self.create_publisher(WrenchStamped, names.DISTURBANCE_FORCE, qos.LOCKSTEP)
        self.create_subscription(Odometry, names.RELATIVE_STATE, self._on_state, qos.LOCKSTEP)
        health.publish_manifest(self, 'disturbance', {'scenario': self.scenario.name}, {})
        health.publish_health(self, self._health)
        self.get_logger().info(f'disturbing as in {self.scenario.name}')

    def _on_state(self, message: Odometry) -> None:
        tick = self.scenario.tick_of(conversions.from_stamp(message.header.stamp))
        if tick is None:
            self.ignored['foreign_stamp'] += 1
            return
        force = self.scenario.disturbance.force_n(self.scenario.time_s(tick))
        self._force.publish(conversions.to_wrench(message.header.stamp, force))
        self.answered += 1

    def _health(self) -> health.Health:
        ignored = {f'ignored_{kind}': count for kind, count in sorted(self.ignored.items())}
        level = health.WARN if ignored else health.OK
        return level, 'answering states', {'answered': self.answered, **ignored}


def main() -> int:
    """Entry point of `ros2 run rpo_sim disturbance_injector`."""
    return run_node(
        'ros2 run rpo_sim disturbance_injector', DisturbanceInjectorNode, __doc__, PARAMETERS
    )


if __name__ == '__main__':
    sys.exit(main())
