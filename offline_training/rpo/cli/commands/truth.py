# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo truth`."""

from __future__ import annotations

import os
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from rpo.cli.commands.shared import Controller
from rpo.display import print_table
from rpo.montecarlo import outputs
from rpo_core.files import DEFAULT_CONTROLLER, DEFAULT_SCENARIO

if TYPE_CHECKING:
    from rpo.analysis.truth import Comparison


def truth(
    subject: Annotated[
        str, Argument(help='run (folder or .mcap), or scenario to fly')
    ] = DEFAULT_SCENARIO,
    controller: Controller = DEFAULT_CONTROLLER,
    write: Annotated[Path | None, Option(help='page to put the tables into')] = None,
) -> None:
    """Fly a run's forces again under true gravity, and print the error of the plant.

    By Basilisk where it is installed (layer `truth`; not with drag), and by SciPy. The controller
    is that of a flight here.
    """
    from rpo.analysis import basilisk, truth
    from rpo_core.chain.flight import fly
    from rpo_core.control.controller import load_controller
    from rpo_core.scenario.scenario import load_scenario
    from rpo_log.bag import open_run
    from rpo_log.read.run_log import flight_of, read_run

    run = Path(subject) if subject.endswith('.mcap') or os.path.isdir(subject) else None
    if run is not None:
        flight = flight_of(read_run(open_run(run)))
        title = f'{run}, {flight.scenario.name}'
    else:
        loaded = load_controller(controller)
        flight, title = fly(load_scenario(subject), loaded), f'{subject}, controller {loaded.name}'
    truths, attitudes = {'SciPy': truth.by_scipy}, {'SciPy': truth.attitude_by_scipy}
    if not find_spec('Basilisk'):
        typer.echo('Without Basilisk: `make setup LAYERS=truth` installs it.', err=True)
    elif basilisk.knows(flight.scenario):
        truths = {'Basilisk': basilisk.by_basilisk, **truths}
        attitudes['Basilisk'] = basilisk.attitude_by_basilisk
    found = truth.compare(flight, truths)
    tables = _tables(found, title)
    for title, (heads, *rows), after in tables:
        print_table(heads, rows, title)
        if after:
            typer.echo(f'{after}\n')
    target = flight.scenario.target
    for name, true in attitudes.items() if target is not None and target.kind != 'fixed' else ():
        off = truth.attitude_error_rad(flight.scenario, true(flight.scenario))
        typer.echo(f'Attitude of the target at the end: {off:.1e} rad off {name}.')
    if write is not None:
        parts = []
        for title, (heads, *rows), after in tables:
            table = '\n'.join(outputs.markdown_table(heads, rows))
            parts += [title, table, *filter(None, [after])]
        outputs.put(write, 'rpo truth', '\n\n'.join(parts))
        typer.echo(write)


def _tables(found: Comparison, flown: str) -> list[tuple[str, Sequence[Sequence[str]], str]]:
    """Return title, headings and rows, and what follows, of both tables."""
    from rpo.analysis.truth import AXIS_NAMES

    duration, heads, errors = f'{found.scenario.duration_s:g} s', ['time'], []
    for name in found.errors:
        heads += [f'{found.plant} − {name}, position', 'velocity']
    for t_s, *pairs in found.moments():
        cells = (cell for r, v in pairs for cell in (f'{r:.2e} m', f'{v:.2e} m/s'))
        errors.append((f'{t_s:g} s', *cells))
    drifts = [
        (f'{distance_m:g} m', *(f'{error:.2g} m' for error in errors_m))
        for distance_m, errors_m in found.growth.items()
    ]
    apart_m = found.disagreement_m
    differ = '' if apart_m is None else f'The two truths differ by at most {apart_m:.1e} m.'
    flown = f'{flown}: {duration} under the same forces, open loop.'
    drifted = f'Drifting freely for {duration} from rest at a distance, error of the linear plant'
    along = ('distance', *(f'along {name}' for name in AXIS_NAMES))
    return [(flown, [heads, *errors], differ), (f'{drifted} (SciPy):', [along, *drifts], '')]
