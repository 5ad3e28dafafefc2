# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo simulate --sweep`: one scenario with many values of a field: a table and a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rpo_cli.commands.shared import draw
from rpo_cli.display import print_table, progress
from rpo_core.chain.flight import fly
from rpo_core.control.controller import AnyController
from rpo_core.files import overrides
from rpo_core.files.validation import InputError, real, shown, whole
from rpo_core.judge import metrics
from rpo_core.judge.verdicts import (
    HOLDS,
    MISSED,
    UNBOUNDED,
    Verdict,
    missed,
    unbounded,
    verdicts,
)
from rpo_log.show import report

MAX_FLIGHTS = 1000


def sweep(
    scenario: str, controller: AnyController, changes: Sequence[str], text: str, folder: Path | None
) -> bool:
    """Fly each value; print the table, draw the picture; return whether a requirement is missed.

    text : KEY=FROM:TO:NUMBER
    """
    key, _, span = map(str.strip, text.partition('='))
    try:
        first, last, count = (float(part) for part in span.split(':'))
    except ValueError:
        raise InputError(
            f'`--sweep` must be KEY=FROM:TO:NUMBER, like mass_kg=8:12:5; got {shown(text)}'
        ) from None
    number = whole('--sweep', int(count) if count % 1 == 0 else count, least=2, most=MAX_FLIGHTS)
    values = np.linspace(real('--sweep', first), real('--sweep', last), number).tolist()
    flown = [overrides.load(scenario, [*changes, f'{key}={v!r}']) for v in values]
    judged: list[list[Verdict]] = []  # of each flight; first its energy, without a limit
    failed = []
    with progress() as show:
        for done, each in enumerate(flown, 1):
            flight = fly(each, controller)
            energy = float(metrics.row_of(flight)[metrics.ENERGY])
            effort = Verdict('energy J', 'energy J', 'N²s', float('inf'), energy)
            judged.append([effort, *verdicts(flight)])
            failed.append(missed(flight))
            show('flights', done, number)
    base = overrides.load(scenario, changes)
    title, rows = f'{base.name}, {controller.name}: {key}', []
    lines = list(zip(*judged, strict=True))
    for line in lines:
        v, cells = line[0], (report.shown(x.value, '') for x in line)
        limit = f'≤ {v.limit:.3g} {v.unit}' if np.isfinite(v.limit) else v.unit
        rows.append([v.statement, *cells, limit])
    if len(rows) > 1:
        rows += [[name, *[UNBOUNDED] * number, 'none'] for name in unbounded(base)]
    rows.append(['all', *(MISSED if bad else HOLDS for bad in failed), ''])
    print_table((key, *(f'{value:.6g}' for value in values), 'limit'), rows, title)
    path = (folder or Path('runs') / f'sweep_{key}') / 'sweep.png'
    draw(path, _figure, values, lines, key, title)
    return any(failed)


def _figure(
    values: Sequence[float], lines: Sequence[Sequence[Verdict]], key: str, title: str
) -> Any:
    """Return the figure of each quantity over the values of the field, with its limit."""
    from rpo_log.show import style

    figure, panels = style.new_panels(1.6 * len(lines) + 0.8, len(lines), 1, sharex=True)
    for axes, line in zip(np.atleast_1d(panels), lines, strict=True):
        axes.plot(values, [verdict.value for verdict in line], marker='o', markersize=4)
        if np.isfinite(line[0].limit):
            axes.plot(values, [verdict.limit for verdict in line], **style.LIMIT)
        axes.set_title(line[0].statement, loc='left')
        axes.set_ylabel(f'[{line[0].unit}]')
        axes.set_ylim(bottom=0.0)
    axes.set_xlabel(key)
    figure.suptitle(f'{title} (dashed: required)')
    return figure
