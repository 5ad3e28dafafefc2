# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A campaign as it is watched: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from rpo_training.campaign.fleet import UNIT
from rpo_training.campaign.store import Store
from rpo_training.progress import EVERY_S


class Display:
    """Shows progress while it is entered."""

    def __init__(self, store: Store, console: Console | None = None) -> None:
        self.console = console or Console(stderr=True)
        self.console.print(f'{store.folder}', highlight=False)
        runs, self._flown, self._successful = store.campaign.config.runs, 0, 0
        self._total = sum(min(UNIT, runs - unit * UNIT) for unit in store.pending())
        self._began = self._last = time.monotonic()
        self._bar = Progress(
            BarColumn(20),
            MofNCompleteColumn(),
            TextColumn('{task.fields[sentence]}'),
            TimeRemainingColumn(),
            console=self.console,
            disable=not self.console.is_terminal,
        )
        self._task = self._bar.add_task('', total=runs, completed=runs - self._total, sentence='')

    def __enter__(self) -> Display:
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.stop()

    def advance(self, runs: int, successful: int) -> None:
        """Take in a number of runs, and how many of them succeeded."""
        self._flown += runs
        self._successful += successful
        now = time.monotonic()
        rate = self._flown / max(now - self._began, 1e-9)
        sentence = f'{100 * self._successful / self._flown:.2f} % succeed  {rate:.0f} runs/s'
        self._bar.update(self._task, advance=runs, sentence=sentence)
        if not self.console.is_terminal and now - self._last >= EVERY_S:
            self._last = now
            self.console.print(f'{self._flown}/{self._total}  {sentence}', highlight=False)
