# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo compare`."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from rpo_training.evaluation.comparison import ComparedController

EXAMPLES = """
Examples: `rpo compare` | `rpo compare trained lqr runs/best/best.yaml --runs 1000` |
`rpo compare --write docs/compare.md`
"""

_CAMPAIGN = Path(__file__).parents[2] / 'campaigns' / 'paper_test.yaml'

_WIDTH = 120  # the tables need it; a narrower terminal wraps
_HEADING = 11  # longest word of a heading


def compare(
    controllers: Annotated[
        list[str] | None,
        typer.Argument(help='shipped names or files  [the fuzzy ones and all baselines]'),
    ] = None,
    campaign: Annotated[Path, typer.Option(help='what is dispersed, and success')] = _CAMPAIGN,
    runs: Annotated[int | None, typer.Option(help="of the campaign, instead of the file's")] = None,
    output: Annotated[
        Path, typer.Option('--output', '-o', help='folder that keeps what was computed')
    ] = Path('runs/compare'),
    write: Annotated[
        Path | None, typer.Option(help='put the table into this Markdown document too')
    ] = None,
    workers: Annotated[int, typer.Option(min=0, help='threads, 0 = one per core')] = 0,
) -> None:
    """Put controllers beside each other: energy, conditions, tests, success under dispersion.

    What was computed is kept: Ctrl-C stops cleanly, the same command goes on.
    """
    from rpo_training.evaluation import comparison, comparison_table

    signal.signal(signal.SIGTERM, signal.default_int_handler)
    names = controllers or list(comparison.CONTROLLERS)
    try:
        with _Display() as display:
            compared = comparison.Comparison(names, output, campaign, runs, workers, display.show)
            least, rows = compared.least(), compared.rows()
    except KeyboardInterrupt:
        typer.echo('Interrupted; what was computed is kept: the same command goes on.', err=True)
        raise typer.Exit(130) from None
    name = compared.campaigns[0].config.name
    _print(rows, comparison_table.notes(rows, least, name))
    for path in comparison_table.write(rows, least, name, output):
        typer.echo(path)
    if write is not None:
        comparison_table.put_into(write, comparison_table.markdown(rows, least, name))
        typer.echo(write)


class _Display:
    """What is under way: a bar on a terminal, a line for each new thing elsewhere."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

        self.console = Console(stderr=True)
        self._bar = Progress(
            TextColumn('{task.description}'),
            BarColumn(),
            MofNCompleteColumn(),
            console=self.console,
            transient=True,
            disable=not self.console.is_terminal,
        )
        self._task = self._bar.add_task('')
        self._what = ''

    def __enter__(self) -> _Display:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def show(self, what: str, done: int, total: int) -> None:
        """Show what is under way."""
        self._bar.update(self._task, description=what, completed=done, total=total)
        if what != self._what and not self.console.is_terminal:
            self.console.print(what, highlight=False)
        self._what = what


def _print(rows: Sequence[ComparedController], said: Sequence[str]) -> None:
    from textwrap import fill

    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from rpo_training.evaluation.comparison_table import overview, tests

    console = Console()
    console.width = max(console.width, _WIDTH)
    for headings, *lines in (overview(rows), tests(rows)):
        table = Table(box=SIMPLE_HEAD, pad_edge=False)
        for heading, *cells in zip(headings, *lines, strict=True):
            justify: Any = 'left' if heading == headings[0] else 'right'
            width = max(map(len, cells))
            table.add_column(
                Text(fill(heading, max(width, _HEADING))), justify=justify, min_width=width
            )
        for line in lines:
            table.add_row(*map(Text, line))
        console.print(table)
    for note in said:
        console.print(Text(f'- {note}'))
