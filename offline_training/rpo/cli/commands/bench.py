# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from rpo.cli.commands.shared import NoFail, Workers, echo, end, interruptible
from rpo.display import print_table
from rpo_core.files.validation import InputError, choice

PARTS = ('all', 'inference', 'training', 'campaign', 'learning', 'ros')


def bench(
    what: Annotated[str, Argument(help=', '.join(PARTS))] = 'all',
    evaluations: Annotated[int, Option(min=1, help='training: controllers')] = 60 * 301,
    runs: Annotated[int, Option(min=1, help='campaign: runs')] = 10_000,
    workers: Workers = 0,
    output: Annotated[Path, Option(help='all: folder of the JSON file')] = Path('runs/bench'),
    write: Annotated[Path | None, Option(help='all: page to put the table into')] = None,
    no_fail: NoFail = False,
) -> None:
    """Measure speed beside a peer of the same run: targets P1 to P6, each a ratio.

    Exit code 1: a target is missed; only the whole table judges.
    """
    choice('what', what, PARTS)
    if write is not None and what != 'all':
        raise InputError('`--write` writes the whole table: leave the part out')
    from rpo.cli import bench as benches

    with interruptible(lambda: 'Interrupted; its nodes have ended, and nothing was saved.'):
        rows = list(benches.rows(what, evaluations, runs, workers))
    print_table(benches.HEADINGS, [row.cells for row in rows], left=2)
    if what == 'all':
        echo(benches.saved(rows, output, write))
        end(any(row.ratio < row.least for row in rows), no_fail)
