# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Health of a node on /diagnostics at 1 Hz, and its manifest: the files and parameters of its run.

The ROS 2 wheels have no diagnostic_updater.
"""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from rpo_core.wire import interfaces
from rpo_ros import qos
from rpo_ros.running import FlightNode
from rpo_ros.signals import packed_status, to_status

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR

PERIOD_S = 1.0

HARDWARE = platform.node() or 'unknown'
"""Hardware id in diagnostics: the machine that the node runs on."""

Health = tuple[bytes, str, Mapping[str, Any]]
"""Level, message, values."""


class Rate:
    """Rate of a counted event."""

    def __init__(self) -> None:
        self._count, self._moment_s = 0, time.monotonic()

    def per_s(self, count: int) -> float:
        """Return events per second of wall time since the last call; `count` is the total."""
        now_s = time.monotonic()
        events, passed_s = count - self._count, now_s - self._moment_s
        self._count, self._moment_s = count, now_s
        return round(events / passed_s, 1) if passed_s > 0.0 else 0.0


def age_s(moment_s: float | None) -> float:
    """Return the wall time since a moment of `time.monotonic()`, rounded to 1 ms; None gives -1."""
    return -1.0 if moment_s is None else round(time.monotonic() - moment_s, 3)


def publish_health(node: FlightNode, health: Callable[[], Health]) -> None:
    """Publish `health()` on /diagnostics once a second of wall time.

    The stamp is of the node's clock, as that of diagnostic_updater: of /clock with `use_sim_time`.
    """
    row = interfaces.row_of(interfaces.DIAGNOSTICS)
    publisher = node.create_publisher(DiagnosticArray, row.topic, qos.of(row.qos))
    name = f'{node.get_fully_qualified_name().lstrip("/")}: health'

    def publish() -> None:
        level, message, values = health()
        array = DiagnosticArray()
        array.header.stamp = node.get_clock().now().to_msg()
        array.status = [to_status(level, name, message, values.items())]
        array.status[0].hardware_id = HARDWARE
        publisher.publish(array)

    node.every(PERIOD_S, publish)


def as_yaml(value: object) -> str:
    """Return a value as YAML that is read back to the same value: quoted only where it must be."""
    if not isinstance(value, str):
        return repr(value)
    try:
        plain = yaml.safe_load(value) == value
    except (yaml.YAMLError, ValueError):  # PyYAML converts unchecked, as 2026-02-30
        plain = False
    return value if plain else json.dumps(value)


def topics_of(node: Node) -> Iterator[tuple[str, str]]:
    """Yield where a node publishes and hears the signals of the table, as a manifest has it."""
    made = {publisher.topic_name for publisher in node.publishers}
    heard = {subscription.topic_name for subscription in node.subscriptions}
    for row in interfaces.rows_so_far():
        if not (row.type and row.logged):
            continue
        name = node.resolve_topic_name(row.topic)
        yield from [(f'publishes.{row.name}', name)] if name in made else []
        yield from [(f'hears.{row.name}', name)] if name in heard else []


class Manifest:
    """The files and parameters of a node, latched; the recorder attaches them to the log.

    It is published again every second: otherwise a late reader gets the latched sample only with
    the next heartbeat of DDS, seconds later.

    role : 'plant', 'controller' or 'disturbance'
    run : id of the plant, so that a recorder tells two plants apart; it is in no log
    """

    def __init__(self, node: FlightNode, role: str, run: str = '') -> None:
        self._run = [('run', run)] if run else []
        self._role, self._name = role, node.get_name()
        self._publisher = node.create_publisher(
            DiagnosticStatus, interfaces.NODE_MANIFEST, qos.LATCHED
        )
        self._values: list[tuple[str, Any]] = []
        self._node = node
        node.every(PERIOD_S, self.repeat)

    def publish(self, parameters: Mapping[str, Any], files: Mapping[str, str]) -> None:
        """Publish the parameters and files that hold from now on.

        parameters : those that shape the flight; none of wall time
        files : name of the attachment -> its text
        """
        self._values = [
            ('role', self._role),
            *self._run,
            *((f'parameter.{key}', as_yaml(value)) for key, value in sorted(parameters.items())),
            *((f'file.{name}', text) for name, text in sorted(files.items())),
        ]
        self.repeat()

    def repeat(self) -> None:
        """Publish it again."""
        if self._values:
            values = [*self._values, *topics_of(self._node)]
            self._publisher.publish(packed_status(self._name, 'manifest', values))
