# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `operator`: says go, hold, retreat or abort to guidance, until it is followed.

It needs no `ros2 service`, which comes with a ROS installation.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from std_srvs.srv import Trigger

from rpo_core.files.validation import printable
from rpo_core.guidance.guidance import GO
from rpo_core.wire.statuses import GuidanceStatus, RunStatus
from rpo_ros.running import FlightNode
from rpo_ros.signals import hear

EXIT_REFUSED = 1

_PERIOD_S = 0.05
"""Wall time between two looks, and between a `go` that was refused and the next."""


class OperatorNode(FlightNode):
    """Waits for a phase of the plan, then says one command; `go` again until it is followed."""

    package = 'rpo_ctrl'

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('operator', overrides)
        self._command, self._wanted = self.values['command'], self.values['phase']
        self._phase = self._refused = ''
        self._followed = False
        self._end_s = time.monotonic() + self.values['patience_s']
        self._asked: Any = None
        self._client = self.create_client(Trigger, f'guidance/{self._command}')
        hear(self, GuidanceStatus, self._on_phase)
        hear(self, RunStatus, self._on_run)
        self.every(_PERIOD_S, self._look)
        when = f' in phase {self._wanted}' if self._wanted else ''
        self.get_logger().info(f'waiting to say {self._command}{when}')

    def _on_phase(self, status: GuidanceStatus) -> None:
        self._phase = status.phase
        if self.values['until_end']:
            self.get_logger().info(f'{status.phase}: {status.reason}')

    def _on_run(self, status: RunStatus) -> None:
        phase = status.phase
        if not status.ended or not self._phase:  # of the run before
            return
        if self._followed:
            self._leave(0, f'the run is {phase}')
        else:
            self._leave(EXIT_REFUSED, f'the run is {phase}: {self._command} was not followed')

    def _look(self) -> None:
        """Say the command when its time has come."""
        if self._asked is not None or self._followed or self.done:
            return
        if time.monotonic() > self._end_s:
            why = self._refused or f'phase {self._wanted or "of a plan"} did not come'
            self._leave(EXIT_REFUSED, f'{self._command} was not followed: {why}')
        elif self._phase and self._wanted in ('', self._phase) and self._client.service_is_ready():
            self._asked = self._client.call_async(Trigger.Request())
            self._asked.add_done_callback(self._on_answer)

    def _on_answer(self, future: Any) -> None:
        answer = future.result()
        self._asked, self._refused = None, answer.message
        if answer.success:
            self._followed = True
            sentence = f'guidance follows: {printable(answer.message)}'
            if self.values['until_end']:
                self.get_logger().info(sentence)
            else:
                self._leave(0, sentence)
        elif self._command != GO:
            self._leave(EXIT_REFUSED, f'{self._command} was refused: {printable(answer.message)}')

    def _leave(self, exit_code: int, sentence: str) -> None:
        if self.done:
            return
        log = self.get_logger().error if exit_code else self.get_logger().info
        log(sentence)
        self.exit_code, self.done = exit_code, True


main = OperatorNode.main
