# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The newest message of a topic, taken when a viewer looks.

At full speed a run publishes thousands of states a second; a callback for each would use a whole
processor. Here the middleware keeps the last message, and Python takes only that.
"""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from rpo_core.wire import interfaces
from rpo_ros import qos
from rpo_ros.running import FlightNode
from rpo_ros.signals import message_class


class _Unspun(CallbackGroup):
    """Keeps its subscriptions away from the executor."""

    def can_execute(self, entity: object) -> bool:
        return False

    def beginning_execution(self, entity: object) -> bool:
        return False

    def ending_execution(self, entity: object) -> None:
        """Do nothing."""


class Latest:
    """The newest message of one topic; its node is a `Viewer`.

    kind : of a topic that is not in the table of interfaces
    """

    def __init__(
        self, node: Node, topic: str, *, kind: type | None = None, raw: bool = False
    ) -> None:
        kind = kind or message_class(interfaces.row_of(topic).type)
        self._raw = raw
        self._subscription = node.create_subscription(
            kind, topic, self._never, qos.NEWEST, callback_group=_Unspun(), raw=True
        )

    @staticmethod
    def _never(_message: object) -> None:
        raise RuntimeError('run a viewer by its main')

    def take(self) -> Any:
        """Return the newest message since the last look; None if none came."""
        newest, topic = None, self._subscription
        with topic.handle:
            while taken := topic.handle.take_message(topic.msg_type, True):
                newest = taken[0]
        if newest is None:
            return None
        try:
            message = deserialize_message(newest, topic.msg_type)
        except RuntimeError:  # bytes that are no message of this type
            return None
        return newest if self._raw else message


class Viewer(FlightNode):
    """A node of views, run by the stock executor: only that one respects callback groups."""

    executor_kind = SingleThreadedExecutor
    package = 'rpo_view'
