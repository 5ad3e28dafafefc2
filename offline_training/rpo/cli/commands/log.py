# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo log`, `rpo verify`, `rpo sign` and `rpo repair`: what one does with the log of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, NoReturn

import typer
from typer import Argument, Option

from rpo.cli.commands.shared import echo
from rpo_log.log_commands import DETAILS, GIVEN, Finding, show

RunArgument = Annotated[Path, Argument(help='run folder, .mcap file or bag')]

log = typer.Typer(
    help='Look into the logs of runs.',
    no_args_is_help=True,
    context_settings={'help_option_names': ['-h', '--help']},
)


def _show(found: Finding, details: bool = True) -> NoReturn:
    raise typer.Exit(show(found, details))


@log.command()
def info(run: RunArgument) -> None:
    """Print what a log holds, and whether it is complete."""
    from rpo_log.tools.diff import inspect

    _show(inspect(run))


@log.command()
def diff(first: RunArgument, second: RunArgument) -> None:
    """Compare two logs, bit for bit; exit code 1 where they differ."""
    from rpo_log.tools.diff import diff as compare

    _show(compare(first, second))


@log.command()
def export(
    run: RunArgument,
    output: Annotated[Path, Argument(help='file to write: .csv, .npz or .oem')],
) -> None:
    """Write states, forces and disturbances as a table; the suffix of OUTPUT names the format."""
    from rpo_log.tools.export import export as write

    rows = write(run, output)
    echo(f'{output}: {rows} ticks')


def verify(
    run: RunArgument,
    trusted: Annotated[
        Path | None,
        Option(help='public key, or folder of them (*.pem): one must have signed the run'),
    ] = None,
    given: Annotated[list[str], Option(metavar='TOPIC', help=GIVEN)] = [],  # noqa: B006
    scenario: Annotated[str, Option(help='of a bag without manifests: name or file')] = '',
    controller: Annotated[str, Option(help='of a bag without manifests: name or file')] = '',
    details: Annotated[bool, Option('--details', help=DETAILS)] = False,
) -> None:
    """Compute a logged flight again, bit for bit; print what is verified, what is not judged."""
    from rpo.door.evidence import verify as check

    _show(check(run, trusted, given, scenario, controller), details)


def sign(run: RunArgument, key: Annotated[Path, Option(help='private key in PEM')]) -> None:
    """Sign a run folder: its files, each with its digest. Nothing that was recorded may differ."""
    from rpo_log.signature import sign_run

    echo(sign_run(run, key))


def repair(
    run: RunArgument,
    output: Annotated[Path | None, Option(help='folder of the repaired log')] = None,
) -> None:
    """Write what can be read of a damaged log as a whole one."""
    from rpo_log.tools.repair import repair as rebuild

    _show(rebuild(run, output))
