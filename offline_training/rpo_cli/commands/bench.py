# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rpo_cli.commands.shared import NoFail, Workers, end, interruptible, tool
from rpo_core.files.validation import InputError, choice

PARTS = ('all', 'inference', 'training', 'campaign', 'learning', 'ros')


def bench(
    what: Annotated[str, typer.Argument(help=', '.join(PARTS))] = 'all',
    evaluations: Annotated[
        int, typer.Option(min=1, help="training: controllers; the paper's budget is 60 x 301")
    ] = 60 * 301,
    runs: Annotated[int, typer.Option(min=1, help='campaign: runs')] = 10_000,
    workers: Workers = 0,
    output: Annotated[Path, typer.Option(help='all: folder of the JSON file')] = Path('runs/bench'),
    write: Annotated[Path | None, typer.Option(help='all: page to put the table into')] = None,
    no_fail: NoFail = False,
) -> None:
    """Measure speed, and that of other tools in the same run: targets P1 to P6.

    Exit code 1: a target is missed; only the whole table judges.
    """
    choice('what', what, PARTS)
    if write is not None and what != 'all':
        raise InputError('`--write` writes the whole table: leave the part out')
    bench = tool('bench.command')
    with interruptible(lambda: 'Interrupted; its nodes have ended, and nothing was saved.'):
        missed = bench.run(what, evaluations, runs, workers, output, write)
    end(missed, no_fail)
