# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A picture of the margins of a controller: every point that was checked, and the crossings."""

from __future__ import annotations

from textwrap import fill
from typing import Any

from rpo_judge.evaluation.robustness import QUANTITIES, Crossing, Margin, Margins
from rpo_log.show import style

_LETTERS = 40
"""Of a line below a panel."""

_TOP, _REACH = 1.3, 1.6
"""Largest share of a limit that is shown, and how far beyond the bound, in its distance."""


def draw(margins: Margins, name: str) -> Any:
    """Return the picture: a panel for each quantity, and one of the describing function."""
    figure, grid = style.new_panels(8.0, 3, 3)
    for axes, quantity in zip(grid.flat, QUANTITIES, strict=False):
        axes.set_title(f'{quantity.name}: no margin')
    for axes, margin in zip(grid.flat, margins.margins, strict=False):
        _draw_margin(axes, margin)
    for row in grid:
        row[0].set_ylabel('largest value / its limit')
    _draw_crossings(grid[-1, -1], margins.crossings)
    shown = '● all holds   ✕ a limit is missed   ▲ beyond the scale'
    figure.suptitle(f'{name}: how far the loop may be off   {shown}', fontsize=11.0)
    return figure


def _draw_margin(axes: Any, margin: Margin) -> None:
    quantity, checked, holds, fails, limit, again = margin
    reach = _REACH * abs((holds if fails is None else fails) - quantity.nominal)
    points = [point for point in checked if abs(point.at - quantity.nominal) <= reach]
    x = [point.at / quantity.factor for point in points]
    y = [min(point.share, _TOP) for point in points]
    axes.plot(x, y, color=style.LIGHT['muted'], linewidth=0.8)
    for at, height, point in zip(x, y, points, strict=True):
        marker = '^' if point.share > _TOP else 'o' if point.holds else 'x'
        colour = style.LIGHT['x'] if point.holds else style.LIGHT['y']
        axes.plot(at, height, marker, color=colour, markersize=4, clip_on=False)
    axes.axhline(1.0, **style.LIMIT)
    note = '' if fails is None else f'{limit} at {quantity.shown(fails)}'
    note += '' if again is None else f'; holds again at {quantity.shown(again)}'
    axes.set_title(f'{quantity.name}: {quantity.shown(holds)}')
    axes.set_xlabel(fill(note, _LETTERS), size=9.0)
    axes.margins(y=0.1)
    axes.locator_params(axis='x', nbins=5)


def _draw_crossings(axes: Any, crossings: tuple[Crossing, ...]) -> None:
    title = 'phase margin and delay [ticks]'
    axes.set(title=title, xlabel='error [m]', ylabel='crossing [rad/s]')
    if not crossings:
        return
    style.log_scale(axes, x=True)
    x, y = zip(*((c.amplitude_m, c.rate_rad_s) for c in crossings), strict=True)
    axes.plot(x, y, 'o-', markersize=4)
    axes.set(xlim=(min(x) / 4.0, 40.0 * max(x)), ylim=(min(y) / 1.5, 2.0 * max(y)))
    names = [f'{c.phase_margin_deg:.0f}°, {c.delay_margin_ticks:.0f}' for c in crossings]
    style.label_points(axes, list(zip(x, y, names, strict=True)))
