# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Topics of a flight that two nodes publish: the first message of a tick acts, whoever sent it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from rclpy.node import Node

from rpo_core.wire import interfaces

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
        found = Counter(
            _UNNAMED
            if info.node_name == _UNKNOWN
            else f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            for info in self._node.get_publishers_info_by_topic(topic)
        )
        names = [f'{name} {n} times' if n > 1 else name for name, n in sorted(found.items())]
        restarted = ' (one that was killed is seen for some seconds more)'
        return ' and '.join(names) + (restarted if max(found.values(), default=1) > 1 else '')
