# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Health of a node on /diagnostics at 1 Hz, and its manifest: files and parameters it runs with.

diagnostic_updater is not in the wheels; one array a second needs no more than this.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from rpo_ros import names, qos
from rpo_ros.conversions import to_status

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

Health = tuple[bytes, str, Mapping[str, Any]]
"""Level, message, values."""


def publish_health(node: Node, health: Callable[[], Health]) -> None:
    """Publish `health()` on /diagnostics once a second of wall time."""
    publisher = node.create_publisher(DiagnosticArray, names.DIAGNOSTICS, qos.DIAGNOSTICS)
    name = f'{node.get_fully_qualified_name().lstrip("/")}: health'

    def publish() -> None:
        level, message, values = health()
        array = DiagnosticArray()
        array.header.stamp = Clock(clock_type=ClockType.SYSTEM_TIME).now().to_msg()
        array.status = [to_status(level, name, message, values.items())]
        publisher.publish(array)

    node.create_timer(1.0, publish, clock=Clock(clock_type=ClockType.STEADY_TIME))


def publish_manifest(
    node: Node, role: str, parameters: Mapping[str, Any], files: Mapping[str, str]
) -> None:
    """Publish, latched, what a node runs with, for the recorder to attach to the log.

    Said again every second: the first latched sample reaches a late reader only with DDS's next
    heartbeat, seconds later.

    role : 'plant', 'controller' or 'disturbance'
    parameters : those that shape the flight; none that concern wall time
    files : name of the attachment -> its text
    """
    publisher = node.create_publisher(DiagnosticStatus, names.NODE_MANIFEST, qos.LATCHED)
    values = [
        ('role', role),
        *((f'parameter.{key}', value) for key, value in sorted(parameters.items())),
        *((f'file.{name}', text) for name, text in sorted(files.items())),
    ]
    manifest = to_status(OK, node.get_name(), 'manifest', values)
    publisher.publish(manifest)
    steady = Clock(clock_type=ClockType.STEADY_TIME)
    node.create_timer(1.0, lambda: publisher.publish(manifest), clock=steady)
