# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A training run as it is watched: a live line on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import time
from pathlib import Path
from types import TracebackType

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bar

from rpo_training.fitness import CONDITIONS
from rpo_training.training import Progress

EVERY_S = 10.0
"""Time between lines where there is no terminal."""


def sentence(progress: Progress) -> str:
    """Return where a run stands, in one line without generation numbers."""
    rate = progress.flown / max(progress.seconds, 1e-9)
    missed = ' '.join(f'{c} {n}' for c, n in zip(CONDITIONS, progress.failures, strict=True))
    return (
        f'best {progress.best:.4f} (J {progress.energy:.4f}; misses {missed}) '
        f'mean {progress.mean:.1f} ± {progress.spread:.1f}  {rate:.0f} controllers/s'
    )


def time_left(progress: Progress) -> str:
    """Return the time the search may still take at most, as m:ss; of the phase that runs."""
    each = progress.seconds / max(progress.flown, 1)
    seconds = int(each * progress.left * progress.evaluations / (progress.generation + 1))
    return f'{seconds // 60}:{seconds % 60:02d}'


class Display:
    """Shows progress while it is entered."""

    def __init__(self, folder: Path, console: Console | None = None) -> None:
        self.console = console or Console(stderr=True)
        self.console.print(f'{folder}', highlight=False)
        self._bar = Bar(
            TextColumn('{task.description}'),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn('at most {task.fields[left]} left'),
        )
        self._task = self._bar.add_task('', total=None, left='?')
        self._live = Live(console=self.console, refresh_per_second=4)
        self._last = -EVERY_S

    def __enter__(self) -> Display:
        if self.console.is_terminal:
            self._live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._live.stop()

    def show(self, progress: Progress) -> None:
        """Show where the run stands."""
        total = progress.generation + progress.left
        if self.console.is_terminal:
            self._bar.update(
                self._task,
                description=progress.phase,
                total=total,
                completed=progress.generation,
                left=time_left(progress),
            )
            self._live.update(Group(self._bar, sentence(progress)))
        elif time.monotonic() - self._last >= EVERY_S:
            self._last = time.monotonic()
            self.console.print(
                f'{progress.phase} {progress.generation}/{total}  {sentence(progress)}  '
                f'at most {time_left(progress)} left',
                highlight=False,
                soft_wrap=True,
            )
