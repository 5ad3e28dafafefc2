# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A training run as it is watched."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
from rich.progress import Progress as Bar

from rpo_training.display import Display
from rpo_training.search.fitness import CONDITIONS
from rpo_training.search.run import Progress


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


class TrainingDisplay(Display):
    """A training run while it is entered."""

    def __init__(self, folder: Path, console: Console | None = None) -> None:
        super().__init__(folder, console)
        self._bar = Bar(
            TextColumn('{task.description}'),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn('at most {task.fields[left]} left'),
        )
        self._task = self._bar.add_task('', total=None, left='?')
        self.live: Live = Live(console=self.console, refresh_per_second=4)

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
            self.live.update(Group(self._bar, sentence(progress)))
        self.say(
            f'{progress.phase} {progress.generation}/{total}  {sentence(progress)}  '
            f'at most {time_left(progress)} left'
        )
