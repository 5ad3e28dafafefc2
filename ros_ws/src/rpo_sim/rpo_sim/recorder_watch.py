# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The recorder as the plant sees it: present, ready, closed or gone."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus

from rpo_ros import names, qos
from rpo_ros.running import FlightNode
from rpo_ros.timeout import Timeout

LEASE_S = 5.0
"""Longest silence of a live recorder: it publishes its status once a second."""


class RecorderWatch:
    """Listens to `recorder_status`.

    lost : it was ready and publishes no more
    """

    def __init__(self, node: FlightNode, insist: bool) -> None:
        self._node, self._insist = node, insist
        self._status, self._timeout = '', Timeout()
        self.lost = False
        node.create_subscription(
            DiagnosticStatus, names.RECORDER_STATUS, self._on_status, qos.LATCHED
        )

    def _on_status(self, message: DiagnosticStatus) -> None:
        self._status = message.message
        self._timeout.broken()

    def forget(self) -> None:
        """Expect another recorder: a new run begins."""
        self._status, self.lost = '', False

    @property
    def awaited(self) -> bool:
        """Whether a run must wait until it is ready."""
        there = self._insist or self._node.count_publishers(names.RECORDER_STATUS) > 0
        return there and self._status != 'ready'

    @property
    def done(self) -> bool:
        """Whether it needs nothing more from the plant."""
        return self._status in ('', 'closed') or self.lost

    def look(self) -> bool:
        """Return whether it was ready and publishes no more; call it often."""
        self.lost = self._timeout.look() > LEASE_S and self._status == 'ready'
        return self.lost
