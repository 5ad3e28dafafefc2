# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Runtime assurance of a run: margins over time, and who acted when.

The stage is run again on the logged states and commands, as `rpo verify` does it: a log has the
interventions, and no margins of the ticks between them.
"""

from __future__ import annotations

from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from rpo.reports import guided
from rpo.reports.guided import Phase
from rpo.reports.logged import steps_again
from rpo.reports.page import Block, Fold, Section, Table, Text, picture
from rpo_core.assurance.abort import Change
from rpo_core.assurance.assurance import AssuranceStage
from rpo_core.assurance.kernels import FAR
from rpo_core.chain.flight import Flight
from rpo_core.kernels.arrays import Floats
from rpo_log.read.run_log import RunLog
from rpo_log.show import style

MOST_ROWS = 20
_LEAST_CHANGE_N = 0.01
"""So far the axis of the change of a command goes at least."""
_COLOURS = {
    'keep_out': 'y', 'speed': 'x', 'corridor': 'z', 'force': 'small_positive',
    'slew': 'small_negative', 'not_finite': 'bad',
}  # fmt: skip


class Decided(NamedTuple):
    """What assurance decided, tick by tick.

    margins : (n, 2) [m], [m/s] that the command as it came would leave one tick later
    changed_n : (n,) norm of the change of the command
    constraints, modes : n names; '' where the command passed
    changes : of the abort table
    """

    margins: Floats
    changed_n: Floats
    constraints: list[str]
    modes: list[str]
    changes: list[Change]


class Intervention(NamedTuple):
    """Ticks that follow each other in which one constraint acts."""

    constraint: str
    begin: int
    end: int


def decided(log: RunLog, flight: Flight) -> Decided | None:
    """Return what assurance decided; None if the run has none, or an input is missing."""
    found, stage = [], None
    for _, stage, _ in steps_again(log, flight, AssuranceStage):
        found.append(stage.decision)
    decisions = [decision for decision in found if decision is not None]
    if stage is None or not decisions:
        return None
    change = np.array([d.after_n for d in decisions]) - np.array([d.before_n for d in decisions])
    margins = np.array([(d.margin_m, d.margin_m_s) for d in decisions])
    margins[margins >= FAR] = np.nan  # after contact there is none
    return Decided(
        margins,
        np.linalg.norm(change, axis=1),
        [d.constraint for d in decisions],
        [d.mode for d in decisions],
        stage.abort.changes if stage.abort is not None else [],
    )


def interventions(constraints: list[str]) -> list[Intervention]:
    """Return the interventions, in order."""
    found, begin = [], 0
    for constraint, ticks in groupby(constraints):
        end = begin + len(list(ticks))
        if constraint:
            found.append(Intervention(constraint, begin, end))
        begin = end
    return found


def sections(flight: Flight, found: Decided | None, phases: list[Phase]) -> list[Section]:
    """Return the section of a report; none if the run has no assurance."""
    if found is None:
        return []
    acted = interventions(found.constraints)
    times, dt_s = flight.scenario.times_s, flight.scenario.dt_s
    rows: list[tuple[str, ...]] = []
    for name in dict.fromkeys(one.constraint for one in acted):
        ticks = found.constraints.count(name)
        count = sum(one.constraint == name for one in acted)
        changes = zip(found.changed_n, found.constraints, strict=True)
        largest = max(change for change, constraint in changes if constraint == name)
        rows.append((name, f'{count}', f'{ticks * dt_s:.1f}', f'{largest:.3g}'))
    columns = ('constraint', 'interventions', 'acting [s]', 'largest change of the command [N]')
    blocks: list[Block] = [
        Text(
            'Assurance passes a command if the state one tick later keeps every margin. Margins '
            'here are those that the command as it came would have left: where one is negative, '
            'or a limit of force or slew is passed, the command was changed.'
            + ('' if acted else ' Every command passed.')
        ),
    ]
    if acted:
        blocks.append(Table('Who acted', columns, tuple(rows)))
        blocks.append(Fold('Interventions', (_each(acted, found, times, phases),)))
    if found.changes:
        aborts = tuple((f'{times[c.tick]:.1f}', c.state, c.reason) for c in found.changes)
        blocks.append(Table('Abort table', ('from [s]', 'what', 'why'), aborts))
    least_m, least_m_s = np.nanmin(found.margins, axis=0)
    shown = picture(
        'assurance',
        _picture(flight, found, acted, phases),
        coloured='; change of the command. Coloured: a constraint acts' if acted else '',
        least_m=least_m,
        least_m_s=least_m_s,
        times=len(acted),
    )
    blocks.append(shown)
    return [Section('Assurance', tuple(blocks))]


def _each(acted: list[Intervention], found: Decided, times: Floats, phases: list[Phase]) -> Table:
    """Return the longest interventions, in their order."""
    longest = sorted(acted, key=lambda one: one.begin - one.end)[:MOST_ROWS]
    rows = []
    for one in sorted(longest, key=lambda one: one.begin):
        part = slice(one.begin, one.end)
        phase = next((p.name for p in phases if p.begin <= one.begin < p.end), '–')
        least = np.nanmin(found.margins[part], axis=0)
        rows.append(
            (
                *(f'{times[min(tick, len(times) - 1)]:.1f}' for tick in (one.begin, one.end)),
                *(one.constraint, found.modes[one.begin], phase),
                *(f'{value:.3g}' for value in (*least, found.changed_n[part].max())),
            )
        )
    columns = (
        'from [s]', 'to [s]', 'constraint', 'mode', 'phase of the plan', 'least margin [m]',
        'least margin [m/s]', 'largest change [N]',
    )  # fmt: skip
    name = f'Interventions: {len(acted)}'
    if len(acted) > MOST_ROWS:
        name += f'; the {MOST_ROWS} longest'
    return Table(name, columns, tuple(rows))


def _picture(flight: Flight, found: Decided, acted: list[Intervention], phases: list[Phase]) -> Any:
    count = 3 if acted else 2
    figure, panels = style.new_panels(2.0 * count, count, sharex=True)
    times = flight.scenario.times_s
    shown = (
        (found.margins[:, 0], 'margin [m]'),
        (found.margins[:, 1], 'margin [m/s]'),
        (found.changed_n, 'change [N]'),
    )
    for axes, (values, label) in zip(panels, shown, strict=False):
        axes.plot(times, values, color=style.LIGHT['ink'], linewidth=1.0)
        axes.axhline(0.0, **style.LIMIT)
        axes.set_ylabel(label)
        axes.margins(x=0.01)
        for name in dict.fromkeys(one.constraint for one in acted):
            acting = np.array([constraint == name for constraint in found.constraints])
            acting[1:] |= acting[:-1]  # a force acts to the end of its tick
            axes.fill_between(
                times, 0.0, 1.0, where=acting, transform=axes.get_xaxis_transform(), alpha=0.35,
                color=style.LIGHT[_COLOURS.get(name, 'muted')], linewidth=0.0,
                label=f'acts: {name}',
            )  # fmt: skip
    panels[-1].set_xlabel('time [s]')
    if acted:
        panels[-1].set_ylim(0.0, max(_LEAST_CHANGE_N, 1.05 * float(found.changed_n.max())))
        style.legend_below(figure, panels[0])
    changes = [Phase(c.state, c.reason, c.tick, c.tick) for c in found.changes]
    guided.mark(figure, sorted([*phases, *changes], key=lambda phase: phase.begin), flight)
    return figure
