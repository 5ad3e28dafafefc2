# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How long a peer has been silent, measured by a process that may have been stopped itself."""

from __future__ import annotations

import time
from collections.abc import Callable

MOST_STEP_S = 0.25
"""Most time that one look adds: in a longer gap between two looks this process was stopped."""


class Timeout:
    """Adds up the time since the last message, look by look.

    A process that was stopped, or got no processor, runs its timers before the messages that wait.
    By the clock alone it would falsely time out its peers.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._silent_s = 0.0
        self._looked_s = clock()

    def broken(self) -> None:
        """Note that a message came."""
        self._silent_s = 0.0

    def look(self) -> float:
        """Return the silence so far [s]; call it often."""
        now_s = self._clock()
        self._silent_s += min(now_s - self._looked_s, MOST_STEP_S)
        self._looked_s = now_s
        return self._silent_s
