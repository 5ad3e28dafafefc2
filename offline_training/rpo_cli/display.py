# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a person sees on a terminal: tables, and the progress of long work."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from rich.box import SIMPLE_HEAD
from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table
from rich.text import Text

from rpo_core.files.validation import printable

if TYPE_CHECKING:
    from rpo_montecarlo.campaign.store import Store
    from rpo_training import run


def plain_console(stderr: bool = False) -> Console:
    """Return a console that prints texts as they are: a name may hold `[bold]` or `[/]`."""
    return Console(stderr=stderr, markup=False, highlight=False, emoji=False)


EVERY_S = 10.0
"""Time between lines where there is no terminal."""

PATIENCE_S = 2.0
COMPILING = 'Code that runs for the first time here is compiled: up to a minute, once.'
"""Said where work shows no progress for so long."""

_STYLES = {'held': 'green', 'holds': 'green', 'MISSED': 'bold red'}

Self = TypeVar('Self', bound='Display')


def print_table(
    headings: Sequence[str], rows: Iterable[Sequence[str]], title: str = '', left: int = 1
) -> None:
    """Print a table; a terminal that is too narrow wraps its lines, and no cell is cut.

    left : number of columns, from the first, that are aligned to the left
    """
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for place, heading in enumerate(headings):
        table.add_column(Text(heading), justify='left' if place < left else 'right', no_wrap=True)
    for row in rows:
        styles = (_STYLES.get(cell, '') if i >= left else '' for i, cell in enumerate(row))
        table.add_row(*map(Text, row, styles))  # what is left are names: one may be `holds`
    console = plain_console()
    any_width = console.options.update(width=1000)
    console.width = max(console.width, console.measure(table, options=any_width).maximum)
    if title:
        console.print(printable(title))
    console.print(table)


@contextmanager
def progress() -> Iterator[Callable[[str, float, float], None]]:
    """Yield a function that shows what is in work, how much of it is done, and of how much.

    It draws a bar on a terminal, and prints a line for each new work elsewhere.
    """
    console, last = plain_console(stderr=True), ''
    columns = TextColumn('{task.description}', markup=False), BarColumn(), MofNCompleteColumn()
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    task = bar.add_task('')

    def show(what: str, done: float, total: float) -> None:
        nonlocal last
        bar.update(task, description=what, completed=done, total=total)
        if what != last and not console.is_terminal:
            console.print(what)
        last = what

    with bar:
        yield show


class Display:
    """Shows the progress of work in a folder while it is entered.

    console : stderr if none is given
    """

    def __init__(self, folder: Path, console: Console | None = None) -> None:
        self.console = console or plain_console(stderr=True)
        self.console.print(printable(folder))
        columns = (
            TextColumn('{task.description}', markup=False),
            BarColumn(),
            MofNCompleteColumn(),
        )
        self._bar = Progress(*columns, TextColumn('{task.fields[left]} left'))
        self._task = self._bar.add_task('', total=None, left='?')
        self._live = Live(console=self.console, refresh_per_second=4)
        self._last = -EVERY_S
        self._silence = threading.Timer(PATIENCE_S, self.console.print, (COMPILING,))
        self._silence.daemon = True

    def __enter__(self: Self) -> Self:
        self._silence.start()
        if self.console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._silence.cancel()
        self._live.stop()

    def draw(self, what: str, done: int, total: int, left_s: float, sentence: str) -> None:
        """Show how much is done of how much, the time left [s], and a sentence about results.

        left_s : infinite where it is not known yet
        """
        self._silence.cancel()
        left = f'{int(left_s) // 60}:{int(left_s) % 60:02d}' if math.isfinite(left_s) else '?'
        if self.console.is_terminal:
            self._bar.update(self._task, description=what, total=total, completed=done, left=left)
            self._live.update(Group(self._bar, sentence))
        elif time.monotonic() - self._last >= EVERY_S:
            self._last = time.monotonic()
            line = f'{what} {done}/{total}  {sentence}  {left} left'
            self.console.print(line, soft_wrap=True)


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

    def show(self, progress: run.Progress) -> None:
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
