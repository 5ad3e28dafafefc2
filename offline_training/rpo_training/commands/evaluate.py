# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo evaluate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from rich.table import Table

    from rpo_training.evaluation.assessment import Assessment

EXAMPLES = """
Examples: `rpo evaluate trained` | `rpo evaluate trained paper_ga` |
`rpo evaluate runs/best/best.yaml --starts` | `rpo evaluate trained --csv starts.csv`
"""


def evaluate(
    controllers: Annotated[list[str], typer.Argument(help='shipped names or files')],
    starts: Annotated[bool, typer.Option('--starts', help='print all 216 starts')] = False,
    csv: Annotated[Path | None, typer.Option(help='write the starts to this file')] = None,
    check: Annotated[
        bool, typer.Option('--check', help='exit code 1 if a target is missed')
    ] = False,
    workers: Annotated[int, typer.Option(min=0, help='threads, 0 = one per core')] = 0,
) -> None:
    """Judge controllers: the targets Q1-Q5, and each start beside the least energy possible."""
    from rich.console import Console

    from rpo_core.controller import load_fuzzy
    from rpo_training.evaluation.assessment import assess

    console = Console()
    missed = False
    for name in controllers:
        found = assess(load_fuzzy(name), workers)
        missed |= not all(target.holds for target in found.targets())
        console.print(_targets(found))
        console.print(_bindings(found), highlight=False)
        if starts:
            console.print(_starts(found))
        if csv:
            _write_csv(found, csv)
    if check and missed:
        raise typer.Exit(1)


def _targets(found: Assessment) -> Table:
    from rich.table import Table

    table = Table(title=f'{found.controller.name}: targets', title_justify='left')
    for heading in ('', 'what', 'limit', 'reached', ''):
        table.add_column(heading, justify='right' if heading in ('limit', 'reached') else 'left')
    for target in found.targets():
        table.add_row(
            target.name,
            target.what,
            f'{target.limit:.4g} {target.unit}',
            f'{target.reached:.4g} {target.unit}',
            'held' if target.holds else 'MISSED',
        )
    return table


def _bindings(found: Assessment) -> str:
    from rpo_core.metrics import ARRIVAL_DISTANCE, ARRIVAL_SPEED, ENERGY, SLEW

    rows, bindings = found.metrics, found.binding
    worst = rows.max(axis=0)
    counts = ', '.join(f'{name} {bindings.count(name)}' for name in sorted(set(bindings)))
    least = float(found.least.mean())
    return (
        f'mean J {found.mean_energy_n2s:.4f} N^2 s = {found.mean_energy_n2s / least:.2f} x the '
        f'least to rest in 200 s without conditions ({least:.3f}); from [100, 100, 100] m '
        f'{rows[-1, ENERGY]:.3f} = {rows[-1, ENERGY] / found.least[-1]:.2f} x\n'
        f'worst start: speed {worst[ARRIVAL_SPEED]:.4f} m/s, slew {worst[SLEW]:.4f} N/s, '
        f'distance {worst[ARRIVAL_DISTANCE]:.4f} m; condition nearest its limit: {counts}'
    )


_HEADINGS = (
    'x [m]',
    'y [m]',
    'z [m]',
    'J [N^2 s]',
    'J / least',
    'speed [m/s]',
    'slew [N/s]',
    'distance [m]',
    'nearest limit',
)


def _rows(found: Assessment) -> list[list[str]]:
    from rpo_core.metrics import ARRIVAL_DISTANCE, ARRIVAL_SPEED, ENERGY, SLEW

    return [
        [
            *(f'{r:g}' for r in start),
            f'{row[ENERGY]:.4f}',
            f'{row[ENERGY] / least:.3f}',
            f'{row[ARRIVAL_SPEED]:.5f}',
            f'{row[SLEW]:.5f}',
            f'{row[ARRIVAL_DISTANCE]:.5f}',
            binding,
        ]
        for start, row, least, binding in zip(
            found.starts, found.metrics, found.least, found.binding, strict=True
        )
    ]


def _starts(found: Assessment) -> Table:
    from rich.table import Table

    table = Table(title=f'{found.controller.name}: training starts', title_justify='left')
    for heading in _HEADINGS:
        table.add_column(heading, justify='right')
    for row in _rows(found):
        table.add_row(*row)
    return table


def _write_csv(found: Assessment, path: Path) -> None:
    import csv

    from rpo_core.validation import InputError

    try:
        with path.open('w', newline='') as file:
            writer = csv.writer(file, lineterminator='\n')
            writer.writerow(_HEADINGS)
            writer.writerows(_rows(found))
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error.strerror or error}') from None
