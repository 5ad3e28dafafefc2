# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `monitor`: checks a run against limits, and warns, deactivates the controller or aborts.

A table of limits (shipped: `config/monitors/default.yaml`) says for each fault in how many of the
last samples it must appear, and the reaction: `warn`; `coast`, the monitor deactivates the
controller, which then commands zero; `abort`, the plant ends the run. The faults are
`not_finite`, `out_of_range`, `too_fast` for its range, `off_corridor`, `force_saturated`,
`force_stale`, `controller_inactive`. A sample is a new state, a command, a message on
`/diagnostics`, or, for `force_stale`, a fifth of a second of wall time. The monitor publishes every
fault on `/diagnostics`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import Odometry
from rclpy.client import Client
from rclpy.task import Future
from std_srvs.srv import Trigger

from rpo_attitude.target import TARGET_ATTITUDE
from rpo_core.files.validation import choice
from rpo_core.wire import interfaces
from rpo_core.wire.statuses import RUNNING, RunStatus
from rpo_ros import conversions, health, names, qos
from rpo_ros.heartbeat import Timeout
from rpo_ros.running import FlightNode
from rpo_ros.signals import hear
from rpo_safety.limit_checker import ABORT, COAST, WARN, Detection, LimitChecker, load_monitor

_LOOK_S = 0.2
_LABELS = ('unconfigured', 'inactive', 'active', 'finalized')
"""States of a controller's lifecycle, in its health."""


class MonitorNode(FlightNode):
    """Samples states, commands and diagnostics; reacts once at the start of a fault."""

    package = 'rpo_bringup'

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('monitor', overrides)
        self.table = load_monitor(self.values['table'])
        self.checker = LimitChecker(self.table.rules)
        self.phase = ''
        self.reacted: dict[str, str] = {}
        self._fresh: set[str] = set()
        self.answers: dict[str, str] = {}
        self._timeout = Timeout()
        self._newest_ns = 0
        self._attitude = (0.0, 0.0, 0.0, 1.0)  # of the target; without section `target` none comes
        self._pending: dict[str, Client] = {}
        controller, plant = self.values['controller_node'], self.values['plant_node']
        self._coast = self.create_client(ChangeState, f'{controller}/change_state')
        self._abort = self.create_client(Trigger, f'{plant}/abort')
        self._watched = f'{self.resolve_topic_name(controller).lstrip("/")}: health'
        self._subscribe()
        self.every(_LOOK_S, self._look)
        health.publish_health(self, self._health)
        self.get_logger().info(f'checking the limits of table {self.table.name}')

    def _subscribe(self) -> None:
        self.create_subscription(Odometry, interfaces.RELATIVE_STATE, self._on_state, qos.LOCKSTEP)
        self.create_subscription(Odometry, TARGET_ATTITUDE, self._on_attitude, qos.LOCKSTEP)
        self.create_subscription(
            WrenchStamped, interfaces.CONTROL_FORCE, self._on_force, qos.LOCKSTEP
        )
        hear(self, RunStatus, self._on_status)
        self.create_subscription(
            DiagnosticArray, names.DIAGNOSTICS, self._on_diagnostics, qos.DIAGNOSTICS
        )

    def _on_state(self, message: Odometry) -> None:
        stamp_ns = conversions.from_stamp(message.header.stamp)
        if stamp_ns != self._newest_ns:  # a state that is sent again is no new sample
            self._newest_ns = stamp_ns
            state = conversions.from_odometry(message)
            self._sample(self.table.limits.faults_of_state(state, self._attitude))

    def _on_attitude(self, message: Odometry) -> None:
        turned = message.pose.pose.orientation
        self._attitude = (turned.x, turned.y, turned.z, turned.w)

    def _on_force(self, message: WrenchStamped) -> None:
        self._timeout.broken()
        force = conversions.from_wrench(message)
        self._sample(self.table.limits.faults_of_force(force))

    def _on_status(self, status: RunStatus) -> None:
        if status.phase == RUNNING and self.phase != RUNNING:
            self._timeout.broken()
            self.checker.clear(self.table.rules)
            self._pending.clear()
            self.answers.clear()
        self.phase = status.phase

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self._watched:
                state = choice('state', conversions.values_of(status).get('state'), _LABELS)
                inactive = state != 'active' and self.phase == RUNNING
                self._sample({'controller_inactive': inactive})

    def _look(self) -> None:
        """Detect a missing command, and send requests whose service was not there before."""
        silent = self._timeout.look() > self.table.limits.force_age_s
        self._sample({'force_stale': silent and self.phase == RUNNING})
        if self.phase != RUNNING:
            self._pending.clear()
        self._send_requests()

    def _send_requests(self) -> None:
        for reaction, client in list(self._pending.items()):
            if client.service_is_ready():
                self._request(reaction, self._pending.pop(reaction))

    def _sample(self, seen: Mapping[str, bool]) -> None:
        for detection in self.checker.sample(seen):
            self._react(detection)

    def _react(self, detection: Detection) -> None:
        reaction = detection.reaction if self.values['react'] else WARN
        self.reacted[detection.fault] = reaction
        self._fresh.add(detection.fault)
        log = self.get_logger()
        text = Detection(detection.fault, reaction).sentence
        log.warning(text) if reaction == WARN else log.error(text)
        if reaction == COAST and self.answers.get(COAST) != 'done':  # once in a run
            self._pending[COAST] = self._coast
        elif reaction == ABORT:
            self._pending[ABORT] = self._abort
        self._send_requests()

    def _request(self, reaction: str, client: Client) -> None:
        request: Any = Trigger.Request()
        if reaction == COAST:
            request = ChangeState.Request(
                transition=Transition(id=Transition.TRANSITION_DEACTIVATE)
            )
        client.call_async(request).add_done_callback(
            lambda future: self._on_answer(reaction, client, future)
        )

    def _on_answer(self, reaction: str, client: Client, future: Future) -> None:
        response = future.result()
        done = response is not None and response.success
        self.answers[reaction] = 'done' if done else 'refused'
        log, text = self.get_logger(), f'{reaction}: {self.answers[reaction]} by {client.srv_name}'
        log.info(text) if done else log.warning(text)

    def _health(self) -> health.Health:
        level, text = health.OK, 'nothing to report'
        faults = self.checker.holding | self._fresh  # a short fault is reported once
        self._fresh = set()
        if faults:
            level, text = health.WARN, ', '.join(sorted(faults))
            if any(self.reacted.get(fault) != WARN for fault in faults):
                level = health.ERROR
        if self._pending:
            level, text = health.ERROR, f'{text}; no service for {", ".join(self._pending)}'
        counts = {f'detected_{k}': n for k, n in self.checker.detected.items() if n}
        reactions = {f'reaction_{k}': reaction for k, reaction in sorted(self.reacted.items())}
        answers = {f'answer_{k}': answer for k, answer in sorted(self.answers.items())}
        values = {'phase': self.phase, 'table': self.table.name}
        values |= {**counts, **reactions, **answers}
        return level, text, values


main = MonitorNode.main
