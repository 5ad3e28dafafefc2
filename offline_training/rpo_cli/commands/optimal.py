# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo optimal`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rpo_cli.commands.shared import SameScenario, chosen_scenario, write_flight
from rpo_cli.display import print_table, progress
from rpo_core.files import DEFAULT_SCENARIO
from rpo_core.files.validation import InputError, shown

if TYPE_CHECKING:
    from rpo_core.chain.flight import Flight
    from rpo_core.files.scenario import Scenario, ScenarioSet


_BEST = 'under all conditions'


def optimal(
    named: Annotated[
        str,
        typer.Argument(
            metavar='SCENARIO', help='shipped name or file  [approach; for starts paper_training]'
        ),
    ] = '',
    start: Annotated[
        str | None, typer.Option(metavar='X,Y,Z[,VX,VY,VZ]', help='position [m], velocity [m/s]')
    ] = None,
    scenario: SameScenario = '',
    duration: Annotated[float | None, typer.Option(help='time of flight [s]')] = None,
    controller: Annotated[
        str | None, typer.Option(help='fly this one too, and compare its J')
    ] = None,
    csv: Annotated[
        Path | None, typer.Option(help='write the flight of the constrained optimum')
    ] = None,
    whole_set: Annotated[
        bool, typer.Option('--all-starts', help='the means over all starts of a scenario set')
    ] = False,
    margin: Annotated[
        float, typer.Option(help='share by which each condition is stricter, 0.03 for 3 %')
    ] = 0.0,
) -> None:
    """Print the least energy that physics allows, without and with training's conditions.

    The start is the scenario's, if none is given.
    """
    from dataclasses import replace

    from rpo_core.files.scenario import ScenarioSet, load, load_set

    scenario = chosen_scenario(
        named, scenario, 'paper_training' if start or whole_set else DEFAULT_SCENARIO
    )
    if whole_set:
        if any(option is not None for option in (start, duration, controller, csv)):
            raise InputError(
                '`--all-starts` takes a set of starts as it is: give only the scenario'
            )
        _of_set(load_set(scenario), margin)
        return
    found = load(scenario)
    base = found.base if isinstance(found, ScenarioSet) else found
    if start is None and isinstance(found, ScenarioSet):
        raise InputError(f'`--start` or `--all-starts` is needed: {scenario} is a set of starts')
    if start is not None:
        base = _with_start(base, start)
    if duration is not None:
        base = replace(base, duration_s=duration)
    _of_start(base, controller, csv, margin)


def _with_start(base: Scenario, text: str) -> Scenario:
    from dataclasses import replace

    try:
        numbers = [float(part) for part in text.split(',')]
    except ValueError:
        numbers = []
    if len(numbers) not in (3, 6):
        raise InputError(f'`--start` must be 3 or 6 numbers like 100,100,100; got {shown(text)}')
    position, velocity = numbers[:3], numbers[3:] or [0.0, 0.0, 0.0]
    return replace(
        base,
        initial_position_m=position,  # type: ignore[arg-type]
        initial_velocity_m_s=velocity,  # type: ignore[arg-type]
    )


def _of_start(scenario: Scenario, controller: str | None, csv: Path | None, margin: float) -> None:
    from rpo_core.chain.flight import fly
    from rpo_core.control.controller import load_controller
    from rpo_judge.evaluation import optimal as limits

    coast = limits.COAST_S
    flights = {'to rest at the end': limits.to_rest(scenario)}
    if scenario.duration_s > coast + 2 * scenario.dt_s:
        flights[f'to rest {coast:g} s earlier'] = limits.to_rest(scenario, coast)
    flights[_BEST] = limits.constrained(scenario, limits.Conditions.of(scenario, margin))
    if csv:
        write_flight(flights[_BEST], csv)
    if controller is not None:
        flights[controller] = fly(scenario, load_controller(controller))
    _print(scenario, flights)


def _print(scenario: Scenario, flights: dict[str, Flight]) -> None:
    from rpo_core.judge import metrics

    best = metrics.of_flight(flights[_BEST]).energy_n2s
    position = ', '.join(f'{r:g}' for r in scenario.initial_position_m)
    rows = []
    for name, flight in flights.items():
        f = metrics.of_flight(flight)
        peak = abs(flight.saturated_forces_n).max()
        others = (f.mean_speed_norm_m_s, f.mean_error_norm_m, f.slew_per_axis_n_s, peak)
        ratio = f'{f.energy_n2s / best:.3f}'
        rows.append((name, f'{f.energy_n2s:.4f}', ratio, *(f'{x:.4f}' for x in others)))
    print_table(
        ('', 'J, N^2 s', '/ best', 'v, m/s', 'r, m', 'slew, N/s', '|f|, N'),
        rows,
        title=f'Least energy from [{position}] m in {scenario.duration_s:g} s',
    )
    typer.echo('v, r: mean norms over the last 30 s. To rest: at the origin, without limits.')


def _of_set(starts: ScenarioSet, margin: float) -> None:
    import numpy as np

    from rpo_judge.evaluation import optimal as limits

    base, positions = starts.base, starts.initial_positions_m
    states = np.hstack([positions, np.tile(base.initial_velocity_m_s, (len(positions), 1))])
    with progress() as show:
        constrained = limits.least_constrained(
            base, states, lambda done, total: show('optima of all starts', done, total), margin
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
