# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The interface between the plant node, its pacing and its services."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

from rpo_core.wire.statuses import PAUSED, RUNNING, WAITING
from rpo_ros import health
from rpo_ros.heartbeat import Watch
from rpo_ros.running import FlightNode


class Loop(FlightNode):
    """The loop of a plant, as its pacing and its services see it.

    phase : WAITING, RUNNING, FINISHED or ABORTED
    paused : only requested ticks pass
    steps : requested ticks that have not passed
    watch : the signs of life of the other nodes
    progress_s, sent_s : monotonic times of the last tick, of the last state sent
    """

    watch: Watch

    def __init__(self, name: str, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__(name, overrides)
        self.phase = WAITING
        self.paused = False
        self.steps = 0
        self.progress_s = self.sent_s = time.monotonic()

    def pause(self, wanted: bool) -> None:
        """Pause a run, or go on; what it does already changes nothing."""
        if wanted == self.paused:
            return
        self.paused, self.steps = wanted, 0
        if wanted:
            self.report(health.OK, PAUSED, PAUSED)
        else:
            self.report(health.OK, RUNNING, 'flying', resumed='true')
            self.go_on()

    def step(self, ticks: int) -> None:
        """Let so many more ticks pass of a run that is paused."""
        fresh = not self.steps
        self.steps += ticks
        if fresh and ticks:
            self.go_on()

    @property
    def stepping(self) -> bool:
        """Whether single ticks were requested."""
        return self.steps > 0

    @property
    def moving(self) -> bool:
        """Whether ticks may pass."""
        return self.phase == RUNNING and (not self.paused or self.steps > 0)

    @property
    @abstractmethod
    def waits_for_recorder(self) -> bool:
        """Whether a tick in lockstep must wait for the recorder."""

    @property
    @abstractmethod
    def tick(self) -> int:
        """The current tick."""

    @abstractmethod
    def advance(self) -> None:
        """Pass the current tick."""

    @abstractmethod
    def send(self) -> None:
        """Publish the current state."""

    @abstractmethod
    def go_on(self) -> None:
        """Continue after a pause, for good or for some ticks."""

    @abstractmethod
    def abort(self, reason: str) -> None:
        """End the run early, with the exit code of an abort."""

    @abstractmethod
    def reset(self) -> None:
        """End the run and start another at tick 0."""

    @abstractmethod
    def report(self, level: bytes, phase: str, reason: str, **more: str) -> None:
        """Publish run_status."""

    def warn(self, text: str) -> None:
        """Log a warning, at most one a second."""
        self.get_logger().warning(text, throttle_duration_sec=1.0)

    def inform(self, text: str) -> None:
        """Log a message, at most one a second."""
        self.get_logger().info(text, throttle_duration_sec=1.0)
