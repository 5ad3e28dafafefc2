# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What controller and injector have in common: a force for each state, with the state's stamp."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections import Counter
from collections.abc import Mapping
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.duration import Duration

from rpo_ros import conversions, health, names, qos
from rpo_ros.running import FlightNode

Force = tuple[float, float, float]

_LAST_FORCE = Duration(seconds=0, nanoseconds=200_000_000)
"""Longest wait, at the end, for listeners to acknowledge."""

SILENT_S = 3.0
"""A plant that flies and sends no state for so long is gone; a warning within a second of that."""


class AnsweringNode(FlightNode):
    """Answers each relative state with a force that follows from that state and its stamp alone.

    So it may start, stop and be asked again at any time, and two answers to one state are the same.
    A state that cannot be answered is counted by the reason in `ignored`.
    """

    def __init__(self, name: str, overrides: Mapping[str, Any] | None) -> None:
        super().__init__(name, overrides)
        self.answered = 0
        self.ignored: Counter[str] = Counter()
        self._answered_s: float | None = None
        self._rate = health.Rate()
        self._plant_phase = ''

    def answer_on(self, topic: str) -> None:
        """Begin to answer; the subclass is ready."""
        self._force = self.create_publisher(WrenchStamped, topic, qos.LOCKSTEP)
        self.create_subscription(Odometry, names.RELATIVE_STATE, self._on_state, qos.IN_LOOP)
        self.create_subscription(
            DiagnosticStatus, names.RUN_STATUS, self._on_run_status, qos.LATCHED
        )
        health.publish_health(self, self.health)

    @abstractmethod
    def force_n(self, stamp_ns: int, state: tuple[float, ...]) -> Force | str:
        """Return the force [N], target LVLH, or why there is none.

        state : x, y, z [m], vx, vy, vz [m/s], target LVLH, finite
        """

    def after_answer(self, stamp: Time, state: tuple[float, ...], force: Force) -> None:
        """Do what may wait until the force is on its way."""

    def _on_run_status(self, status: DiagnosticStatus) -> None:
        values = {pair.key: pair.value for pair in status.values}
        self._plant_phase = values.get('phase', '')

    @property
    def plant_gone(self) -> bool:
        """Whether states have ceased though the last word of the plant was that it flies."""
        flying = self._plant_phase == 'running' and self._answered_s is not None
        return flying and health.age_s(self._answered_s) > SILENT_S

    def close(self) -> None:
        """Let the last force arrive: the log would lack it."""
        if hasattr(self, '_force'):
            self._force.wait_for_all_acked(_LAST_FORCE)

    def _on_state(self, message: Odometry) -> None:
        state = conversions.from_odometry(message)
        stamp = message.header.stamp
        force = conversions.fault_of(message, state) or self.force_n(
            conversions.from_stamp(stamp), state
        )
        if isinstance(force, str):
            self.ignored[force] += 1
            return
        self._force.publish(conversions.to_wrench(stamp, force))
        self.answered += 1
        self._answered_s = time.monotonic()
        self.after_answer(stamp, state, force)

    def health(self) -> health.Health:
        """Return what /diagnostics says of this node."""
        ignored = {f'ignored_{kind}': count for kind, count in sorted(self.ignored.items())}
        values = {
            'answered': self.answered,
            'rate_hz': self._rate.per_s(self.answered),
            'command_age_s': health.age_s(self._answered_s),
            **ignored,
        }
        if self.plant_gone:
            return health.WARN, 'no states: the plant is gone', values
        return health.WARN if ignored else health.OK, 'answering states', values
