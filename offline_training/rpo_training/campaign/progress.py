# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The progress of a campaign, as it is shown."""

from __future__ import annotations

import math
import time

from rich.console import Console

from rpo_training.campaign.store import Store
from rpo_training.display import Display

_WARM_S = 0.3
"""The first runs of all threads come at once, after all of them have waited for the compiler."""


class CampaignDisplay(Display):
    """Shows a campaign while it is entered."""

    def __init__(self, store: Store, console: Console | None = None) -> None:
        super().__init__(store.folder, console)
        self._total, self._before = store.campaign.config.runs, store.done_runs
        self._new = self._successful = self._timed = 0
        self._first: float | None = None
        self._began: float | None = None

    def advance(self, runs: int, successful: int) -> None:
        """Add a number of finished runs, and how many of them succeeded."""
        self._new += runs
        self._successful += successful
        done, rate = self._before + self._new, self._rate(runs)
        sentence = f'{100 * self._successful / self._new:.2f} % succeed'
        if not rate:
            self.draw('runs', done, self._total, math.inf, sentence)
            return
        left_s = (self._total - done) / rate
        self.draw('runs', done, self._total, left_s, f'{sentence}  {rate:.0f} runs/s')

    def _rate(self, runs: int) -> float:
        """Return runs per second; 0 while it is not known: the kernels may have been compiled."""
        now = time.monotonic()
        if self._first is None:
            self._first = now
        elif self._began is None:
            self._began = now if now - self._first > _WARM_S else None
        else:
            self._timed += runs
            return self._timed / max(now - self._began, 1e-9)
        return 0.0
