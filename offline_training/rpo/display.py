# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a person sees on a terminal: tables, and the progress of long work."""

from __future__ import annotations

import html
import math
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from rpo_core.files.validation import printable

if TYPE_CHECKING:
    from rich.console import Console

EVERY_S = 10.0
"""Time between lines where there is no terminal."""

PATIENCE_S = 2.0
COMPILING = 'Code that runs for the first time here is compiled: up to a minute, once.'
"""Said where work in a folder shows no progress for so long."""

UNITS = {
    '_rad_s': 'rad/s', '_deg_s': 'deg/s', '_m2_s2': 'm²/s²', '_m_s': 'm/s', '_n_s': 'N/s',
    '_n2s': 'N²s', '_rad2': 'rad²', '_m2': 'm²', '_rad': 'rad', '_deg': 'deg', '_nms': 'N m s',
    '_nm': 'N m', '_kg': 'kg', '_ticks': 'ticks', '_share': 'share', '_m': 'm', '_s': 's',
    '_n': 'N', '': '',
}  # fmt: skip
"""End of the name of a column -> unit, the longer ones first."""

_STYLES = {'held': 'green', 'holds': 'green', 'MISSED': 'bold red'}


class Show(Protocol):
    """Shows what is in work, how much of it is done, of how much, and a sentence of results."""

    def __call__(self, what: str, done: float, total: float, sentence: str = '') -> None:
        """Show it; the time left follows from the calls about the same work."""


def plain_console(stderr: bool = False) -> Console:
    """Return a console that prints texts as they are: a name may hold `[bold]` or `[/]`."""
    from rich.console import Console

    return Console(stderr=stderr, force_jupyter=False, markup=False, highlight=False, emoji=False)


def print_table(
    headings: Sequence[str], rows: Iterable[Sequence[str]], title: str = '', left: int = 1
) -> None:
    """Print a table; a terminal that is too narrow wraps its lines, and no cell is cut.

    left : number of columns, from the first, that are aligned to the left
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

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


def suffix_of(column: str) -> str:
    """Return the end of a name that says its unit, see `UNITS`; '' if none."""
    return next(end for end in UNITS if column.endswith(end))


def html_rows(rows: Iterable[Sequence[str]]) -> str:
    """Return the rows of an HTML table for notebooks; cells are texts."""
    cells = (''.join(f'<td>{html.escape(cell)}</td>' for cell in row) for row in rows)
    return ''.join(f'<tr>{row}</tr>' for row in cells)


@contextmanager
def progress(folder: Path | None = None, console: Console | None = None) -> Iterator[Show]:
    """Yield what shows the progress of work: a bar on a terminal, lines elsewhere.

    folder : of work that is saved there, which may wait for the compiler
    console : stderr if none is given
    """
    from rich.console import Group
    from rich.live import Live
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )
    from rich.text import Text

    console = console or plain_console(stderr=True)
    bar = Progress(
        TextColumn('{task.description}', markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        get_time=time.monotonic,
        speed_estimate_period=math.inf,  # a generation may take minutes
    )
    bar.add_task('', total=None)
    (task,), results, last = bar.tasks, Text(), -math.inf
    silence = threading.Timer(PATIENCE_S, console.print, (COMPILING,))
    silence.daemon = True

    def show(what: str, done: float, total: float, sentence: str = '') -> None:
        nonlocal last
        silence.cancel()
        if what != task.description:
            bar.reset(task.id, description=what)
            last = -math.inf
        bar.update(task.id, total=total, completed=done)
        rate = f'  {task.speed:.3g}/s' if task.speed else ''
        results.plain = f'{sentence}{rate}'
        if not console.is_terminal and time.monotonic() - last >= EVERY_S:
            last, left_s = time.monotonic(), task.time_remaining
            left = '' if left_s is None else f'  {int(left_s) // 60}:{int(left_s) % 60:02d} left'
            line = f'{what} {done:g}/{total:g}  {results.plain}{left}'
            console.print(line, soft_wrap=True)

    if folder is not None:
        console.print(printable(folder))
        silence.start()
    live = Live(Group(bar, results), console=console, refresh_per_second=4, transient=True)
    try:
        if console.is_terminal:
            live.start()
        yield show
    finally:
        silence.cancel()
        live.stop()


@contextmanager
def progress_in_python() -> Iterator[Show]:
    """Yield what shows progress as `progress` does, on a terminal and in a notebook alone."""
    if sys.stderr.isatty() or 'ipykernel' in sys.modules:
        with progress() as show:
            yield show
    else:
        yield lambda *_: None
