# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""`rpo plan`."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rpo_cli.commands.shared import Set, draw
from rpo_cli.display import print_table
from rpo_core.files.validation import InputError

if TYPE_CHECKING:
    from rpo_core.files.scenario import Scenario
    from rpo_guidance.plan import Guidance
    from rpo_guidance.rehearsal import Checked

ENTRIES = 8
"""Moments of entry that are shown."""

DOCKED_S = 6.0
"""So long after its plan ends the flight ends in a scenario that is written."""


def plan(
    scenario: Annotated[str, typer.Argument(help='shipped name or file')],
    changes: Set = None,
    picture: Annotated[Path | None, typer.Option(help='write the plan as a picture')] = None,
    entry: Annotated[
        Path | None,
        typer.Option(help='meet a target that turns when that needs least energy: write the plan'),
    ] = None,
) -> None:
    """Print the legs of a plan, flown without errors, and their energy."""
    from rpo_core.files import overrides
    from rpo_guidance.plan import Guidance
    from rpo_guidance.rehearsal import nominal

    chosen = overrides.load(scenario, changes or [])
    settings = chosen.section(Guidance)
    if settings is None:
        raise InputError(f'scenario {chosen.name} has no section `guidance`')
    if entry is not None:
        settings, chosen = _entered(settings, chosen, entry)
    flown = nominal(settings, chosen)
    print_table(
        ('phase', 'begins, s', 'ends, s', 'J, N^2 s', 'range, m', '|f|, N', 'why'),
        _rows(flown, chosen),
        title=f'Plan of {chosen.name}',
    )
    over = len(flown.changes) > len(settings.legs)
    ticks = flown.changes[len(settings.legs)].tick if over else chosen.ticks
    energy = _energy_n2s(flown, 0, ticks, chosen)
    typer.echo(f'The legs take {ticks * chosen.dt_s:.1f} s and {energy:.4f} N^2 s')
    if chosen.target is not None and any(map(settings.turns, range(len(settings.legs)))):
        typer.echo(_followed(settings, chosen))
    if picture is not None:
        from rpo_report import run_plots

        draw(picture, run_plots.draw, flown, energy, settings, chosen)


def _energy_n2s(flown: Checked, begin: int, end: int, scenario: Scenario) -> float:
    """Return the energy of the forces of these ticks."""
    return math.fsum(f * f for force in flown.forces[begin:end] for f in force) * scenario.dt_s


def _rows(flown: Checked, scenario: Scenario) -> list[tuple[str, ...]]:
    """Return a row of text for each phase: name, times, energy, least range, largest force, why."""
    from rpo_kernels.kernels import norm

    ends = [*(change.tick for change in flown.changes[1:]), scenario.ticks + 1]
    return [
        (
            change.phase,
            f'{change.tick * scenario.dt_s:.1f}',
            f'{(end - 1) * scenario.dt_s:.1f}',
            f'{_energy_n2s(flown, change.tick, end, scenario):.4f}',
            f'{min(norm(*state[:3]) for state in flown.references[change.tick : end]):.2f}',
            f'{max(abs(f) for force in flown.forces[change.tick : end] for f in force):.3f}',
            change.reason,
        )
        for change, end in zip(flown.changes, ends, strict=True)
    ]


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
