# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the plant publishes, and how."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rosgraph_msgs.msg import Clock

from rpo_core.kernels import State
from rpo_ros import conversions, names, qos
from rpo_ros.running import FlightNode
from rpo_sim.plant import ZERO, Force


class Publications:
    """The plant's topics: /clock, states, run_status, and in free running the forces flown.

    applied : topics of the forces flown
    """

    def __init__(self, node: FlightNode, clock: bool, applied: Sequence[str]) -> None:
        self._state = node.create_publisher(Odometry, names.RELATIVE_STATE, qos.LOCKSTEP)
        self._status = node.create_publisher(DiagnosticStatus, names.RUN_STATUS, qos.LATCHED)
        self._clock = node.create_publisher(Clock, names.CLOCK, qos.CLOCK) if clock else None
        self._applied = {
            topic: node.create_publisher(WrenchStamped, topic, qos.LOCKSTEP) for topic in applied
        }

    def state(self, stamp_ns: int, state: State) -> None:
        """Publish a state, and before it its time on /clock."""
        if self._clock is not None:
            self._clock.publish(conversions.to_clock(stamp_ns))
        self._state.publish(conversions.to_odometry(stamp_ns, state))

    def applied(self, stamp_ns: int, forces: Mapping[str, Force]) -> None:
        """Publish the forces, by topic, that act in the tick of a stamp."""
        for topic, force in forces.items():
            stamp = conversions.to_stamp(stamp_ns)
            self._applied[topic].publish(conversions.to_wrench(stamp, force))

    def before_flight(self, stamp_ns: int) -> None:
        """Let a recorder hear the topics of the forces flown, with a stamp before the first."""
        self.applied(stamp_ns, dict.fromkeys(self._applied, ZERO))

    def status(self, level: bytes, reason: str, values: Mapping[str, Any]) -> None:
        """Publish run_status."""
        self._status.publish(conversions.to_status(level, 'run', reason, values.items()))

    def last_words(self, most_s: float) -> None:
        """Wait until everybody has the last run_status."""
        self._status.wait_for_all_acked(Duration(seconds=0, nanoseconds=round(most_s * 1e9)))
