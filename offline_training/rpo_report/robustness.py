# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A picture of the margins of a controller: every point that was checked, and the crossings."""

from __future__ import annotations

import textwrap
from typing import Any

from rpo_judge.evaluation.robustness import QUANTITIES, Margin, Margins, Quantity
from rpo_log.show import style

_LETTERS = 40
"""Of a line below a panel."""

_TOP, _SEEN = 1.3, 1.6
"""Largest share of a limit that is shown, and how far beyond the bound, in its distance."""


def draw(found: Margins, name: str) -> Any:
    """Return the picture: a panel for each quantity, and one of the describing function."""
    known = {margin.name: margin for margin in found.margins}
    figure, grid = style.new_panels(8.0, 3, 3)
    *panels, last = grid.flat
    for axes, quantity in zip(panels, QUANTITIES, strict=True):
        axes.set_title(f'{quantity.name}: no margin')
        if quantity.name in known:
            _draw_margin(axes, quantity, known[quantity.name])
    for row in grid:
        row[0].set_ylabel('largest value / its limit')
    _draw_crossings(last, found)
    shown = '● all holds   ✕ a limit is missed   ▲ beyond the scale'
    figure.suptitle(f'{name}: how far the loop may be off   {shown}', fontsize=11.0)
    return figure


def _draw_margin(axes: Any, quantity: Quantity, margin: Margin) -> None:
    fails, start = margin.fails, quantity.nominal
    reach = abs((fails.at if fails else margin.holds) - start) * _SEEN
    points = [point for point in margin.points if abs(point.at - start) <= reach]
    x = [point.at / quantity.factor for point in points]
    y = [min(point.share, _TOP) for point in points]
    axes.plot(x, y, color=style.LIGHT['muted'], linewidth=0.8)
    for at, height, point in zip(x, y, points, strict=True):
        marker = '^' if point.share > _TOP else 'o' if point.holds else 'x'
        colour = style.LIGHT['x'] if point.holds else style.LIGHT['y']
        axes.plot(at, height, marker, color=colour, markersize=4, clip_on=False)
    axes.axhline(1.0, **style.LIMIT)
    note = '' if fails is None else f'{fails.limit} at {quantity.shown(fails.at)}'
    if margin.again is not None:
        note += f'; holds again at {quantity.shown(margin.again)}'
    axes.set(
        title=f'{quantity.name}: {quantity.shown(margin.holds)}',
        xlabel=textwrap.fill(note, _LETTERS),
    )
    axes.xaxis.label.set_size(9.0)
    axes.margins(y=0.1)
    axes.locator_params(axis='x', nbins=5)


def _draw_crossings(axes: Any, found: Margins) -> None:
    title = 'phase margin and delay [ticks]'
    axes.set(title=title, xlabel='error [m]', ylabel='crossing [rad/s]')
    if not found.crossings:
        return
    style.log_scale(axes, x=True)
    x, y = zip(*((c.amplitude_m, c.rate_rad_s) for c in found.crossings), strict=True)
    axes.plot(x, y, 'o-', markersize=4)
    axes.set(xlim=(min(x) / 4.0, 40.0 * max(x)), ylim=(min(y) / 1.5, 2.0 * max(y)))
    names = [f'{c.phase_margin_deg:.0f}°, {c.delay_margin_ticks:.0f}' for c in found.crossings]
    style.label_points(axes, list(zip(x, y, names, strict=True)))
