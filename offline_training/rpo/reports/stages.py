# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the stages of a run did: guidance, assurance, the estimator, the attitude of the chaser.

A log has no `guidance_status`, no margins of the ticks between interventions, and no whole
covariance. So a stage is run again on what it read in flight, as `rpo verify` does it.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from rpo.analysis.turned import Panel, panels_of, turned_of
from rpo.reports import stages
from rpo.reports.logged import steps_again
from rpo.reports.page import Block, Fold, Section, Table, Text, picture
from rpo_core.assurance.abort import Change
from rpo_core.assurance.assurance import AssuranceStage
from rpo_core.assurance.kernels import FAR
from rpo_core.chain.flight import Flight
from rpo_core.guidance.guidance import GuidanceStage
from rpo_core.judge.verdicts import number
from rpo_core.kernels.arrays import Floats
from rpo_core.navigation.estimator import EstimatorStage
from rpo_core.wire.interfaces import REFERENCE_STATE
from rpo_core.world.zones import zones_of
from rpo_log.read.run_log import RunLog
from rpo_log.show import style
from rpo_log.show.report import by_axis, close_up_ticks

EXACT = 1e-6
"""A state closer to its reference [m, m/s] is on it."""

_FLOOR_M, _FLOOR_M_S = 1e-4, 1e-5
"""Smaller errors are drawn as these: the scale is logarithmic."""
_LETTER_PT = 5.6
"""Width of a letter of a phase's name, about."""


class Phase(NamedTuple):
    """A phase of the plan, from its first tick up to the one after its last.

    One that another follows at the same tick lasts no tick: `begin` is `end`.
    """

    name: str
    reason: str
    begin: int
    end: int


def phases_of(log: RunLog, flight: Flight) -> list[Phase]:
    """Return the phases of a run; none if it has no guidance, or a state is missing."""
    stages = [stage for _, stage, _ in steps_again(log, flight, GuidanceStage)]
    changes = stages[-1].changes if stages else []
    ends = [*(change.tick for change in changes[1:]), len(flight.states)]
    return [
        Phase(change.phase, change.reason, change.tick, end)
        for change, end in zip(changes, ends, strict=False)
    ]


def follows(flight: Flight) -> bool:
    """Whether the controller followed a reference."""
    return REFERENCE_STATE in flight.signals


def errors_of(flight: Flight) -> Floats:
    """Return true states (n, 6) relative to the reference, or to the goal where there is none."""
    return flight.states - flight.signals[REFERENCE_STATE] if follows(flight) else flight.errors


def guidance_sections(flight: Flight, phases: list[Phase]) -> list[Section]:
    """Return the section of a report; none if the run has no guidance."""
    if not phases:
        return []
    miss = errors_of(flight)
    errors, speeds = (np.linalg.norm(part, axis=1) for part in (miss[:, :3], miss[:, 3:]))
    ranges, exact = np.linalg.norm(flight.positions_m, axis=1), bool(np.abs(miss).max() < EXACT)
    times = flight.scenario.times_s
    rows = []
    for phase in phases:
        part = slice(phase.begin, phase.end)
        figures = ['–'] * 3
        if phase.end > phase.begin:
            numbers = (ranges[part].min(), errors[part].max(), speeds[part].max())
            figures = [f'{value:.3g}' for value in numbers]
        ends = (f'{times[min(tick, len(times) - 1)]:.1f}' for tick in (phase.begin, phase.end))
        rows.append((phase.name, *ends, *figures, phase.reason))
    columns = (
        'phase', 'from [s]', 'to [s]', 'least range [m]', 'largest distance to the reference [m]',
        'largest speed relative to it [m/s]', 'why it began',
    )  # fmt: skip
    figure = _guidance_picture(flight, phases, ranges, () if exact else (errors, speeds))
    key = 'guidance, of a chaser on its reference' if exact else 'guidance'
    shown = picture(key, figure, most_m=errors.max(), phases=len(phases))
    return [Section('Guidance', (Table('Phases of the plan', columns, tuple(rows)), shown))]


def _guidance_picture(
    flight: Flight, phases: list[Phase], ranges: Floats, misses: Sequence[Floats]
) -> Any:
    count = 1 + len(misses)
    figure, column = style.new_panels(1.0 + 1.6 * count, count, 1, sharex=True, squeeze=False)
    times, panels = flight.scenario.times_s, column[:, 0]
    shown = zip(
        panels,
        (ranges, *misses),
        (0.0, _FLOOR_M, _FLOOR_M_S),
        ('range [m]', 'from reference [m]', 'relative speed [m/s]'),
        strict=False,
    )
    for axes, values, floor, label in shown:
        by_axis(axes, times, np.maximum(values, floor), label, 1.2)
        if axes is not panels[0]:
            style.log_scale(axes)
    panels[0].set_ylim(0.0, None)
    for radius in {zones.keep_out_m for zones in zones_of(flight.scenario)} - {0.0}:
        panels[0].axhline(radius, **style.LIMIT)
    panels[-1].set_xlabel('time [s]')
    mark(figure, phases, flight)
    return figure


def mark(figure: Any, phases: list[Phase], flight: Flight) -> None:
    """Draw a line where a phase begins, in every panel over time, and name it above the first."""
    over_time = [
        axes
        for axes in figure.axes
        if any(
            one.get_xlabel() == 'time [s]'
            for one in (axes, *axes.get_shared_x_axes().get_siblings(axes))
        )
    ]
    times = flight.scenario.times_s
    for i, axes in enumerate(over_time):
        low, high = axes.get_xlim()
        shown = [p for p in phases if low <= times[p.begin] <= high]
        for phase in shown:
            axes.axvline(times[phase.begin], color=style.LIGHT['muted'], linewidth=0.8)
        axes.set_xlim(low, high)
        if i == 0:
            _name(axes, shown, times)


def _name(axes: Any, phases: list[Phase], times: Floats) -> None:
    """Write the names above the axes, in rows so that none touches another."""
    low, high = axes.get_xlim()
    width_pt = axes.get_position().width * axes.figure.get_figwidth() * 72.0
    ends: list[float] = []  # of the last name in each row [pt]
    base = 4.0 if not axes.get_title() else 18.0
    for phase in phases:
        place = width_pt * (times[phase.begin] - low) / (high - low)
        row = next((i for i, end in enumerate(ends) if end < place), len(ends))
        ends[row : row + 1] = [place + _LETTER_PT * (len(phase.name) + 1)]
        axes.annotate(
            phase.name, (times[phase.begin], 1.0), xycoords=axes.get_xaxis_transform(),
            xytext=(0.0, base + 11.0 * row), textcoords='offset points', fontsize=8.5,
            color=style.LIGHT['muted'],
        )  # fmt: skip


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
    decided, stage = [], None
    for _, stage, _ in steps_again(log, flight, AssuranceStage):
        decided.append(stage.decision)
    decisions = [decision for decision in decided if decision is not None]
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
    acts, begin = [], 0
    for constraint, ticks in groupby(constraints):
        end = begin + len(list(ticks))
        if constraint:
            acts.append(Intervention(constraint, begin, end))
        begin = end
    return acts


def assurance_sections(
    flight: Flight, decisions: Decided | None, phases: list[Phase]
) -> list[Section]:
    """Return the section of a report; none if the run has no assurance."""
    if decisions is None:
        return []
    acted = interventions(decisions.constraints)
    times, dt_s = flight.scenario.times_s, flight.scenario.dt_s
    rows: list[tuple[str, ...]] = []
    for name in dict.fromkeys(one.constraint for one in acted):
        ticks = decisions.constraints.count(name)
        count = sum(one.constraint == name for one in acted)
        changes = zip(decisions.changed_n, decisions.constraints, strict=True)
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
        blocks.append(Fold('Interventions', (_each(acted, decisions, times, phases),)))
    if decisions.changes:
        aborts = tuple((f'{times[c.tick]:.1f}', c.state, c.reason) for c in decisions.changes)
        blocks.append(Table('Abort table', ('from [s]', 'what', 'why'), aborts))
    least_m, least_m_s = np.nanmin(decisions.margins, axis=0)
    shown = picture(
        'assurance',
        _assurance_picture(flight, decisions, acted, phases),
        coloured='; change of the command. Coloured: a constraint acts' if acted else '',
        least_m=least_m,
        least_m_s=least_m_s,
        times=len(acted),
    )
    blocks.append(shown)
    return [Section('Assurance', tuple(blocks))]


def _each(
    acted: list[Intervention], decisions: Decided, times: Floats, phases: list[Phase]
) -> Table:
    """Return the longest interventions, in their order."""
    longest = sorted(acted, key=lambda one: one.begin - one.end)[:MOST_ROWS]
    rows = []
    for one in sorted(longest, key=lambda one: one.begin):
        part = slice(one.begin, one.end)
        phase = next((p.name for p in phases if p.begin <= one.begin < p.end), '–')
        min_margins = np.nanmin(decisions.margins[part], axis=0)
        rows.append(
            (
                *(f'{times[min(tick, len(times) - 1)]:.1f}' for tick in (one.begin, one.end)),
                *(one.constraint, decisions.modes[one.begin], phase),
                *(f'{value:.3g}' for value in (*min_margins, decisions.changed_n[part].max())),
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


def _assurance_picture(
    flight: Flight, decisions: Decided, acted: list[Intervention], phases: list[Phase]
) -> Any:
    count = 3 if acted else 2
    figure, panels = style.new_panels(2.0 * count, count, sharex=True)
    times = flight.scenario.times_s
    shown = (
        (decisions.margins[:, 0], 'margin [m]'),
        (decisions.margins[:, 1], 'margin [m/s]'),
        (decisions.changed_n, 'change [N]'),
    )
    for axes, (values, label) in zip(panels, shown, strict=False):
        by_axis(axes, times, values, label, 1.0)
        axes.axhline(0.0, **style.LIMIT)
        for name in dict.fromkeys(one.constraint for one in acted):
            acting = np.array([constraint == name for constraint in decisions.constraints])
            acting[1:] |= acting[:-1]  # a force acts to the end of its tick
            axes.fill_between(
                times, 0.0, 1.0, where=acting, transform=axes.get_xaxis_transform(), alpha=0.35,
                color=style.LIGHT[_COLOURS.get(name, 'muted')], linewidth=0.0,
                label=f'acts: {name}',
            )  # fmt: skip
    panels[-1].set_xlabel('time [s]')
    if acted:
        panels[-1].set_ylim(0.0, max(_LEAST_CHANGE_N, 1.05 * float(decisions.changed_n.max())))
        style.legend_below(figure, panels[0])
    changes = [Phase(c.state, c.reason, c.tick, c.tick) for c in decisions.changes]
    stages.mark(figure, sorted([*phases, *changes], key=lambda phase: phase.begin), flight)
    return figure


NEES_95 = (1.237, 14.449)
"""Chi-square quantiles of 2.5 % and 97.5 % of 6 degrees of freedom."""


class Filtered(NamedTuple):
    """What the filter of a run did.

    errors, sigmas : (n, 6) estimated less true, and the filter's own sigma [m, m/s]
    nees : (n,) of the six states
    estimates : (n, 9) position, and the Cholesky factor of its covariance, as `Replayed` has it
    innovations : (m, 2) tick and innovation over sigma, of every number measured
    nis : (k, 2) how many numbers a measurement has, and its NIS
    rejected, restarts : counts
    """

    errors: Floats
    sigmas: Floats
    nees: Floats
    estimates: Floats
    innovations: Floats
    nis: Floats
    rejected: int
    restarts: int


def filtered(log: RunLog, flight: Flight) -> Filtered | None:
    """Return what the filter of a run did; None if there is none, or a message is missing."""
    n, stage = len(flight.states), None
    errors, sigmas, nees = np.empty((n, 6)), np.empty((n, 6)), np.empty(n)
    estimates, corner = np.empty((n, 9)), np.tril_indices(3)
    innovations, nis = [], []
    for tick, stage, (state, *_) in steps_again(log, flight, EstimatorStage):
        covariance = stage.covariance[:6, :6]
        errors[tick] = np.array(state) - flight.states[tick]
        sigmas[tick] = np.sqrt(np.diag(covariance))
        nees[tick] = errors[tick] @ np.linalg.solve(covariance, errors[tick])
        factor = np.linalg.cholesky(covariance[:3, :3])
        estimates[tick] = [*state[:3], *factor[corner]]
        for numbers in filter(None, stage.innovations):
            innovations += [(tick, value) for value in numbers]
            nis.append((len(numbers), float(np.square(numbers).sum())))
    if stage is None:
        return None
    scaled, sums = np.array(innovations).reshape(-1, 2), np.array(nis).reshape(-1, 2)
    return Filtered(errors, sigmas, nees, estimates, scaled, sums, stage.rejected, stage.restarts)


def navigation_sections(flight: Flight, estimates: Filtered | None) -> list[Section]:
    """Return the section of a report; none if the run has no estimator."""
    if estimates is None:
        return []
    low, high = NEES_95
    inside = 100.0 * ((low <= estimates.nees) & (estimates.nees <= high)).mean()
    rows = [
        ('NEES of six states, mean; 6 is right', f'{estimates.nees.mean():.2f}'),
        (f'ticks with NEES in [{low}, {high}]; 95 % is right', f'{inside:.1f} %'),
        ('measurements taken or rejected', f'{len(estimates.nis)}'),
        ('rejected', f'{estimates.rejected}'),
        ('restarts', f'{estimates.restarts}'),
    ]
    if len(estimates.nis):
        per_number = float(estimates.nis[:, 1].sum() / estimates.nis[:, 0].sum())
        rows.insert(2, ('NIS of a number, mean; 1 is right', f'{per_number:.3f}'))
    table = Table('The filter', ('quantity', 'value'), tuple(rows))
    figure = _navigation_picture(flight, estimates)
    shown = picture('navigation', figure, nees=estimates.nees.mean())
    return [Section('Navigation', (table, shown))]


def _navigation_picture(flight: Flight, estimates: Filtered) -> Any:
    times = flight.scenario.times_s[: len(estimates.errors)]
    figure, panels = style.new_panels(8.4, 4, 1, sharex=True)
    for axes, at, label in (
        (panels[0], 0, 'position error [m]'),
        (panels[1], 3, 'velocity error [m/s]'),
    ):
        by_axis(axes, times, estimates.errors[:, at : at + 3], label, 0.8)
        bound = 3.0 * estimates.sigmas[:, at : at + 3].max(axis=1)
        for sign in (-1.0, 1.0):
            name = '3 sigma, largest axis' if sign > 0 else None
            axes.plot(times, sign * bound, **style.LIMIT, label=name)
        shown = 1.5 * float(np.quantile(bound, 0.95))
        axes.set_ylim(-shown, shown)
    panels[2].plot(times, estimates.nees, color=style.AXES[0], linewidth=0.6)
    panels[2].set(ylabel='NEES', ylim=(0.0, 2.0 * NEES_95[1]))
    ticks, values = estimates.innovations.T
    panels[3].plot(times[ticks.astype(int)], values, '.', color=style.AXES[1], markersize=1.5)
    panels[3].set(ylabel='innovation / sigma', xlabel='time [s]', ylim=(-6.0, 6.0))
    for axes, bounds in ((panels[2], NEES_95), (panels[3], (-1.96, 1.96))):
        for value in bounds:
            axes.axhline(value, **style.LIMIT)
    style.legend_below(figure, panels[0])
    return figure


_AXES = ('x of the chaser', 'y of the chaser', 'z of the chaser')
_NEAR = 4.0
"""A limit is drawn close up where it is at most so many times the largest value there."""


def attitude_sections(flight: Flight) -> list[Section]:
    """Return the section of a report; none if the chaser has no attitude."""
    turns = turned_of(flight)
    if turns is None:
        return []
    panels = panels_of(turns, flight.scenario)
    last, rows = close_up_ticks(flight.scenario), []
    for panel in panels:
        sizes = np.abs(panel.values)
        limit = '–' if panel.limit is None else f'≤ {number(panel.limit, panel.unit)}'
        values = (number(float(x), panel.unit) for x in (sizes.max(), sizes[-last:].max()))
        rows.append((panel.name, *values, limit))
    last_s = last * flight.scenario.dt_s
    columns = ('quantity', 'largest', f'in the last {last_s:g} s', 'limit')
    last_deg = turns.off_reference_deg[-1]
    shown = picture('attitude', _attitude_picture(flight, panels), last_deg=last_deg)
    return [Section('Attitude', (Table('How the chaser turned', columns, tuple(rows)), shown))]


def _attitude_picture(flight: Flight, panels: list[Panel]) -> Any:
    scenario, last = flight.scenario, close_up_ticks(flight.scenario)
    count, times = len(panels), scenario.times_s
    figure, grid = style.new_panels(
        0.6 + 1.5 * count, count, 2, sharex='col', squeeze=False, width_ratios=(3, 2)
    )
    for axes_of, panel in zip(grid, panels, strict=True):
        peak = np.abs(panel.values[-last:]).max()
        label = f'{panel.label}\n[{panel.unit}]'
        for axes, part, text in zip(
            axes_of, (slice(None), slice(-last, None)), (label, ''), strict=True
        ):
            by_axis(axes, times[part], panel.values[part], text, 1.0, _AXES)
            if panel.limit is not None and (text or panel.limit <= _NEAR * peak):
                for sign in (-1.0, 1.0)[2 - panel.values.ndim :]:  # of a size, the upper one
                    axes.axhline(sign * panel.limit, **style.LIMIT, label='limit')
    grid[0][0].set_title('from the start')
    grid[0][1].set_title(f'last {last * scenario.dt_s:g} s')
    for axes in grid[-1]:
        axes.set_xlabel('time [s]')
    style.legend_below(figure, grid[0][0], grid[-1][0])
    return figure
