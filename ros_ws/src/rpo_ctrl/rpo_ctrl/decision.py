# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Topic `decision`: the reasons of the commanded force, a few times a second."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from rpo_core.chain.decimation import Decimation
from rpo_core.control.explain import Reason
from rpo_core.files.scenario import Scenario
from rpo_core.wire import cdr
from rpo_ros import conversions, names, qos


class DecisionPublisher:
    """Publishes decisions when they are due, each with the stamp of its state.

    rate_hz : decisions per simulated second, by the stamps alone; 0: none
    """

    def __init__(self, node: Node, rate_hz: float) -> None:
        self._decimation = Decimation(rate_hz)
        self._before_ns: int | None = None
        self._explained_ns: int | None = None
        self._out = node.create_publisher(DiagnosticArray, names.DECISION, qos.LOCKSTEP)

    def offer(
        self,
        stamp_ns: int,
        scenario: Scenario | None,
        label: str,
        explain: Callable[[], tuple[bytes, Sequence[Reason]]],
    ) -> None:
        """Publish the decision on a state if it is due; a repeated state gets it again.

        scenario : of the run; without it, the state before decides what is due
        label : controller and hash of its file
        explain : returns the level, and the reasons of x, y, z
        """
        if not self._is_due(stamp_ns, scenario):
            return
        level, reasons = explain()
        statuses = [
            cdr.Status(level[0], f'decision: {axis}', sentence, label, conversions.texts_of(pairs))
            for axis, (sentence, pairs) in zip('xyz', reasons, strict=True)
        ]
        self._out.publish(cdr.encode_array(stamp_ns, names.LVLH_FRAME, statuses))

    def _is_due(self, stamp_ns: int, scenario: Scenario | None) -> bool:
        tick = scenario.tick_of(stamp_ns) if scenario is not None else None
        if scenario is not None and tick is not None:  # a foreign state before changes nothing
            before_ns = scenario.stamp_ns(tick - 1) if tick else None
            return self._decimation.due(stamp_ns, before_ns)
        if self._decimation.due(stamp_ns, self._before_ns):
            self._explained_ns = stamp_ns
        self._before_ns = stamp_ns
        return stamp_ns == self._explained_ns
