# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A node that takes the newest messages of a flight when it looks.

At full speed a run publishes thousands of states a second; a callback for each would use a whole
processor. Here the middleware keeps the last messages, and Python takes only those.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from rpo_bringup.views.live import LiveFlight, Vector
from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import Interface
from rpo_core.wire.statuses import AssuranceStatus, GuidanceStatus, Manifest, RunStatus
from rpo_ros import qos
from rpo_ros.running import FlightNode
from rpo_ros.signals import hear, message_class


class _Unspun(ReentrantCallbackGroup):
    """Keeps its subscriptions away from the executor."""

    def can_execute(self, entity: object) -> bool:
        return False


class Latest:
    """The newest messages of one topic; its node is a `ListeningNode`.

    numbers : stamp [ns] -> those of a message that can be used, the newest last
    """

    def __init__(self, node: Node, row: Interface) -> None:
        self._use, self._row = row.layout.use, row
        self.numbers: dict[int, Vector] = {}
        self._subscription = node.create_subscription(
            message_class(row.type), row.topic, lambda _: None, qos.NEWEST,
            callback_group=_Unspun(), raw=True,
        )  # fmt: skip

    def take(self) -> None:
        """Take what came since the last look."""
        topic, numbers = self._subscription, self.numbers
        with topic.handle:
            while taken := topic.handle.take_message(topic.msg_type, True):
                fault, stamp_ns, values = self._use(taken[0])
                if fault:
                    continue
                if numbers and stamp_ns < next(reversed(numbers)):  # another flight
                    numbers.clear()
                numbers[stamp_ns] = values
        while len(numbers) > qos.NEWEST.depth:
            del numbers[next(iter(numbers))]

    def signals(self, stamp_ns: int) -> dict[str, Vector]:
        """Return the signal of a stamp, and what rides in its message, by name."""
        if stamp_ns not in self.numbers:
            return {}
        values, own = self._row.spoken(self.numbers[stamp_ns]), len(self._row.columns)
        riding = {self._row.rider: values[own:]} if len(values) > own else {}
        return {self._row.name: values[:own], **riding}


class ListeningNode(FlightNode):
    """Fills `live` when it looks. Only the stock executor, which runs it, respects its groups."""

    executor_kind = SingleThreadedExecutor
    package = 'rpo_bringup'

    def __init__(self, name: str, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__(name, overrides)
        self.live = LiveFlight()
        self.topic = self.resolve_topic_name(interfaces.RELATIVE_STATE)
        self._latest = {
            row.name: Latest(self, row)
            for row in interfaces.rows(logged=True)
            if row.due != interfaces.EVENT and row.columns
        }
        hear(self, RunStatus, self.live.on_status)
        hear(self, Manifest, self.live.on_manifest)
        hear(self, GuidanceStatus, self.live.on_guidance)
        hear(self, AssuranceStatus, self.live.on_assurance)

    def look(self) -> bool:
        """Take the newest messages of one tick; return whether a sound state came."""
        for latest in self._latest.values():
            latest.take()
        stamps = self._latest[interfaces.RELATIVE_STATE].numbers.keys()
        for latest in self._latest.values():  # the newest tick of which the most is there
            stamps = stamps & latest.numbers.keys() or stamps
        if not stamps:
            return False
        signals: dict[str, Vector] = {}
        for latest in self._latest.values():
            signals |= latest.signals(max(stamps))
        return self.live.on_signals(max(stamps), signals)
