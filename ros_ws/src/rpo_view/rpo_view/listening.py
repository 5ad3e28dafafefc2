# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The common part of the page and the terminal view: a node that listens to a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from rpo_core import interfaces
from rpo_ros import conversions, names, qos
from rpo_ros.conversions import values_of
from rpo_ros.running import FlightNode
from rpo_view.latest import Latest
from rpo_view.live import LiveRun


class ListeningNode(FlightNode):
    """Fills `live` when it looks; run it by `run_viewer`."""

    def __init__(self, name: str, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__(name, overrides)
        self.live = LiveRun()
        self.topic = self.resolve_topic_name(names.RELATIVE_STATE)
        self._states = Latest(self, names.RELATIVE_STATE)
        self._forces = {
            'force_n': Latest(self, names.CONTROL_FORCE),
            'disturbance_n': Latest(self, names.DISTURBANCE_FORCE),
            'exerted_n': Latest(self, interfaces.EXERTED_FORCE),
        }
        self._decisions = Latest(self, names.DECISION)
        for topic, react in (
            (names.RUN_STATUS, self._on_status),
            (names.NODE_MANIFEST, self._on_manifest),
        ):
            self.create_subscription(DiagnosticStatus, topic, react, qos.LATCHED_QUEUE)

    def look(self) -> None:
        """Take the newest message of each topic; skip other frames and what is not finite."""
        state = self._states.take()
        if state is not None:
            values = conversions.from_odometry(state)
            if not conversions.fault_of(state, values):
                self.live.on_state(conversions.from_stamp(state.header.stamp), values)
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

    def _on_status(self, status: DiagnosticStatus) -> None:
        self.live.on_status(status.message, values_of(status))

    def _on_manifest(self, manifest: DiagnosticStatus) -> None:
        self.live.on_manifest(values_of(manifest))
