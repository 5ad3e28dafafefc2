# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The attitude of a run: how the chaser turned, beside its limits."""

from __future__ import annotations

from typing import Any

import numpy as np

from rpo.reports.page import Section, Table, picture
from rpo.reports.turned import Panel, panels_of, turned_of
from rpo_core.chain.flight import Flight
from rpo_core.judge import metrics
from rpo_log.show import style
from rpo_log.show.report import by_axis, close_up_s
from rpo_log.show.report import shown as number

_AXES = ('x of the chaser', 'y of the chaser', 'z of the chaser')
_NEAR = 4.0
"""A limit is drawn close up where it is at most so many times the largest value there."""


def sections(flight: Flight) -> list[Section]:
    """Return the section of a report; none if the chaser has no attitude."""
    found = turned_of(flight)
    if found is None:
        return []
    panels = panels_of(found, flight.scenario)
    last, rows = _close_ticks(flight), []
    for panel in panels:
        sizes = np.abs(panel.values)
        limit = '–' if panel.limit is None else f'≤ {number(panel.limit, panel.unit)}'
        values = (number(float(x), panel.unit) for x in (sizes.max(), sizes[-last:].max()))
        rows.append((panel.name, *values, limit))
    last_s = last * flight.scenario.dt_s
    columns = ('quantity', 'largest', f'in the last {last_s:g} s', 'limit')
    last_deg = found.off_reference_deg[-1]
    shown = picture('attitude', _picture(flight, panels), last_deg=last_deg)
    return [Section('Attitude', (Table('How the chaser turned', columns, tuple(rows)), shown))]


def _close_ticks(flight: Flight) -> int:
    scenario = flight.scenario
    return metrics.window_ticks(scenario, scenario.duration_s - close_up_s(scenario))


def _picture(flight: Flight, panels: list[Panel]) -> Any:
    scenario, last = flight.scenario, _close_ticks(flight)
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
            if panel.values.ndim == 2:
                by_axis(axes, times[part], panel.values[part], text, 1.0, _AXES)
            else:
                axes.plot(times[part], panel.values[part], color=style.LIGHT['ink'], linewidth=1.0)
                axes.set_ylabel(text)
                axes.margins(x=0.01)
            if panel.limit is not None and (text or panel.limit <= _NEAR * peak):
                for sign in (-1.0, 1.0)[2 - panel.values.ndim :]:  # of a size, the upper one
                    axes.axhline(sign * panel.limit, **style.LIMIT, label='limit')
    grid[0][0].set_title('from the start')
    grid[0][1].set_title(f'last {last * scenario.dt_s:g} s')
    for axes in grid[-1]:
        axes.set_xlabel('time [s]')
    style.legend_below(figure, grid[0][0], grid[-1][0])
    return figure
