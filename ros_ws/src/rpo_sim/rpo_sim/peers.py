# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes that take no part in a run, and topics that two nodes publish, by the graph of ROS."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress

from rclpy.node import Node

from rpo_core.chain.chain import Chain, signals_of
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place
from rpo_core.wire import interfaces
from rpo_core.wire.statuses import REFUSED, StageStatus
from rpo_ros.place_node import PLACES
from rpo_ros.running import FlightNode
from rpo_ros.signals import hear

_WAIT_S = 1.0
"""A node that refuses stays for so long; by then its name and its topics are known."""
_MOST = 64


class Refusals:
    """Weighs each refusal: only a node that serves this flight may end it.

    It serves the flight if it publishes or hears one of its signals, on the topics of this plant.
    """

    def __init__(self, node: FlightNode, scenario: Scenario) -> None:
        self._node = node
        rows = (interfaces.row_of(name) for name in signals_of(scenario))
        self._topics = {node.resolve_topic_name(row.topic) for row in rows if row.type}
        self._said: dict[str, tuple[float, str]] = {}
        self._first_s = 0.0
        hear(node, StageStatus, self._on_status)

    def _on_status(self, status: StageStatus) -> None:
        if status.state == REFUSED and len(self._said) < _MOST:
            now_s = time.monotonic()
            self._first_s = self._first_s or now_s
            reason = f'{status.node} takes no part: {status.reason}'
            self._said.setdefault(status.node, (now_s, reason))

    @property
    def in_doubt(self) -> bool:
        """Whether a node that refuses may still be found; at most once for so long."""
        return bool(self._said) and time.monotonic() - self._first_s < _WAIT_S

    def weighed(self) -> list[str]:
        """Return why nodes of this flight take no part; each is returned once."""
        reasons = []
        for name, (said_s, reason) in list(self._said.items()):
            if self._serves(name):
                reasons.append(reason)
            elif time.monotonic() - said_s < _WAIT_S:
                continue
            del self._said[name]
        return reasons

    def _serves(self, name: str) -> bool:
        """Return whether a node of this name is known to serve this flight."""
        node, topics = self._node, set()
        asked = (
            node.get_publisher_names_and_types_by_node,
            node.get_subscriber_names_and_types_by_node,
        )
        for node_name, namespace in node.get_node_names_and_namespaces():
            if node_name == name:
                with suppress(RuntimeError):  # it is gone again
                    topics |= {topic for ask in asked for topic, _ in ask(name, namespace)}
        return bool(self._topics & topics)


def unfilled_roles(node: Node, scenario: Scenario, recorded: bool) -> list[str]:
    """Return a sentence for each role of a flight that nobody fills: its topics, the command.

    recorded : whether a recorder is needed
    """
    links = Chain.of(scenario).links
    made = [(link.place, name) for link in links for name in link.stage.outputs]
    made.append((Place.CONTROLLER, interfaces.CONTROL_FORCE))
    roles = {
        command: [interfaces.row_of(name) for place, name in made if place in places]
        for command, places in PLACES.items()
    }
    if recorded:
        roles['rpo_log recorder'] = [interfaces.row_of(interfaces.RECORDER_STATUS)]
    space = node.get_namespace()
    where = '' if space == '/' else f' --ros-args -r __ns:={space}'
    sentences = []
    for command, rows in roles.items():
        topics = [node.resolve_topic_name(row.topic) for row in rows if row.type]
        if absent := [topic for topic in topics if not node.count_publishers(topic)]:
            start = f'`ros2 run {command}{where}`'
            sentences.append(f'nobody publishes {", ".join(absent)}: start {start}')
    return sentences


_UNKNOWN, _UNNAMED = '_NODE_NAME_UNKNOWN_', 'a node not named yet'
"""A publisher is found some milliseconds before the name of its node."""


class PublisherCheck:
    """Names the publishers of a signal that has more than one, as the graph of ROS has them.

    names : signals to check, on the topics of the node
    doubled : topic -> its publishers, of those that have more than one now
    """

    def __init__(self, node: Node, names: Iterable[str]) -> None:
        self._node = node
        rows = (interfaces.row_of(name) for name in dict.fromkeys(names))
        self._topics = [node.resolve_topic_name(row.topic) for row in rows if row.type]
        self.doubled: dict[str, str] = {}

    def look(self) -> None:
        """Log an error for each topic whose publishers are two or more, and others than before."""
        count = self._node.count_publishers
        doubled = {topic: self._publishers(topic) for topic in self._topics if count(topic) > 1}
        for topic, publishers in doubled.items():
            if publishers != self.doubled.get(topic):
                self._node.get_logger().error(
                    f'{topic} is published by {publishers}; it must have one publisher, because '
                    'the first message of a tick acts: stop the others'
                )
        self.doubled = doubled

    def _publishers(self, topic: str) -> str:
        """Return the full names of the nodes that publish a topic, in one phrase."""
        publishers = Counter(
            _UNNAMED
            if info.node_name == _UNKNOWN
            else f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            for info in self._node.get_publishers_info_by_topic(topic)
        )
        names = [f'{name} {n} times' if n > 1 else name for name, n in sorted(publishers.items())]
        restarted = ' (one that was killed is seen for some seconds more)'
        return ' and '.join(names) + (restarted if max(publishers.values(), default=1) > 1 else '')
