# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo report`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rpo_training.report.blocks import Report

EXAMPLES = """
Examples: `rpo report runs/demo` | `rpo report runs/demo/run.mcap --open` |
`rpo report runs/paper_test_1 --output shared/campaign` | `rpo report trained`
"""


def report(
    target: Annotated[
        str,
        typer.Argument(
            help='run (folder or .mcap), campaign (folder) or controller (shipped name or file)'
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            '--output', '-o', help='folder  [report/ in the run or campaign, runs/report_NAME]'
        ),
    ] = None,
    open_: Annotated[bool, typer.Option('--open', help='show the page in the browser')] = False,
) -> None:
    """Draw a run, a campaign or a controller: PNGs, and one HTML page that needs nothing else."""
    from rich.console import Console

    from rpo_training.report.page import write

    with Console(stderr=True).status(f'reporting {target}'):
        made, folder = _made(target)
        paths = write(made, output or folder)
    for path in paths:
        typer.echo(path)
    if open_:
        typer.launch(paths[-1].resolve().as_uri())


def _made(target: str) -> tuple[Report, Path]:
    """Return the report of what is given, and where it goes if nothing else is said."""
    from rpo_core.validation import InputError
    from rpo_training.report import recognise

    kind = recognise.kind_of(target)
    path = Path(target)
    if kind is recognise.Kind.RUN:
        return _of_run(path)
    if kind is recognise.Kind.CAMPAIGN:
        from rpo_training.report import campaign

        return campaign.report_of(path), path / 'report'
    from rpo_training.report import controller

    try:
        return controller.report_of(target), Path('runs') / f'report_{path.stem}'
    except InputError as error:
        raise InputError(f'{target}: no run, no campaign, and no controller: {error}') from None


def _of_run(path: Path) -> tuple[Report, Path]:
    from rpo_log.report import folder_of, print_table
    from rpo_training.report import run

    made, flight = run.report_of(path)
    print_table(flight, made.title)
    return made, folder_of(path)
