# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Signals on topics: bytes in, numbers out, and back. The loop makes no message object.

Statuses, which come now and then, pass through their reader.

To make, publish or take a message object costs ten times as much as its bytes. The table of
interfaces knows the place of each number in the bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cache, lru_cache
from importlib import import_module
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import QoSProfile

from rpo_core.stage import Signal
from rpo_core.wire import cdr, interfaces, statuses
from rpo_ros import qos

Taker = Callable[[int, Signal], None]
"""Takes the stamp [ns] and the numbers of a message."""


@cache
def message_class(type_name: str) -> Any:
    """Return the class of a ROS type like nav_msgs/msg/Odometry."""
    package, _, name = type_name.split('/')
    return getattr(import_module(f'{package}.msg'), name)


class Outlet:
    """Publishes a signal, with what travels in its message."""

    def __init__(self, node: Node, name: str) -> None:
        self.name, row = name, interfaces.row_of(name)
        self._encode, self._numbers_of = row.layout.encode, row.whole
        self.publisher = node.create_publisher(message_class(row.type), row.topic, qos.of(row.qos))
        self._send = self.publisher.handle.publish_raw  # rclpy asks each time whether it is bytes

    def fly_in(self, scenario: Any) -> None:
        """Publish in the axes that a scenario has for the signal."""
        self._encode = interfaces.row_of(self.name).layout_in(scenario).encode

    def publish_of(self, stamp_ns: int, signals: Mapping[str, Signal]) -> bytes:
        """Publish a signal, with what travels in its message; return the bytes."""
        return self.publish(stamp_ns, self._numbers_of(signals))

    def publish(self, stamp_ns: int, values: Signal) -> bytes:
        """Publish the numbers at a stamp; return the bytes, so that they can be published again."""
        data = self._encode(stamp_ns, values)
        self._send(data)
        return data


def listen(
    node: Node,
    name: str,
    take: Taker,
    ignore: Callable[[str], Any],
    *,
    with_rider: bool = False,
) -> Any:
    """Subscribe to a signal as the nodes in the loop do; return the subscription.

    take : gets the stamp and the numbers of each message that can be used
    ignore : gets the reason why a message cannot be used
    with_rider : whether `take` gets the numbers that travel in the message too
    """
    row = interfaces.row_of(name)
    width = len(row.columns)
    width += len(interfaces.row_of(row.rider).columns) if with_rider and row.rider else 0
    use, kind = row.layout.use, message_class(row.type)

    def on_message(data: bytes) -> None:
        fault, stamp_ns, values = use(data)
        if fault:
            ignore(fault)
        else:
            take(stamp_ns, values if len(values) == width else values[:width])

    return node.create_subscription(kind, row.topic, on_message, qos.IN_LOOP, raw=True)


def hear(
    node: Node,
    reader: type[statuses.Reader],
    take: Callable[[Any], Any],
    profile: QoSProfile = qos.LATCHED_QUEUE,
) -> Any:
    """Subscribe to the statuses of a topic; return the subscription.

    take : gets what a status says, whole; the node refuses one that is not
    """

    @lru_cache(maxsize=16)  # nodes say the same again and again, manifests at length
    def read(data: bytes) -> statuses.Reader:
        return reader.of(cdr.decode_status(data))

    def on_status(data: bytes) -> None:
        take(read(data))

    return node.create_subscription(DiagnosticStatus, reader.topic, on_status, profile, raw=True)


def to_status(
    level: bytes, name: str, message: str, values: Iterable[tuple[str, object]]
) -> DiagnosticStatus:
    """Return a DiagnosticStatus; values become texts, as `texts_of` makes them."""
    return DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        hardware_id='none',
        values=[KeyValue(key=key, value=text) for key, text in texts_of(values)],
    )


def packed_status(name: str, message: str, values: Iterable[tuple[str, object]]) -> bytes:
    """Return a DiagnosticStatus of level OK as bytes, always the same for the same content."""
    return cdr.encode_status(0, name, message, 'none', texts_of(values))


def texts_of(values: Iterable[tuple[str, object]]) -> tuple[tuple[str, str], ...]:
    """Return keys and values as texts, floats by repr so that no digit is lost."""
    return tuple([(k, v if isinstance(v, str) else repr(v)) for k, v in values])
