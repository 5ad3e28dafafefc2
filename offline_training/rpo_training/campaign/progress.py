# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The progress of a campaign, as it is shown."""

from __future__ import annotations

import time

from rich.console import Console

from rpo_training.campaign.store import Store
from rpo_training.display import Display


class CampaignDisplay(Display):
    """Shows a campaign while it is entered."""

    def __init__(self, store: Store, console: Console | None = None) -> None:
        super().__init__(store.folder, console)
        self._total, self._before = store.campaign.config.runs, store.done_runs
        self._new = self._successful = 0
        self._began = time.monotonic()

    def advance(self, runs: int, successful: int) -> None:
        """Add a number of finished runs, and how many of them succeeded."""
        self._new += runs
        self._successful += successful
        rate = self._new / max(time.monotonic() - self._began, 1e-9)
        done = self._before + self._new
        sentence = f'{100 * self._successful / self._new:.2f} % succeed  {rate:.0f} runs/s'
        self.draw('runs', done, self._total, (self._total - done) / rate, sentence)
