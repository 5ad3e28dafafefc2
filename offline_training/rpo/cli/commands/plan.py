# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo plan`."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from rpo.cli.commands.shared import Set, draw
from rpo.cli.display import print_table
from rpo_core.files.validation import InputError

if TYPE_CHECKING:
    from rpo_core.guidance.guidance import Guidance
    from rpo_core.scenario.scenario import Scenario

ENTRIES = 8
"""Moments of entry that are shown."""

DOCKED_S = 6.0
"""So long after its plan ends the flight ends in a scenario that is written."""


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
    headings = ('phase', 'begins, s', 'ends, s', 'J, N^2 s', 'range, m', '|f|, N', 'why')
    print_table(headings, rows, f'Plan of {chosen.name}')
    over = len(flown.changes) > len(settings.legs)
    ticks = flown.changes[len(settings.legs)].tick if over else chosen.ticks
    energy = energy_n2s(0, ticks)
    typer.echo(f'The legs take {ticks * dt_s:.1f} s and {energy:.4f} N^2 s')
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
        'transfer, s', 'corridor, s', 'line, m/s', 'ends, s', 'J, N^2 s', 'delta-v, m/s', '',
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
