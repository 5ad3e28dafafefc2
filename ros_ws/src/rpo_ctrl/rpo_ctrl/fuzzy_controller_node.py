# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `fuzzy_controller`: answers each relative state with the force of the trained controller."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry

from rpo_core import controller, files
from rpo_ros import conversions, health, names, qos
from rpo_ros.parameters import Row, declare
from rpo_ros.running import FlightNode, run_node

PARAMETERS = (
    Row('controller', controller.DEFAULT_CONTROLLER,
        'shipped controller, or path of a controller file', example='path/to/mine.yaml'),
)  # fmt: skip


class FuzzyControllerNode(FlightNode):
    """Computes the force from the state alone, so it may start, stop and repeat at any time."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('fuzzy_controller', overrides)
        values = declare(self, PARAMETERS)
        path = files.find('controller', values['controller'])
        self.controller = controller.load_controller(path)
        self.answered = 0
        self.ignored: Counter[str] = Counter()
        self._force = self.create_publisher(WrenchStamped, names.CONTROL_FORCE, qos.LOCKSTEP)
        self.create_subscription(Odometry, names.RELATIVE_STATE, self._on_state, qos.LOCKSTEP)
        health.publish_manifest(
            self,
            'controller',
            {'controller': self.controller.name},
            {'controller.yaml': files.read_text(path)},
        )
        health.publish_health(self, self._health)
        self.get_logger().info(f'controlling with {self.controller.name}')

    def _on_state(self, message: Odometry) -> None:
        state = conversions.from_odometry(message)
        fault = conversions.fault_of(message, state)
        if fault:
            self.ignored[fault] += 1
            return
        force = self.controller.force_n(state[:3], state[3:])
        self._force.publish(conversions.to_wrench(message.header.stamp, force))
        self.answered += 1

    def _health(self) -> health.Health:
        ignored = {f'ignored_{kind}': count for kind, count in sorted(self.ignored.items())}
        level = health.WARN if ignored else health.OK
        return level, 'answering states', {'answered': self.answered, **ignored}


def main() -> int:
    """Entry point of `ros2 run rpo_ctrl fuzzy_controller`."""
    return run_node('ros2 run rpo_ctrl fuzzy_controller', FuzzyControllerNode, __doc__, PARAMETERS)


if __name__ == '__main__':
    sys.exit(main())
