# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo truth`."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rpo_core.files import DEFAULT_CONTROLLER
from rpo_training import outputs

if TYPE_CHECKING:
    from rpo_core.flight import Flight
    from rpo_training.truth.two_body import Comparison

EXAMPLES = """
Examples: `rpo truth runs/first` | `rpo truth` | `rpo truth --scenario approach --controller
handmade --write docs/truth.md`
"""


def truth(
    run: Annotated[
        Path | None, typer.Argument(help='run folder or .mcap file; without one, it is flown here')
    ] = None,
    scenario: Annotated[str, typer.Option(help='without RUN: shipped name or file')] = 'paper_test',
    controller: Annotated[
        str, typer.Option(help='without RUN: shipped name or file')
    ] = DEFAULT_CONTROLLER,
    plot: Annotated[
        Path | None, typer.Option(help='picture  [RUN/report/truth.png, or runs/truth.png]')
    ] = None,
    write: Annotated[Path | None, typer.Option(help='page to put the tables into')] = None,
) -> None:
    """Fly a run's forces again under two-body gravity, and say how wrong the linear plant is.

    By Basilisk where it is installed (layer `truth`), and by SciPy.
    """
    from rpo_log.show.report import folder_of
    from rpo_training.truth.two_body import TRUTHS, compare

    names = [name for name in TRUTHS if name != 'Basilisk' or find_spec('Basilisk')]
    if 'Basilisk' not in names:
        typer.echo('Without Basilisk: `make setup LAYERS=truth` installs it.', err=True)
    flight, title = _flight(run, scenario, controller)
    found = compare(flight, title, names)
    text = markdown(found)
    typer.echo(text, nl=False)
    folder = Path('runs') if run is None else folder_of(run)
    _draw(found, plot or folder / 'truth.png')
    if write is not None:
        outputs.put(write, 'rpo truth --write', text)
        typer.echo(write)


def _flight(run: Path | None, scenario: str, controller: str) -> tuple[Flight, str]:
    from rpo_core.controller import load_controller
    from rpo_core.flight import fly
    from rpo_core.scenario import load_scenario
    from rpo_log.read.run_log import read_flight

    if run is not None:
        flight = read_flight(run)
        return flight, f'{run}, {flight.scenario.name}'
    chosen = load_controller(controller)
    return fly(load_scenario(scenario), chosen), f'{scenario}, controller {chosen.name}'


def markdown(found: Comparison) -> str:
    """Return the tables; they are printed as they stand in the documentation."""
    from rpo_training.truth.two_body import AXIS_NAMES

    scenario = found.scenario
    lines = [
        f'{found.title}: {scenario.duration_s:g} s under the same forces, open loop.',
        '',
        '| time | '
        + ' | '.join(f'linear − {name}, position | velocity' for name in found.errors)
        + ' |',
        '|---|' + '---|---|' * len(found.errors),
    ]
    for t_s, *errors in found.moments():
        cells = (f'{r:.2e} m | {v:.2e} m/s' for r, v in errors)
        lines.append(f'| {t_s:g} s | {" | ".join(cells)} |')
    if found.disagreement_m is not None:
        lines += ['', f'The two truths differ by at most {found.disagreement_m:.1e} m.']
    lines += [
        '',
        f'Drifting freely for {scenario.duration_s:g} s from rest at a distance, error of the '
        'linear plant (SciPy):',
        '',
        '| distance | ' + ' | '.join(f'along {axis}' for axis in AXIS_NAMES) + ' |',
        '|---|' + '---|' * len(AXIS_NAMES),
    ]
    for growth in found.growth:
        cells = (f'{error:.2g} m' for error in growth.position_m)
        lines.append(f'| {growth.distance_m:g} m | {" | ".join(cells)} |')
    return '\n'.join(lines) + '\n'


def _draw(found: Comparison, path: Path) -> None:
    from rpo_training.truth.picture import draw

    try:
        with outputs.writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            draw(found, path)
    except ModuleNotFoundError as error:
        typer.echo(f'No picture: {error.name} is not installed.', err=True)
    else:
        typer.echo(path)
