# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the plant node, its pacing and its services share, so that none of them knows another."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

WAITING, RUNNING, PAUSED, FINISHED, ABORTED = (
    'waiting',
    'running',
    'paused',
    'finished',
    'aborted',
)
"""Phases of a run."""

ENDED = (FINISHED, ABORTED)


class Loop(ABC):
    """The loop of a plant: whether ticks may pass, and what can be done about it.

    values : the node's parameters
    phase : WAITING, RUNNING, FINISHED or ABORTED
    paused : no tick passes but those requested
    steps : ticks that were requested and have not passed
    progress_s, sent_s : monotonic times of the last tick, of the last state sent
    """

    def __init__(self) -> None:
        self.values: Mapping[str, Any] = {}
        self.phase = WAITING
        self.paused = False
        self.steps = 0
        self.progress_s = self.sent_s = time.monotonic()

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
    def tick(self) -> int:
        """The present tick."""

    @abstractmethod
    def advance(self) -> None:
        """Pass the present tick."""

    @abstractmethod
    def send(self) -> None:
        """Publish the present state."""

    @abstractmethod
    def go_on(self) -> None:
        """Go on after a pause, for good or for some ticks."""

    @abstractmethod
    def abort(self, reason: str) -> None:
        """End the run before its time, with an exit code that says so."""

    @abstractmethod
    def reset(self) -> None:
        """End the run and begin another at tick 0."""

    @abstractmethod
    def report(self, level: bytes, phase: str, reason: str, **more: str) -> None:
        """Publish run_status."""

    @abstractmethod
    def warn(self, text: str) -> None:
        """Log a warning, not more than one a second."""

    @abstractmethod
    def inform(self, text: str) -> None:
        """Log a piece of news, not more than one a second."""

    @abstractmethod
    def every(self, period_s: float, callback: Callable[[], None]) -> Any:
        """Call back in steady wall time; return the timer."""

    @abstractmethod
    def destroy_timer(self, timer: Any) -> Any:
        """Release a timer."""
