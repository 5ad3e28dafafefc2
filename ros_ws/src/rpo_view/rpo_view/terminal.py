# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A live run on a terminal, drawn by rich; no ROS."""

from __future__ import annotations

import math

from rich.console import Group
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from rpo_view.live import LiveRun
from rpo_view.onboard import Acting

AXES = (('x', 'R-bar', 'bright_blue'), ('y', 'V-bar', 'dark_orange'), ('z', 'H-bar', 'green'))
BAR_WIDTH = 21
"""So that a terminal of 80 columns shows all of it."""

_HALF = BAR_WIDTH // 2


def bar(share: float, colour: str) -> Text:
    """Return a bar from the middle, for a share of the limit in [-1, 1]."""
    share = max(-1.0, min(1.0, share))
    filled = round(abs(share) * _HALF)
    left = '█' * filled if share < 0.0 else ''
    right = '█' * filled if share > 0.0 else ''
    text = Text(f'{left:>{_HALF}}'.replace(' ', '·'), style=colour)
    return text + Text('│') + Text(f'{right:<{_HALF}}'.replace(' ', '·'), style=colour)


def fixed(value: float, digits: int, sign: str = '') -> str:
    """Return a number with so many digits; zero has no sign."""
    return f'{round(value, digits) + 0.0:{sign}.{digits}f}'


def line(run: LiveRun, topic: str) -> str:
    """Return the run in one line, for an output that is no terminal."""
    if run.position_m is None or run.velocity_m_s is None:
        return run.sentence(topic)
    forces = ' '.join(fixed(force, 4, '+') for force in run.command_n or ())
    return (
        f'{run.time_s:8.1f} s  range {run.range_m:9.3f} m  '
        f'rate {fixed(run.range_rate_m_s, 4):>7} m/s  '
        f'speed {math.hypot(*run.velocity_m_s):7.4f} m/s  force {forces or "none"} N  '
        f'{_said(run)}{run.sentence(topic)}'
    )


def _said(run: LiveRun) -> str:
    """Return the phase of the plan and the constraint that acts, for a line; '' without."""
    phase, acting = run.onboard.phase(run.tick), run.onboard.acting(run.tick)
    found = f'phase {phase.phase}  ' if phase is not None else ''
    if acting is not None and acting.constraint:
        found += f'assurance acts: {acting.constraint}  '
    turns = run.onboard.turns()
    return f'{found}attitude {turns}  ' if turns else found


def view(run: LiveRun, topic: str) -> Panel:
    """Return the whole view."""
    parts = [Text(run.sentence(topic), style='red' if _bad(run) else '')]
    onboard = _onboard(run)
    if run.position_m is not None:
        parts += [_progress(run), *onboard, Text(), _axes(run)]
    if run.decisions:
        parts += [Text(), _decisions(run)]
    named = [name for name in (run.scenario.name if run.scenario else '', run.controller) if name]
    title = Text(' · '.join(['final approach', *named]))  # not markup: names may hold brackets
    return Panel(Group(*parts), title=title, title_align='left')


def _bad(run: LiveRun) -> bool:
    return run.phase == 'aborted' or run.position_m is None or run.silent_s is not None


def _progress(run: LiveRun) -> Table:
    """Return time, range, rates, effort and progress of the run."""
    grid = Table.grid(padding=(0, 3))
    whole = f' of {run.scenario.duration_s:g}' if run.scenario else ''
    goal = ' from the goal' if run.scenario is not None and run.scenario.goal is not None else ''
    speed_mm_s = 1000.0 * math.hypot(*(run.velocity_m_s or ()))
    grid.add_row(
        f'time {run.time_s:.1f}{whole} s',
        f'range{goal} [bold]{run.range_m:.3f}[/] m',
        f'speed [bold]{speed_mm_s:.1f}[/] mm/s',
    )
    used = ('–', '–')
    if run.delta_v_m_s is not None and run.duty is not None:
        used = (f'{run.delta_v_m_s:.2f} m/s', f'{100.0 * run.duty:.1f} %')
    inside_s = run.effort.inside_s
    grid.add_row(
        f'Δv about {used[0]}',
        f'range rate {fixed(1000.0 * run.range_rate_m_s, 1)} mm/s',
        f'duty about {used[1]}',
    )
    if run.pulses_n is not None or run.propellant_kg is not None:
        fired = ' '.join('+' if f > 0.0 else '−' if f < 0.0 else '·' for f in run.pulses_n or ())
        spent = '' if run.propellant_kg is None else f'{1e3 * run.propellant_kg:.1f} g'
        openings = run.onboard.openings
        opened = '' if openings is None else f'{openings} openings'
        grid.add_row(f'propellant about {spent or "–"}', f'valves x y z {fired or "–"}', opened)
    arrived = 'not within 0.5 m yet' if inside_s is None else f'within 0.5 m since {inside_s:.1f} s'
    share = ''
    if run.scenario:
        share = ProgressBar(total=run.scenario.duration_s, completed=run.time_s, width=24)
    grid.add_row(arrived, share)
    return grid


def _onboard(run: LiveRun) -> list[Text]:
    """Return what guidance, navigation and assurance say, a line each; none where there is none."""
    said, dt_s, found = run.onboard, run.scenario.dt_s if run.scenario else 0.0, []
    phase, acting = said.phase(run.tick), said.acting(run.tick)
    if phase is not None:
        away = '' if said.miss is None else f', {math.hypot(*said.miss[:3]):.3f} m from reference'
        since = f'{phase.phase} since {phase.tick * dt_s:.1f} s{away}'
        found.append(Text(f'guidance   {since}', style='bold'))
    if said.estimate is not None:
        off = '' if said.error is None else f'{math.hypot(*said.error[:3]):.3f} m off the truth'
        if said.sigmas_m is not None:
            sigmas = ' '.join(f'{sigma:.3f}' for sigma in said.sigmas_m)
            off += f'{", " if off else ""}sigma x y z {sigmas} m'
        found.append(Text(f'estimate   {off or "without a covariance"}'))
    if turns := said.turns():
        found.append(Text(f'attitude   {turns}'))
    if acting is not None:
        table = f', abort table {said.table}' if said.table else ''
        text = f'assurance  {_acting(acting, dt_s)}{table}'
        found.append(Text(text, _STYLES[bool(acting.constraint)]))
    return found


_STYLES = {True: 'bold red', False: ''}


def _acting(acting: Acting, dt_s: float) -> str:
    """Return what assurance does, in a line."""
    since = f' since {acting.tick * dt_s:.1f} s'
    what = f'acts: {acting.constraint}{since}' if acting.constraint else 'the command passes'
    margins = [
        f'{value:.{digits}f} {unit}'
        for value, digits, unit in ((acting.margin_m, 2, 'm'), (acting.margin_m_s, 3, 'm/s'))
        if value is not None
    ]
    return f'{what}, margin {", ".join(margins) or "unknown"}'


def _axes(run: LiveRun) -> Table:
    position, velocity = run.position_m or (), run.velocity_m_s or ()
    limit_n, forces = run.scenario.max_force_n if run.scenario else 1.0, run.command_n
    table = Table(box=None, padding=(0, 2, 0, 0), header_style='dim')
    table.add_column('axis')
    for title in ('position [m]', 'velocity [mm/s]', 'force [N]'):
        table.add_column(Text(title), justify='right')  # not markup: brackets hold units
    table.add_column(f'of ±{limit_n:g} N' if run.scenario else 'of ±1 N')
    for i, (axis, name, colour) in enumerate(AXES):
        force_n = forces[i] if forces else None
        table.add_row(
            Text(f'{axis} {name}', style=colour),
            fixed(position[i], 3),
            fixed(1000.0 * velocity[i], 1),
            'none' if force_n is None else fixed(force_n, 4),
            bar((force_n or 0.0) / limit_n, colour),
        )
    return table


def _decisions(run: LiveRun) -> Table:
    """Return why each axis has its force."""
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    for axis, _, colour in AXES:
        decision = run.decisions.get(axis)
        if decision is not None:
            table.add_row(Text(axis, style=colour), Text(decision.reasons.brief))
    return table
