# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `navigation`: what the chaser knows of its relative state, with the scenario's errors.

The controller then listens to `navigation_state`: start it with `-r
relative_state:=navigation_state`.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping
from typing import Any

from nav_msgs.msg import Odometry

from rpo_core import files, scenario
from rpo_core.navigation import Navigation
from rpo_ros import conversions, health, names, qos
from rpo_ros.parameters import Row, declare
from rpo_ros.running import FlightNode, run_node

PARAMETERS = (
    Row('scenario', 'approach', 'shipped scenario, or path of a scenario file; without a section '
        '`navigation` it is perfect', example='run_1234.yaml'),
)  # fmt: skip


class NavigationNode(FlightNode):
    """Answers each true state with the navigation solution, which follows from it and its stamp."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('navigation', overrides)
        path = files.find('scenario', declare(self, PARAMETERS)['scenario'])
        self.scenario = scenario.load_scenario(path)
        self.navigation = self.scenario.navigation or Navigation()
        self.answered = 0
        self.ignored: Counter[str] = Counter()
        self._solution = self.create_publisher(Odometry, names.NAVIGATION_STATE, qos.LOCKSTEP)
        self.create_subscription(Odometry, names.RELATIVE_STATE, self._on_state, qos.IN_LOOP)
        health.publish_health(self, self._health)
        self.get_logger().info(f'navigating in {self.scenario.name}')

    def _on_state(self, message: Odometry) -> None:
        state = conversions.from_odometry(message)
        stamp_ns = conversions.from_stamp(message.header.stamp)
        tick = self.scenario.tick_of(stamp_ns)
        fault = conversions.fault_of(message, state) or ('foreign_stamp' if tick is None else '')
        if fault or tick is None:
            self.ignored[fault] += 1
            return
        solution = self.navigation.solution(tick, state)
        self._solution.publish(conversions.to_odometry(stamp_ns, solution))
        self.answered += 1

    def _health(self) -> health.Health:
        ignored = {f'ignored_{kind}': count for kind, count in sorted(self.ignored.items())}
        level = health.WARN if ignored else health.OK
        return level, 'navigating', {'answered': self.answered, **ignored}


def main() -> int:
    """Entry point of `ros2 run rpo_sim navigation`."""
    return run_node('ros2 run rpo_sim navigation', NavigationNode, __doc__, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
