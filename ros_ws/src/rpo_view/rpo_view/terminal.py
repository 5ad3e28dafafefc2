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

AXES = (('x', 'R-bar', 'bright_blue'), ('y', 'V-bar', 'dark_orange'), ('z', 'H-bar', 'green'))
BAR_WIDTH = 31
_HALF = BAR_WIDTH // 2
_RULES = 3


def bar(share: float, colour: str) -> Text:
    """Return a bar from the middle, for a share of the limit in [-1, 1]."""
    share = max(-1.0, min(1.0, share))
    filled = round(abs(share) * _HALF)
    left = '█' * filled if share < 0.0 else ''
    right = '█' * filled if share > 0.0 else ''
    text = Text(f'{left:>{_HALF}}'.replace(' ', '·'), style=colour)
    return text + Text('│') + Text(f'{right:<{_HALF}}'.replace(' ', '·'), style=colour)


def line(run: LiveRun, topic: str) -> str:
    """Return the run in one line, for an output that is no terminal."""
    if run.position_m is None or run.velocity_m_s is None:
        return run.sentence(topic)
    forces = ' '.join(f'{force:+.4f}' for force in run.force_n or ())
    return (
        f'{run.time_s:8.1f} s  range {math.hypot(*run.position_m):9.3f} m  '
        f'speed {math.hypot(*run.velocity_m_s):7.4f} m/s  force {forces or "none"} N  '
        f'{run.sentence(topic)}'
    )


def view(run: LiveRun, topic: str) -> Panel:
    """Return the whole view."""
    parts = [Text(run.sentence(topic), style='red' if _bad(run) else '')]
    if run.position_m is not None:
        parts += [_progress(run), Text(), _axes(run)]
    if run.decisions:
        parts += [Text(), _decisions(run)]
    named = [name for name in (run.scenario.name if run.scenario else '', run.controller) if name]
    title = Text(' · '.join(['final approach', *named]))  # not markup: names may hold brackets
    return Panel(Group(*parts), title=title, title_align='left')


def _bad(run: LiveRun) -> bool:
    return run.phase == 'aborted' or run.position_m is None or run.silent_s is not None


def _progress(run: LiveRun) -> Table:
    """Return time, range, speed and progress of the run."""
    position, velocity = run.position_m or (), run.velocity_m_s or ()
    grid = Table.grid(padding=(0, 3))
    whole = f' of {run.scenario.duration_s:g}' if run.scenario else ''
    grid.add_row(
        f'time {run.time_s:.1f}{whole} s',
        f'range [bold]{math.hypot(*position):.3f}[/] m',
        f'speed [bold]{1000.0 * math.hypot(*velocity):.1f}[/] mm/s',
        ProgressBar(total=run.scenario.duration_s, completed=run.time_s, width=24)
        if run.scenario
        else '',
    )
    return grid


def _axes(run: LiveRun) -> Table:
    position, velocity = run.position_m or (), run.velocity_m_s or ()
    limit_n = run.scenario.max_force_n if run.scenario else 1.0
    table = Table(box=None, padding=(0, 2, 0, 0), header_style='dim')
    table.add_column('axis')
    for title in ('position [m]', 'velocity [mm/s]', 'force [N]'):
        table.add_column(Text(title), justify='right')  # not markup: brackets hold units
    table.add_column(f'of ±{limit_n:g} N' if run.scenario else 'of ±1 N')
    for i, (axis, name, colour) in enumerate(AXES):
        force_n = run.force_n[i] if run.force_n else None
        table.add_row(
            Text(f'{axis} {name}', style=colour),
            f'{position[i]:.3f}',
            f'{1000.0 * velocity[i]:.1f}',
            'none' if force_n is None else f'{force_n:.4f}',
            bar((force_n or 0.0) / limit_n, colour),
        )
    return table


def _decisions(run: LiveRun) -> Table:
    """Return the sentence of each axis, and the next strongest rules."""
    table = Table(box=None, padding=(0, 2, 0, 0), show_header=False)
    for axis, _, colour in AXES:
        decision = run.decisions.get(axis)
        if decision is None:
            continue
        table.add_row(Text(axis, style=colour), Text(decision.sentence))
        others = decision.rules[1 : 1 + _RULES]
        texts = [f'{p}, {v} → {force} {strength:.2f}' for p, v, force, strength in others]
        if texts:
            table.add_row('', Text('also ' + '; '.join(texts), style='dim'))
    return table
