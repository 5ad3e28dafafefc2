# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Listens to the topics of a run until so many states came; prints what it heard as JSON."""

import json
import sys

import rclpy
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from rpo_ros import names, qos


def main(states: int) -> None:
    rclpy.init()
    node = Node('listener')
    heard: dict[str, list[str]] = {}

    def listen(topic: str, kind: type) -> None:
        name = node.resolve_topic_name(topic)
        node.create_subscription(
            kind,
            topic,
            lambda data: heard.setdefault(name, []).append(data.hex()),
            qos.RECORDING,
            raw=True,
        )

    listen(names.CLOCK, Clock)
    listen(names.CONTROL_FORCE, WrenchStamped)
    listen(names.DISTURBANCE_FORCE, WrenchStamped)
    listen(names.RELATIVE_STATE, Odometry)
    while any(len(heard.get(name, ())) < states for name in WANTED):
        rclpy.spin_once(node, timeout_sec=0.1)
    print(json.dumps(heard))


WANTED = ('/clock', '/relative_state', '/control_force', '/disturbance_force')

if __name__ == '__main__':
    main(int(sys.argv[1]))
