# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the plant publishes, and how."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock

from rpo_core import cdr, interfaces
from rpo_core.stage import Signal
from rpo_ros import conversions, names, qos
from rpo_ros.running import FlightNode
from rpo_ros.signals import Outlet
from rpo_sim.plant import ZERO


class Publications:
    """The plant's topics: /clock, states, run_status, and what its stages and pacing make.

    made : signals of the plant's own that are topics
    """

    def __init__(self, node: FlightNode, clock: bool, made: Sequence[str]) -> None:
        self._state = Outlet(node, interfaces.RELATIVE_STATE)
        self._status = node.create_publisher(DiagnosticStatus, names.RUN_STATUS, qos.LATCHED)
        self._clock = node.create_publisher(Clock, names.CLOCK, qos.CLOCK) if clock else None
        self._made = {name: Outlet(node, name) for name in made}

    def state(self, stamp_ns: int, state: Signal) -> None:
        """Publish a state, and after it its time on /clock, which nobody waits for."""
        self._state.publish(stamp_ns, state)
        if self._clock is not None:
            self._clock.publish(cdr.encode_clock(stamp_ns))

    def made(self, stamp_ns: int, signals: Mapping[str, Signal]) -> None:
        """Publish those of some signals that are topics of the plant's own."""
        for name, outlet in self._made.items():
            if name in signals:
                outlet.publish(stamp_ns, signals[name])

    def before_flight(self, stamp_ns: int) -> None:
        """Let a recorder hear the plant's own topics, with a stamp before the first."""
        self.made(stamp_ns, dict.fromkeys(self._made, ZERO))

    def status(self, level: bytes, reason: str, values: Mapping[str, Any]) -> None:
        """Publish run_status."""
        self._status.publish(conversions.to_status(level, 'run', reason, values.items()))

    def last_words(self, most_s: float) -> None:
        """Wait until everybody has the last run_status."""
        self._status.wait_for_all_acked(Duration(seconds=0, nanoseconds=round(most_s * 1e9)))
