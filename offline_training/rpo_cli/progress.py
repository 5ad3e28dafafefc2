# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The progress of a campaign, of a proof and of a training, as it is shown."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console

from rpo_cli.display import Display

if TYPE_CHECKING:
    from rpo_montecarlo.campaign.store import Store
    from rpo_training.run import Progress

_WARM_S = 0.3
"""The first runs of all threads come at once, after all of them have waited for the compiler."""

_TIMED_S, _LONG_S = 2.0, 60.0
"""A campaign that lasts longer is announced after so much timed work."""


class CampaignDisplay(Display):
    """Shows a campaign while it is entered."""

    def __init__(self, store: Store, console: Console | None = None) -> None:
        super().__init__(store.folder, console)
        self._total, self._before = store.campaign.config.runs, store.done_runs
        self._new = self._successful = self._timed = 0
        self._first: float | None = None
        self._began: float | None = None
        self._announced = False

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
        self._announce(rate, left_s)
        self.draw('runs', done, self._total, left_s, f'{sentence}  {rate:.0f} runs/s')

    def _announce(self, rate: float, left_s: float) -> None:
        """Say once, in a line that stays, how long a long campaign will take."""
        if self._announced or time.monotonic() - (self._began or 0.0) < _TIMED_S:
            return
        self._announced = True
        if left_s > _LONG_S:
            self.console.print(
                f'{self._total} runs: about {duration(left_s)} to go, at {rate:.0f} runs/s. Ctrl-C '
                'stops cleanly; --resume goes on.',
                soft_wrap=True,
            )

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


def duration(seconds: float) -> str:
    """Return a long time for people: minutes, then hours and minutes."""
    minutes = round(seconds / 60.0)
    return f'{minutes} min' if minutes < 120 else f'{minutes // 60} h {minutes % 60:02d} min'


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


class TrainingDisplay(Display):
    """Shows a training run while it is entered."""

    def show(self, progress: Progress) -> None:
        """Show the state of the run, and the longest time that the present phase can still take."""
        missed = ' '.join(f'{c} {n}' for c, n in progress.failures.items())
        left_s, rate = math.inf, ''
        if progress.evaluated:
            each_s = progress.seconds / progress.evaluated
            left_s = each_s * progress.left * progress.evaluations / (progress.generation + 1)
            rate = f'  {1.0 / max(each_s, 1e-9):.0f} controllers/s'
        self.draw(
            progress.phase,
            progress.generation,
            progress.generation + progress.left,
            left_s,
            f'best {progress.best:.4f} (J {progress.energy:.4f}; misses {missed}) '
            f'mean {progress.mean:.1f} ± {progress.spread:.1f}{rate}',
        )
