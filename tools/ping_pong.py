# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Two bare rclpy processes that answer each other: the lower bound of any loop of two ROS nodes.

    ros2 run rpo_bringup ping_pong             prints round trips a second

No parameters, checks, metrics or recorder: one message type, a callback that publishes. Quality of
service and executor are those of the flight nodes.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time

import rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import Executor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from rpo_ros import qos
from rpo_ros.running import new_executor

PING, PONG = 'ping', 'pong'
_WARM_UP = 200
_START_S = 30.0


def _node(topic: str) -> tuple[Node, Publisher, Executor]:
    """Return a node, its publisher of a topic and its executor."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node, executor = rclpy.create_node(topic), new_executor()
    executor.add_node(node)
    return node, node.create_publisher(Odometry, topic, qos.LOCKSTEP), executor


def _answer() -> None:
    """Send back every message, until none has come for a second."""
    node, publisher, executor = _node(PONG)
    heard = time.monotonic() + _START_S

    def on_ping(message: Odometry) -> None:
        nonlocal heard
        heard = time.monotonic()
        publisher.publish(message)

    node.create_subscription(Odometry, PING, on_ping, qos.LOCKSTEP)
    while time.monotonic() - heard < 1.0:
        executor.spin_once(timeout_sec=0.2)
    rclpy.try_shutdown()


def _ask(count: int) -> float:
    """Return round trips per second; raises TimeoutError if no answer comes."""
    node, publisher, executor = _node(PING)
    message, trips, began = Odometry(), 0, 0.0

    def on_pong(answer: Odometry) -> None:
        nonlocal trips, began
        if answer.header.stamp.nanosec != trips:  # only one message at a time
            return
        trips += 1
        message.header.stamp.nanosec = trips
        if trips == _WARM_UP:
            began = time.perf_counter()
        publisher.publish(message)

    node.create_subscription(Odometry, PONG, on_pong, qos.LOCKSTEP)
    deadline = time.monotonic() + _START_S
    while not trips and time.monotonic() < deadline:
        if node.count_subscribers(PING) and node.count_publishers(PONG):
            publisher.publish(message)
        executor.spin_once(timeout_sec=0.2)
    while 0 < trips < count + _WARM_UP:
        executor.spin_once(timeout_sec=1.0)
    passed = time.perf_counter() - began
    rclpy.try_shutdown()
    if not trips:
        raise TimeoutError(f'no answer within {_START_S:g} s')
    return (trips - _WARM_UP) / passed


def main() -> int:
    """Entry point of `ros2 run rpo_bringup ping_pong`."""
    parser = argparse.ArgumentParser(
        prog='ping_pong',
        description='Round trips a second between two bare rclpy processes.',
        epilog='example: ros2 run rpo_bringup ping_pong --count 5000',
    )
    parser.add_argument('--count', type=int, default=4000, help='round trips (%(default)s)')
    parser.add_argument('--answer', action='store_true', help=argparse.SUPPRESS)
    options = parser.parse_args(remove_ros_args(sys.argv)[1:])
    if options.answer:
        _answer()
        return 0
    command = [sys.executable, __file__, '--answer']
    with subprocess.Popen(command) as other:
        try:
            print(f'{_ask(options.count):.1f} round trips/s')
        except TimeoutError as error:
            print(error, file=sys.stderr)
            return 1
        finally:
            other.terminate()
    return 0


if __name__ == '__main__':
    sys.exit(main())
