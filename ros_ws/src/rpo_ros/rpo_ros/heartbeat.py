# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Signs of life of the nodes of a run: who is gone is named within a second of wall time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from diagnostic_msgs.msg import DiagnosticStatus

from rpo_core.wire import interfaces
from rpo_core.wire.statuses import ALIVE, GONE, Heartbeat
from rpo_ros import qos
from rpo_ros.running import FlightNode
from rpo_ros.signals import hear, packed_status

BEAT_S, SILENT_S, LOOK_S = 0.2, 0.6, 0.05
"""A node that is not heard for SILENT_S is silent; it says something each BEAT_S."""

MOST_STEP_S = 0.25
"""Most time that one look adds: in a longer gap between two looks this process was stopped."""

_MOST = 32
_PROFILE = qos.of(interfaces.row_of(interfaces.HEARTBEAT).qos)


class Timeout:
    """Adds up how long a peer has been silent, look by look.

    A process that was stopped, or got no processor, runs its timers before the messages that wait.
    By the clock alone it would falsely time out its peers.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._silent_s = 0.0
        self._looked_s = clock()

    def broken(self) -> None:
        """Note that a message came."""
        self._silent_s = 0.0

    def look(self) -> float:
        """Return the silence so far [s]; call it often."""
        now_s = self._clock()
        self._silent_s += min(now_s - self._looked_s, MOST_STEP_S)
        self._looked_s = now_s
        return self._silent_s


class Pulse:
    """Publishes the signs of life of a node.

    stages : returns the names of the stages that it runs; without any it says nothing
    """

    def __init__(self, node: FlightNode, stages: Callable[[], Iterable[str]]) -> None:
        self._node, self._stages = node, stages
        self._publisher = node.create_publisher(DiagnosticStatus, interfaces.HEARTBEAT, _PROFILE)
        node.every(BEAT_S, lambda: self.beat(ALIVE))

    def beat(self, says: str) -> None:
        """Publish one: ALIVE, or GONE as the node ends."""
        stages = ', '.join(self._stages())
        if stages:
            values = [('stages', stages)]
            self._publisher.publish(packed_status(self._node.get_name(), says, values))


class Watch:
    """Hears the signs of life of other nodes, and warns when they stop; who sent none is unknown.

    flies : returns whether the run is one in which nobody may be missing
    silent : nodes that were heard and are not any more, each with its stages
    """

    def __init__(self, node: FlightNode, flies: Callable[[], bool]) -> None:
        self._node, self._flies = node, flies
        self._heard: dict[str, Timeout] = {}
        self.silent: dict[str, str] = {}
        self._stages: dict[str, str] = {}
        hear(node, Heartbeat, self._on_beat, qos.IN_LOOP)  # a lost one is not waited for
        node.every(LOOK_S, self._look)

    def _on_beat(self, heartbeat: Heartbeat) -> None:
        name = heartbeat.node
        if name == self._node.get_name() or (name not in self._heard and len(self._heard) >= _MOST):
            return
        self._stages[name] = heartbeat.stages
        if heartbeat.says == GONE:
            self._miss(name, 'has ended')
            return
        self._heard.setdefault(name, Timeout()).broken()
        if self.silent.pop(name, ''):
            self._node.get_logger().info(f'{name} is back')

    def _look(self) -> None:
        for name, timeout in list(self._heard.items()):
            if timeout.look() > SILENT_S and name not in self.silent:
                self._miss(name, f'is silent for {SILENT_S:g} s: gone, or stuck')

    def _miss(self, name: str, how: str) -> None:
        self._heard.pop(name, None)
        if self._flies() and name not in self.silent:
            self.silent[name] = self._stages[name]
            self._node.get_logger().warning(f'{name} ({self._stages[name]}) {how}')
