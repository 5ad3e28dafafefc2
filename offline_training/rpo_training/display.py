# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a person sees on a terminal: tables, and the progress of long work."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import TypeVar

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.table import Table
from rich.text import Text

EVERY_S = 10.0
"""Time between lines where there is no terminal."""

_STYLES = {'held': 'green', 'MISSED': 'bold red'}

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
        table.add_row(*(Text(cell, _STYLES.get(cell, '')) for cell in row))
    console = Console()
    any_width = console.options.update(width=1000)
    console.width = max(console.width, console.measure(table, options=any_width).maximum)
    if title:
        console.print(Text(title))
    console.print(table)


@contextmanager
def progress() -> Iterator[Callable[[str, float, float], None]]:
    """Yield a function that shows what is in work, how much of it is done, and of how much.

    It draws a bar on a terminal, and prints a line for each new work elsewhere.
    """
    console, last = Console(stderr=True), ''
    columns = TextColumn('{task.description}'), BarColumn(), MofNCompleteColumn()
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    task = bar.add_task('')

    def show(what: str, done: float, total: float) -> None:
        nonlocal last
        bar.update(task, description=what, completed=done, total=total)
        if what != last and not console.is_terminal:
            console.print(what, highlight=False)
        last = what

    with bar:
        yield show


class Display:
    """Shows progress while it is entered.

    console : stderr if none is given
    live : what is drawn on a terminal; set by the subclass
    """

    live: Live | Progress

    def __init__(self, folder: Path, console: Console | None = None) -> None:
        self.console = console or Console(stderr=True)
        self.console.print(f'{folder}', highlight=False)
        self._last = -EVERY_S

    def __enter__(self: Self) -> Self:
        if self.console.is_terminal:
            self.live.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.live.stop()

    def say(self, line: str) -> None:
        """Print a line where there is no terminal, if the last one was some time ago."""
        now = time.monotonic()
        if not self.console.is_terminal and now - self._last >= EVERY_S:
            self._last = now
            self.console.print(line, highlight=False, soft_wrap=True)
