# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo report`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from rpo.cli.commands.shared import NoFail, echo, end
from rpo.cli.display import plain_console
from rpo_core.files.validation import InputError, printable, within

if TYPE_CHECKING:
    from rpo.reports.page import Report, Subject


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

    from rpo.reports import page

    target, *others = targets
    subject = page.subject_of(target)
    if scenario and subject not in ('controller', 'run'):
        raise InputError(f'`--scenario` is for a controller or a bag; {target} is a {subject}')
    for other in others:
        if (kind := page.subject_of(other)) != 'run' or subject != 'run':
            raise InputError(
                f'several targets must be runs; {target} is a {subject}, {other} a {kind}'
            )
    doing = Text(printable(f'{target}: reporting this {subject}'))
    with plain_console(stderr=True).status(doing):
        if subject == 'run':
            made, folder, code = _of_runs(targets, scenario)
        else:
            (made, folder), code = _of_another(target, subject, scenario), 0
        paths = page.write(made, output or folder)
    for path in paths:
        echo(path)
    if open_:
        typer.launch(paths[-1].resolve().as_uri())
    if code:
        raise typer.Exit(code)
    end(made.missed, no_fail)


def _of_runs(targets: list[str], scenario: str) -> tuple[Report, Path, int]:
    """Return a report, where it goes if nothing else is said, and the exit code."""
    from rpo.reports import run
    from rpo_log.errors import ExitCode
    from rpo_log.show.report import folder_of, print_table

    paths = [Path(target) for target in targets]
    if len(paths) == 1:
        made, shown = run.report_of(paths[0], scenario)
        every, folder = [shown], folder_of(paths[0])
        if shown.whole:
            print_table(shown.flight, made.title)
    else:
        made, every = run.compared(paths, scenario)
        folder = Path('runs') / '_'.join(['report', *(path.stem for path in paths)])
    for target, shown in zip(targets, every, strict=True):
        if missing := (*shown.lacks, *shown.gaps):
            echo(f'{target}: {"; ".join(missing)}', err=True)
    whole = all(shown.whole for shown in every)
    return made, folder, int(ExitCode.OK if whole else ExitCode.INCOMPLETE)


def _of_another(target: str, subject: Subject, scenario: str) -> tuple[Report, Path]:
    """Return the report of a campaign, a proof or a controller, and where it goes."""
    from rpo.reports import campaign, controller, proof
    from rpo_core.control import attitude

    if subject != 'controller':
        module = campaign if subject == 'campaign' else proof
        return module.report_of(Path(target)), Path(target) / 'report'
    if attitude.is_one(target):
        fly = f'rpo simulate tumbling_docking --set attitude_control.controller={target}'
        raise InputError(f'{target} turns the chaser: `{fly}` flies it, and that run has a report')
    with within(f'{target}: no run and no campaign; as a controller'):
        return controller.report_of(target, scenario), Path('runs') / _folder(target)


def _folder(target: str) -> str:
    """Return the name of the folder of a controller's report: another for each file.

    A file adds its folder, which a person knows, and a digest of its path, which no other file has.
    """
    from rpo.montecarlo.outputs import digest_of

    path = Path(target)
    if path.name == target and not path.suffix:
        return f'report_{target}'
    parent, digest = path.resolve().parent.name, digest_of(str(path.resolve()))[:8]
    names = [parent] if parent and parent != path.stem else []
    return '_'.join(['report', *names, path.stem, digest])
