# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The progress of a proof, as it is shown."""

from __future__ import annotations

import math
import time
from pathlib import Path

from rich.console import Console

from rpo_montecarlo.display import Display


class ProofDisplay(Display):
    """Shows a proof while it is entered."""

    def __init__(self, folder: Path, console: Console | None = None) -> None:
        super().__init__(folder, console)
        self._what, self._began, self._before = '', 0.0, 0

    def advance(self, what: str, done: int, total: int) -> None:
        """Show how much of some work is done."""
        now = time.monotonic()
        if what != self._what:
            self._what, self._began, self._before = what, now, done
        new = done - self._before
        left_s = (now - self._began) / new * (total - done) if new else math.inf
        self.draw(what, done, total, left_s, '')
