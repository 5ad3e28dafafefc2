# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo report`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from rpo.cli.commands.shared import NoFail, echo, end
from rpo.display import plain_console, print_table
from rpo_core.files.validation import printable


def report(
    targets: Annotated[
        list[str],
        Argument(
            metavar='TARGET...',
            help='runs (folder, .mcap or bag), or one campaign, proof (folder), controller '
            '(name or file)',
        ),
    ],
    output: Annotated[
        Path | None,
        Option('--output', '-o', help='folder  [report/ in the folder, runs/report_NAME else]'),
    ] = None,
    scenario: Annotated[
        str,
        Option(
            help='of a controller: judge by what this scenario or set requires (name or file)  '
            '[what it was trained for]; of a bag without manifests: what was flown'
        ),
    ] = '',
    open_: Annotated[bool, Option('--open', help='show the page in the browser')] = False,
    no_fail: NoFail = False,
) -> None:
    """Draw runs, a campaign, a proof or a controller: PNGs, and one HTML page, self-contained.

    Of runs and campaigns also replay.html: the flights in three dimensions, to be played.

    Exit code 1: something that the page judges is missed; the page is written all the same.
    """
    from rich.text import Text

    from rpo.door.evidence import reported
    from rpo.reports.page import subject_of
    from rpo_log.errors import ExitCode
    from rpo_log.show.report import COLUMNS, table

    doing = Text(printable(f'{targets[0]}: reporting this {subject_of(targets[0])}'))
    with plain_console(stderr=True).status(doing):
        made, paths, logged = reported(targets, output, scenario)
    if len(logged) == 1 and logged[0].whole:
        print_table(COLUMNS, table(logged[0].flight), made.title)
    for target, shown in zip(targets, logged, strict=bool(logged)):
        if missing := (*shown.lacks, *shown.gaps):
            echo(f'{target}: {"; ".join(missing)}', err=True)
    for path in paths:
        echo(path)
    if open_:
        typer.launch(paths[-1].resolve().as_uri())
    if not all(shown.whole for shown in logged):
        raise typer.Exit(int(ExitCode.INCOMPLETE))
    end(made.missed, no_fail)
