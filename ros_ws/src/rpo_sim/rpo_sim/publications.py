# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The topics that the plant publishes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock

from rpo_core.chain.chain import Signals
from rpo_core.wire import cdr, interfaces
from rpo_ros import conversions, names, qos
from rpo_ros.running import FlightNode
from rpo_ros.signals import Outlet
from rpo_sim.plant import ZERO


class Publications:
    """The topics of the plant: /clock, states, run_status, outputs of its stages and pacing.

    made : the outputs of stages and pacing that are topics
    """

    def __init__(self, node: FlightNode, clock: bool, made: Sequence[str]) -> None:
        self._state = Outlet(node, interfaces.RELATIVE_STATE)
        self._status = node.create_publisher(DiagnosticStatus, interfaces.RUN_STATUS, qos.LATCHED)
        self._clock = node.create_publisher(Clock, names.CLOCK, qos.CLOCK) if clock else None
        self._made = {name: Outlet(node, name) for name in made}

    def state(self, stamp_ns: int, signals: Signals) -> None:
        """Publish the time of a state on /clock, and then the state: it is in nobody's future."""
        if self._clock is not None:
            self._clock.handle.publish_raw(cdr.encode_clock(stamp_ns))  # as an Outlet does
        self._state.publish_of(stamp_ns, signals)

    def made(self, stamp_ns: int, signals: Signals) -> None:
        """Publish those of some signals that are outputs of the plant."""
        for name, outlet in self._made.items():
            if name in signals:
                outlet.publish_of(stamp_ns, signals)

    def before_flight(self, stamp_ns: int) -> None:
        """Publish the outputs once with a stamp before the first, to connect a recorder."""
        self.made(stamp_ns, dict.fromkeys(self._made, ZERO))

    def status(self, level: bytes, reason: str, values: Mapping[str, Any]) -> None:
        """Publish run_status."""
        self._status.publish(conversions.to_status(level, 'run', reason, values.items()))

    def last_words(self, most_s: float) -> None:
        """Wait until all subscribers have the last run_status."""
        self._status.wait_for_all_acked(Duration(seconds=0, nanoseconds=round(most_s * 1e9)))
