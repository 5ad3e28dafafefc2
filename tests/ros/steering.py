# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A hand on a running simulator: its services and parameters, what it says of itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from inside import call
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

from rpo_core.wire import interfaces
from rpo_ros import names, qos

DEADLINE_S = 60.0


class Steering:
    """Calls the plant's services; remembers run_status and the health of every node.

    statuses : (phase, level, reason, values) as they came
    health : node -> (wall time when it was said, level, message, values) as they came
    """

    def __init__(self, context: rclpy.Context) -> None:
        self.node = rclpy.create_node('steering', context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self.statuses: list[tuple[str, bytes, str, dict[str, str]]] = []
        self.health: dict[str, list[tuple[float, bytes, str, dict[str, str]]]] = {}
        self.node.create_subscription(
            DiagnosticStatus, interfaces.RUN_STATUS, self._on_status, qos.LATCHED_QUEUE
        )
        self.node.create_subscription(
            DiagnosticArray, names.DIAGNOSTICS, self._on_health, qos.DIAGNOSTICS
        )

    def _on_status(self, status: DiagnosticStatus) -> None:
        values = {pair.key: pair.value for pair in status.values}
        self.statuses.append((values['phase'], status.level, status.message, values))

    def _on_health(self, array: DiagnosticArray) -> None:
        said_s = array.header.stamp.sec + 1e-9 * array.header.stamp.nanosec
        for status in array.status:
            values = {pair.key: pair.value for pair in status.values}
            name = status.name.partition(':')[0]
            said = (said_s, status.level, status.message, values)
            self.health.setdefault(name, []).append(said)

    def until(self, condition: Callable[[], Any], deadline_s: float = DEADLINE_S) -> Any:
        """Spin until the condition is true; return its value, fail at the deadline."""
        end = time.monotonic() + deadline_s
        while not (value := condition()):
            if time.monotonic() > end:
                raise AssertionError(f'not in {deadline_s} s; last {self.statuses[-3:]}')
            self._executor.spin_once(timeout_sec=0.02)
        return value

    def passes(self, seconds: float) -> None:
        """Spin for a time."""
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > end, seconds + 1.0)

    def says(self, reason: str, deadline_s: float = DEADLINE_S) -> dict[str, str]:
        """Wait until run_status gives a reason; return its values."""

        def said() -> list[dict[str, str]]:
            return [values for _, _, text, values in self.statuses if reason in text]

        return self.until(said, deadline_s)[-1]

    def call(self, kind: type, service: str, request: Any) -> Any:
        """Call a service and return the response."""
        return call(self.node, self.until, kind, service, request)

    def pause(self, data: bool = True) -> Any:
        """Pause, or resume."""
        return self.call(SetBool, 'plant/pause', SetBool.Request(data=data))

    def trigger(self, name: str) -> Any:
        """Call ~/step, ~/reset or ~/abort of the plant."""
        return self.call(Trigger, f'plant/{name}', Trigger.Request())

    def set(self, node: str, **values: Any) -> list[str]:
        """Set parameters of a node; return why each was refused, '' if it was not."""
        request = SetParameters.Request(
            parameters=[
                Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
            ]
        )
        found = self.call(SetParameters, f'{node}/set_parameters', request)
        return ['' if result.successful else result.reason for result in found.results]


@contextmanager
def steering() -> Iterator[Steering]:
    """Yield a Steering in the ROS domain of the test."""
    context = rclpy.Context()
    rclpy.init(context=context)
    hand = Steering(context)
    try:
        yield hand
    finally:
        hand.node.destroy_node()
        rclpy.shutdown(context=context)
