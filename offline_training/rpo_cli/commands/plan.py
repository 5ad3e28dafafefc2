# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo plan`."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rpo_cli.commands.shared import Set, draw
from rpo_cli.display import print_table, progress
from rpo_core.files.validation import InputError

if TYPE_CHECKING:
    from rpo_core.files.scenario import Scenario
    from rpo_guidance.plan import Guidance
    from rpo_judge.evaluation.plan_bound import Bound, KeepOut

ENTRIES = 8
"""Moments of entry that are shown."""

DOCKED_S = 6.0
"""So long after its plan ends the flight ends in a scenario that is written."""


def plan(
    scenario: Annotated[str, typer.Argument(help='shipped name or file, or folder of a campaign')],
    changes: Set = None,
    picture: Annotated[Path | None, typer.Option(help='write the plan as a picture')] = None,
    margins: Annotated[
        bool, typer.Option('--margins', help='others keep to the zones that transfers plan with')
    ] = False,
    entry: Annotated[
        Path | None,
        typer.Option(help='meet a target that turns when that needs least energy: write the plan'),
    ] = None,
    sample: Annotated[int, typer.Option(min=1, help='runs of a campaign that are compared')] = 100,
) -> None:
    """Print the legs of a plan, and its energy beside other paths out of its zones.

    Others have the same begin, end and time: the best that is found, and a bound that is below all.
    For the folder of a campaign: the energy that its runs flew, beside others.
    """
    from rpo_core.files import overrides
    from rpo_guidance.plan import Guidance
    from rpo_judge.evaluation import plan_bound
    from rpo_judge.evaluation.plan_bound import KeepOut

    if Path(scenario).is_dir():
        _compare(Path(scenario), sample)
        return
    chosen = overrides.load(scenario, changes or [])
    settings = chosen.section(Guidance)
    if settings is None:
        raise InputError(f'scenario {chosen.name} has no section `guidance`')
    if entry is not None:
        settings, chosen = _entered(settings, chosen, entry)
    found, energies = plan_bound.bound(settings, chosen, margins)
    print_table(
        ('phase', 'begins, s', 'ends, s', 'J, N^2 s', 'range, m', '|f|, N', 'why'),
        plan_bound.rows(found, chosen),
        title=f'Plan of {chosen.name}',
    )
    typer.echo(_said(energies, KeepOut.of(settings, margins)))
    if chosen.target is not None and any(map(settings.turns, range(len(settings.legs)))):
        typer.echo(_followed(settings, chosen))
    if picture is not None:
        from rpo_report import run_plots

        draw(picture, run_plots.draw, found, energies, settings, chosen)


def _entered(settings: Guidance, scenario: Scenario, path: Path) -> tuple[Guidance, Scenario]:
    """Print plans that meet the target at other moments, and write the one of least energy."""
    from rpo_core.files.scenario import dumps
    from rpo_guidance.entry import entries
    from rpo_montecarlo import outputs

    found = entries(settings, scenario)
    cheapest = min(found, key=lambda e: e.delta_v_m_s)
    print_table(
        ('transfer, s', 'corridor, s', 'line, m/s', 'ends, s', 'J, N^2 s', 'delta-v, m/s', ''),
        [
            (
                f'{e.leg.duration_s:g}',
                f'{e.leg.corridor_s:g}' if e.leg.corridor_s else '-',
                f'{e.line.speed_m_s:g}' if e.line and e.line.speed_m_s else '-',
                f'{e.ends_s:.1f}',
                f'{e.energy_n2s:.4f}',
                f'{e.delta_v_m_s:.4f}',
                'chosen' if e is found[0] else 'least delta-v' if e is cheapest else '',
            )
            for e in [*found[:ENTRIES], *([] if cheapest in found[:ENTRIES] else [cheapest])]
        ],
        title=f'{len(found)} moments of entry, by energy',
    )
    chosen, dt_s = found[0].settings, scenario.dt_s
    duration_s = scenario.duration_s
    if chosen.past_port_m:  # docked, it would drift while the target turns
        ticks = round((found[0].ends_s + DOCKED_S) / dt_s)
        duration_s = min(duration_s, round(ticks * dt_s, 9))
    written = replace(scenario.equipped(chosen), name=path.stem, duration_s=duration_s)
    outputs.write_text(path, dumps(written))
    typer.echo(path)
    return chosen, written


def _followed(settings: Guidance, scenario: Scenario) -> str:
    """Return in words how fast a turn the thrusters can follow."""
    from rpo_guidance.entry import most_turn

    rate, far_m, fast_m_s = most_turn(settings, scenario)
    return (
        f'At {far_m:g} m from the target and {fast_m_s:g} m/s, guidance with these thrusters '
        f'follows a target that turns at most {math.degrees(rate):.3f} deg/s, whatever its '
        f'attitude; this one turns at most {math.degrees(scenario.target.fastest_rad_s):.3f} deg/s'
    )


def _said(energies: Bound, zone: KeepOut) -> str:
    """Return in words how a plan compares with others."""
    lower = math.floor(energies.lower * 1e4) / 1e4  # what is printed is a bound too
    within = f' that never come within {zone.radius_m:g} m of the target' if zone.radius_m else ''
    if zone.slope:
        within += f' but in the cone of {math.degrees(math.atan(zone.slope)):.1f} degrees'
    best = 'none was found that keeps to the force of the thrusters too'
    if math.isfinite(energies.best):
        more = energies.plan / energies.best
        best = f'the best found needs {energies.best:.4f}: the plan {more:.3f} times as much'
    least = f'none needs less than {lower:.4f}'
    if lower > 0.0:
        more = math.ceil(energies.plan / lower * 1e3) / 1e3
        least += f': the plan at most {more:.3f} times the least'
    if not energies.closed:
        least += '. The search for this bound ended early: a higher one may hold'
    return (
        f'{energies.duration_s:g} s: the plan needs {energies.plan:.4f} N^2 s. Of all paths with '
        f'its begin, end and time{within},\n  {best};\n  {least}'
    )


def _compare(folder: Path, sample: int) -> None:
    """Print how the flown energy of some runs compares with other paths out of their zones."""
    import numpy as np

    from rpo_judge.evaluation.plan_bound import ratios
    from rpo_montecarlo.campaign.store import Store

    store = Store.open(folder)
    if not store.finished:
        raise InputError(f'{folder}: is not finished: go on with `rpo campaign --resume`')
    with progress() as show:
        found = ratios(store, sample, lambda n: show('runs', n, sample))
    rows = []
    for name, other in product(('flown', 'plan'), ('best', 'lower')):
        shares = np.array([getattr(r, name) / getattr(r, other) for r in found])
        worst = found[int(shares.argmax())].run
        numbers = (*np.quantile(shares, (0.0, 0.5, 0.95)), shares.max())
        over = 'best path found' if other == 'best' else 'lower bound'
        rows.append((name, over, *(f'{x:.3f}' for x in numbers), str(worst)))
    print_table(
        ('energy', 'over the', 'least', '50 %', '95 %', 'worst', 'run'),
        rows,
        title=f'{store.campaign.config.name}: {len(found)} of {store.campaign.config.runs} runs',
    )
