# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A campaign as it is watched."""

from __future__ import annotations

import time

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from rpo_training.campaign.run_batch import UNIT
from rpo_training.campaign.store import Store
from rpo_training.display import Display


class CampaignDisplay(Display):
    """A campaign while it is entered."""

    def __init__(self, store: Store, console: Console | None = None) -> None:
        super().__init__(store.folder, console)
        runs, self._flown, self._successful = store.campaign.config.runs, 0, 0
        self._total = sum(min(UNIT, runs - unit * UNIT) for unit in store.pending())
        self._began = time.monotonic()
        self.live: Progress = Progress(
            BarColumn(20),
            MofNCompleteColumn(),
            TextColumn('{task.fields[sentence]}'),
            TimeRemainingColumn(),
            console=self.console,
        )
        self._task = self.live.add_task('', total=runs, completed=runs - self._total, sentence='')

    def advance(self, runs: int, successful: int) -> None:
        """Take in a number of runs, and how many of them succeeded."""
        self._flown += runs
        self._successful += successful
        rate = self._flown / max(time.monotonic() - self._began, 1e-9)
        sentence = f'{100 * self._successful / self._flown:.2f} % succeed  {rate:.0f} runs/s'
        self.live.update(self._task, advance=runs, sentence=sentence)
        self.say(f'{self._flown}/{self._total}  {sentence}')
