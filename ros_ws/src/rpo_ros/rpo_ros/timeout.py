# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How long somebody has been silent, by a listener who may have been asleep himself."""

from __future__ import annotations

import time
from collections.abc import Callable

MOST_STEP_S = 0.25
"""What one look adds at most: in a longer gap between two looks it was the listener that slept."""


class Timeout:
    """Adds up the time since something was heard, look by look.

    A process that was stopped, or starved of processor, finds its timers due before the messages
    that have piled up; by the clock alone it would accuse everybody else.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._silent_s = 0.0
        self._looked_s = clock()

    def broken(self) -> None:
        """Note that something was heard."""
        self._silent_s = 0.0

    def look(self) -> float:
        """Return the silence so far [s]; to be asked often."""
        now_s = self._clock()
        self._silent_s += min(now_s - self._looked_s, MOST_STEP_S)
        self._looked_s = now_s
        return self._silent_s
