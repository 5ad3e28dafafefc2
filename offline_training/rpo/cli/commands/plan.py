# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo plan` and `rpo optimal`: what a flight takes, with a plan and at the least."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from rpo.cli.commands.shared import Set, draw, numbers_of
from rpo.display import print_table, progress
from rpo_core.files import DEFAULT_SCENARIO
from rpo_core.files.validation import InputError, shown

if TYPE_CHECKING:
    from rpo_core.guidance.guidance import Guidance
    from rpo_core.scenario.scenario import Scenario, ScenarioSet

ENTRIES = 8
"""Moments of entry that are shown."""

DOCKED_S = 6.0
"""So long after its plan ends the flight ends in a scenario that is written."""

_BEST = 'under all conditions'


def plan(
    scenario: Annotated[str, Argument(help='shipped name or file')],
    changes: Set = None,
    picture: Annotated[Path | None, Option(help='write the plan as a picture')] = None,
    entry: Annotated[
        Path | None, Option(help='when to meet a target that turns, by energy: write the plan')
    ] = None,
) -> None:
    """Print the legs of a plan, flown without errors, and their energy."""
    from rpo_core.guidance.entry import most_turn
    from rpo_core.guidance.guidance import Guidance, nominal
    from rpo_core.kernels.arithmetic import norm
    from rpo_core.scenario import overrides

    chosen = overrides.load(scenario, changes or [])
    settings = chosen.section(Guidance)
    if settings is None:
        raise InputError(f'scenario {chosen.name} has no section `guidance`')
    if entry is not None:
        settings, chosen = _entered(settings, chosen, entry)
    flown, dt_s = nominal(settings, chosen), chosen.dt_s

    def energy_n2s(begin: int, end: int) -> float:
        return math.fsum(f * f for force in flown.forces[begin:end] for f in force) * dt_s

    rows = []
    ends = [*(change.tick for change in flown.changes[1:]), chosen.ticks + 1]
    for change, end in zip(flown.changes, ends, strict=True):
        begin = change.tick
        near_m = min(norm(*state[:3]) for state in flown.references[begin:end])
        peak_n = max(abs(f) for force in flown.forces[begin:end] for f in force)
        numbers = f'{begin * dt_s:.1f}', f'{(end - 1) * dt_s:.1f}', f'{energy_n2s(begin, end):.4f}'
        rows.append((change.phase, *numbers, f'{near_m:.2f}', f'{peak_n:.3f}', change.reason))
    headings = ('phase', 'begins, s', 'ends, s', 'J, N²s', 'range, m', '|f|, N', 'why')
    print_table(headings, rows, f'Plan of {chosen.name}')
    over = len(flown.changes) > len(settings.legs)
    ticks = flown.changes[len(settings.legs)].tick if over else chosen.ticks
    energy = energy_n2s(0, ticks)
    typer.echo(f'The legs take {ticks * dt_s:.1f} s and {energy:.4f} N²s')
    if chosen.target is not None and any(map(settings.turns, range(len(settings.legs)))):
        rate, far_m, fast_m_s = most_turn(settings, chosen)
        typer.echo(
            f'At {far_m:g} m from the target and {fast_m_s:g} m/s, guidance with these thrusters '
            f'follows a target that turns at most {math.degrees(rate):.3f} deg/s, whatever its '
            f'attitude; this one turns at most {math.degrees(chosen.target.fastest_rad_s):.3f} '
            'deg/s'
        )
    if picture is not None:
        from rpo.reports import run_plots

        draw(picture, run_plots.draw, flown, energy, settings, chosen)


def _entered(settings: Guidance, scenario: Scenario, path: Path) -> tuple[Guidance, Scenario]:
    """Print plans that meet the target at other moments, and write the one of least energy."""
    from rpo.montecarlo import outputs
    from rpo_core.guidance.entry import entries
    from rpo_core.scenario.scenario import dumps

    found = entries(settings, scenario)
    cheapest = min(found, key=lambda e: e.delta_v_m_s)
    shown, rows = found[:ENTRIES], []
    for e in shown if cheapest in shown else [*shown, cheapest]:
        corridor = f'{e.leg.corridor_s:g}' if e.leg.corridor_s else '-'
        line = f'{e.line.speed_m_s:g}' if e.line and e.line.speed_m_s else '-'
        spent = f'{e.ends_s:.1f}', f'{e.energy_n2s:.4f}', f'{e.delta_v_m_s:.4f}'
        why = 'chosen' if e is found[0] else 'least delta-v' if e is cheapest else ''
        rows.append((f'{e.leg.duration_s:g}', corridor, line, *spent, why))
    headings = (
        'transfer, s', 'corridor, s', 'line, m/s', 'ends, s', 'J, N²s', 'delta-v, m/s', '',
    )  # fmt: skip
    print_table(headings, rows, f'{len(found)} moments of entry, by energy')
    chosen, duration_s = found[0].settings, scenario.duration_s
    if chosen.past_port_m:  # docked, it would drift while the target turns
        ticks = round((found[0].ends_s + DOCKED_S) / scenario.dt_s)
        duration_s = min(duration_s, round(ticks * scenario.dt_s, 9))
    written = replace(scenario.equipped(chosen), name=path.stem, duration_s=duration_s)
    outputs.write_text(path, dumps(written))
    typer.echo(path)
    return chosen, written


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
        numbers = numbers_of(start)
        if len(numbers) not in (3, 6):
            raise InputError(
                f'`--start` must be 3 or 6 numbers like 100,100,100; got {shown(start)}'
            )
        base = base.starting_at((*numbers, 0.0, 0.0, 0.0)[:6])
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
    headings = ('', 'J, N²s', '/ best', 'v, m/s', 'r, m', 'slew, N/s', '|f|, N')
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
            f'{name:22s} mean J {energies.mean():.4f} N²s of {len(energies)} starts '
            f'({energies.min():.4f} to {energies.max():.4f})'
        )
