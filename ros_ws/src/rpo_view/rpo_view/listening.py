# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The newest message of a topic, taken when a viewer looks; a node that listens to a run so.

At full speed a run publishes thousands of states a second; a callback for each would use a whole
processor. Here the middleware keeps the last message, and Python takes only that.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from rpo_core.wire import interfaces
from rpo_core.wire.statuses import Manifest, RunStatus
from rpo_ros import conversions, qos
from rpo_ros.conversions import values_of
from rpo_ros.running import FlightNode
from rpo_ros.signals import hear, message_class
from rpo_view.live import LiveRun


class _Unspun(CallbackGroup):
    """Keeps its subscriptions away from the executor."""

    def can_execute(self, entity: object) -> bool:
        return False

    def beginning_execution(self, entity: object) -> bool:
        return False

    def ending_execution(self, entity: object) -> None:
        """Do nothing."""


class Latest:
    """The newest message of one topic; its node is a `ListeningNode`."""

    def __init__(self, node: Node, topic: str) -> None:
        kind = message_class(interfaces.row_of(topic).type)
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
            return deserialize_message(newest, topic.msg_type)
        except RuntimeError:  # bytes that are no message of this type
            return None


class ListeningNode(FlightNode):
    """Fills `live` when it looks. Only the stock executor, which runs it, respects its groups."""

    executor_kind = SingleThreadedExecutor
    package = 'rpo_view'

    def __init__(self, name: str, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__(name, overrides)
        self.live = LiveRun()
        self.topic = self.resolve_topic_name(interfaces.RELATIVE_STATE)
        self._state = Latest(self, interfaces.RELATIVE_STATE)
        self._forces = {
            'force_n': Latest(self, interfaces.CONTROL_FORCE),
            'disturbance_n': Latest(self, interfaces.DISTURBANCE_FORCE),
            'exerted_n': Latest(self, interfaces.EXERTED_FORCE),
        }
        self._decisions = Latest(self, interfaces.DECISION)
        hear(self, RunStatus, self.live.on_status)
        hear(self, Manifest, self.live.on_manifest)

    def look(self) -> bool:
        """Take the newest message of each topic; return whether a state came.

        Other frames, and what is not finite, are skipped.
        """
        heard = self._hear()
        for name, newest in self._forces.items():
            force = newest.take()
            if force is not None:
                values = conversions.from_wrench(force)
                if not conversions.fault_of(force, values):
                    setattr(self.live, name, values)
        decision = self._decisions.take()
        for status in decision.status if decision is not None else ():
            axis = status.name.rpartition(': ')[2]
            self.live.on_decision(axis, status.message, values_of(status))
        return heard

    def _hear(self) -> bool:
        """Take the newest state; return whether a sound one came."""
        message = self._state.take()
        values = () if message is None else conversions.from_odometry(message)
        if message is None or conversions.fault_of(message, values):
            return False
        stamp_ns = conversions.from_stamp(message.header.stamp)
        self.live.on_state(stamp_ns, values, conversions.attitude_of(message))
        return True
