# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A controller with bad manners: every third answer comes with a wrong one, or not at all."""

import contextlib
import math

import rclpy
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from rpo_core.control.controller import load_controller
from rpo_ros import conversions, qos

WRONG = (9.0, 9.0, 9.0)
DT_NS = 100_000_000
FAULTS = ('nan', 'frame', 'late', 'early', 'twice', 'lost')


def answers(count: int, stamp_ns: int, force: tuple[float, ...]) -> list[WrenchStamped]:
    """Return what is published for one state."""

    def wrench(shift_ns: int, values: tuple[float, ...]) -> WrenchStamped:
        return conversions.to_wrench(conversions.to_stamp(stamp_ns + shift_ns), values)

    right = wrench(0, force)
    turn, rest = divmod(count, 3)
    if rest:
        return [right]
    wrong_frame = wrench(0, WRONG)
    wrong_frame.header.frame_id = 'chaser'
    return {
        'nan': [wrench(0, (math.nan, 0.0, math.inf)), right],
        'frame': [wrong_frame, right],
        'late': [wrench(-DT_NS, WRONG), right],
        'early': [wrench(20 * DT_NS, WRONG), right],
        'twice': [right, right],
        'lost': [],
    }[FAULTS[turn % len(FAULTS)]]


def main() -> None:
    rclpy.init()
    node = Node('rude_controller')
    controller = load_controller('handmade')
    publisher = node.create_publisher(WrenchStamped, 'control_force', qos.LOCKSTEP)
    count = 0

    def on_state(message: Odometry) -> None:
        nonlocal count
        count += 1
        state = conversions.from_odometry(message)
        force = controller.force_n(state[:3], state[3:])
        stamp_ns = conversions.from_stamp(message.header.stamp)
        for answer in answers(count, stamp_ns, force):
            publisher.publish(answer)

    node.create_subscription(Odometry, 'relative_state', on_state, qos.LOCKSTEP)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)


if __name__ == '__main__':
    main()
