# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Round trips a second between two bare rclpy processes: the lower bound of any loop of two nodes.

One message type and a callback that publishes; quality of service and executor of the flight nodes.
"""

import subprocess
import sys
import time

import rclpy
from nav_msgs.msg import Odometry
from rclpy.signals import SignalHandlerOptions

from rpo_ros import qos
from rpo_ros.running import new_executor

TRIPS, WARM_UP, START_S = 4000, 200, 30.0


def run(asks: bool) -> float:
    """Ask, or answer until none asks for a second; return round trips per second, 0 for none."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node, executor = rclpy.create_node('ping' if asks else 'pong'), new_executor()
    executor.add_node(node)
    topics = ('ping', 'pong') if asks else ('pong', 'ping')
    publisher = node.create_publisher(Odometry, topics[0], qos.LOCKSTEP)
    trips, began, heard = 0, 0.0, time.monotonic() + START_S

    def take(message: Odometry) -> None:
        nonlocal trips, began, heard
        if asks and message.header.stamp.nanosec != trips:  # only one message at a time
            return
        trips, heard = trips + 1, time.monotonic()
        if asks:
            message.header.stamp.nanosec = trips
            began = time.perf_counter() if trips == WARM_UP else began
        publisher.publish(message)

    node.create_subscription(Odometry, topics[1], take, qos.LOCKSTEP)
    while time.monotonic() - heard < 1.0 and trips < (TRIPS + WARM_UP if asks else sys.maxsize):
        if asks and not trips and publisher.get_subscription_count():
            publisher.publish(Odometry())
        executor.spin_once(timeout_sec=0.2)
    rate = TRIPS / (time.perf_counter() - began) if trips > TRIPS else 0.0
    rclpy.try_shutdown()
    return rate


def main() -> int:
    """Entry point of `ros2 run rpo_bringup ping_pong`."""
    if sys.argv[1:2] == ['--answer']:
        run(asks=False)
        return 0
    with subprocess.Popen([sys.executable, __file__, '--answer']) as other:
        rate = run(asks=True)
        other.terminate()
    print(f'{rate:.1f} round trips/s')
    return int(not rate)


if __name__ == '__main__':
    sys.exit(main())
