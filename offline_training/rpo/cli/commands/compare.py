# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo compare`."""

from __future__ import annotations

from pathlib import Path
from textwrap import fill
from typing import Annotated

import typer
from typer import Argument, Option

from rpo.cli.commands.shared import Workers, draw, echo, interruptible
from rpo.cli.display import print_table, progress
from rpo_core.files.validation import InputError

_HEADING = 11  # longest word of a heading


def compare(
    controllers: Annotated[
        list[str] | None, Argument(help='names or files  [the fuzzy ones and all baselines]')
    ] = None,
    campaign: Annotated[str, Option(help='what is dispersed, and its limits')] = 'paper_test',
    runs: Annotated[int | None, Option(help="of the campaign, instead of the file's")] = None,
    random: Annotated[
        int, Option(min=0, max=1_000_000, help='random starts, at rest and as many moving')
    ] = 2000,
    picture: Annotated[Path | None, Option(help='energy against runs kept, and time')] = None,
    output: Annotated[
        Path, Option('--output', '-o', help='folder that keeps what was computed')
    ] = Path('runs/compare'),
    write: Annotated[Path | None, Option(help='page to put the table into')] = None,
    attitude: Annotated[bool, Option('--attitude', help='of attitude, dispersed slews')] = False,
    workers: Workers = 0,
) -> None:
    """Compare controllers: energy, conditions, tests, limits kept under dispersion, proofs.

    Results are kept: Ctrl-C stops cleanly, the same command goes on.
    """
    from rpo.analysis import comparison
    from rpo.montecarlo.outputs import put
    from rpo.reports import training as pictures
    from rpo.training.provenance import saw
    from rpo_core.files import find

    if attitude:
        _attitudes(controllers, 10_000 if runs is None else runs)
        return
    names = controllers or comparison.CONTROLLERS
    sentence = 'Interrupted; what was computed is kept: the same command goes on.'
    with interruptible(lambda: sentence), progress() as show:
        compared = comparison.Comparison(
            names, output, find('campaign', campaign), saw, runs, workers, show, random_runs=random
        )
        least, rows = compared.least(), compared.rows()
    flown = compared.campaigns[0]
    for headings, *lines in (table(rows) for table in comparison.TABLES):
        columns = zip(headings, *lines, strict=True)
        widths = (max(_HEADING, *map(len, cells)) for _, *cells in columns)
        print_table([fill(*pair) for pair in zip(headings, widths, strict=True)], lines)
    for note in comparison.notes(rows, least, flown):
        echo(f'- {note}')
    for path in comparison.write(rows, least, flown, output):
        echo(path)
    if picture is not None:
        draw(picture, pictures.draw, rows)
    if write is not None:
        tables = comparison.TABLES[:-1]
        put(write, 'rpo compare', comparison.markdown(rows, least, flown, tables))
        echo(write)


def _attitudes(names: list[str] | None, runs: int) -> None:
    """Print how controllers of attitude fly the same slews, which no training has flown."""
    from rpo.analysis.attitude import HEADINGS, SENTENCE, compared, judged_draws
    from rpo_core import files
    from rpo_core.control import attitude

    if runs < 1:
        raise InputError(f'`--runs` must be at least 1; got {runs}')
    loaded = [attitude.load(name) for name in names or files.shipped('attitude_controller')]
    rows = [row.cells for row in compared(loaded, judged_draws(runs))]
    print_table(HEADINGS, rows, f'{runs} slews of up to 180 deg')
    typer.echo(SENTENCE)
