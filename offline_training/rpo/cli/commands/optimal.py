# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo optimal`."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from rpo.cli.display import print_table, progress
from rpo_core.files import DEFAULT_SCENARIO
from rpo_core.files.validation import InputError, shown

if TYPE_CHECKING:
    from rpo_core.scenario.scenario import Scenario, ScenarioSet

_BEST = 'under all conditions'


def optimal(
    scenario: Annotated[
        str, Argument(help='name or file  [approach; with --start paper_training]')
    ] = '',
    start: Annotated[
        str | None, Option(metavar='X,Y,Z[,VX,VY,VZ]', help='position [m], velocity [m/s]')
    ] = None,
    duration: Annotated[float | None, Option(help='time of flight [s]')] = None,
    controller: Annotated[str | None, Option(help='fly this one too, and compare its J')] = None,
) -> None:
    """Print the least energy that physics allows, without and with training's conditions.

    The start is the scenario's, if none is given; of a set of starts it prints the means.
    """
    from rpo_core.scenario.scenario import ScenarioSet, load

    loaded = load(scenario or ('paper_training' if start else DEFAULT_SCENARIO))
    if start is None and isinstance(loaded, ScenarioSet):
        if duration is not None or controller is not None:
            raise InputError(f'{scenario} is a set of starts: give `--start` too')
        _of_set(loaded)
        return
    base = loaded.base if isinstance(loaded, ScenarioSet) else loaded
    if start is not None:
        try:
            numbers = [float(part) for part in start.split(',')]
        except ValueError:
            numbers = []
        if len(numbers) not in (3, 6):
            raise InputError(
                f'`--start` must be 3 or 6 numbers like 100,100,100; got {shown(start)}'
            )
        x, y, z, vx, vy, vz = (*numbers, 0.0, 0.0, 0.0)[:6]
        base = replace(base, initial_position_m=(x, y, z), initial_velocity_m_s=(vx, vy, vz))
    if duration is not None:
        base = replace(base, duration_s=duration)
    _of_start(base, controller)


def _of_start(scenario: Scenario, controller: str | None) -> None:
    from rpo.analysis import optimal as limits
    from rpo_core.chain.flight import fly
    from rpo_core.control.controller import load_controller
    from rpo_core.judge import metrics

    coast = limits.COAST_S
    flights = {'to rest at the end': limits.to_rest(scenario)}
    if scenario.duration_s > coast + 2 * scenario.dt_s:
        flights[f'to rest {coast:g} s earlier'] = limits.to_rest(scenario, coast)
    flights[_BEST] = limits.constrained(scenario)
    if controller is not None:
        flights[controller] = fly(scenario, load_controller(controller))
    best = metrics.of_flight(flights[_BEST]).energy_n2s
    position = ', '.join(f'{r:g}' for r in scenario.initial_position_m)
    rows = []
    for name, flight in flights.items():
        f = metrics.of_flight(flight)
        peak = abs(flight.saturated_forces_n).max()
        others = (f.mean_speed_norm_m_s, f.mean_error_norm_m, f.slew_per_axis_n_s, peak)
        ratio = f'{f.energy_n2s / best:.3f}'
        rows.append((name, f'{f.energy_n2s:.4f}', ratio, *(f'{x:.4f}' for x in others)))
    title = f'Least energy from [{position}] m in {scenario.duration_s:g} s'
    headings = ('', 'J, N^2 s', '/ best', 'v, m/s', 'r, m', 'slew, N/s', '|f|, N')
    print_table(headings, rows, title)
    typer.echo('v, r: mean norms over the last 30 s. To rest: at the origin, without limits.')


def _of_set(starts: ScenarioSet) -> None:
    import numpy as np

    from rpo.analysis import optimal as limits

    base, positions = starts.base, starts.initial_positions_m
    states = np.hstack([positions, np.tile(base.initial_velocity_m_s, (len(positions), 1))])
    with progress() as show:
        constrained = limits.least_constrained(
            base, states, lambda done, total: show('optima of all starts', done, total)
        )
    lines = {
        'to rest at the end': limits.least_energy(base, states),
        f'to rest {limits.COAST_S:g} s earlier': limits.least_energy(base, states, limits.COAST_S),
        _BEST: constrained,
    }
    for name, energies in lines.items():
        typer.echo(
            f'{name:22s} mean J {energies.mean():.4f} N^2 s of {len(energies)} starts '
            f'({energies.min():.4f} to {energies.max():.4f})'
        )
