# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a campaign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_log.show import style
from rpo_montecarlo.campaign.statistics import Rate
from rpo_report.sensitivity import Influence

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

MOST_POINTS = 2000
"""Runs of each kind, successes and failures, that a cloud shows."""

_BINS = 60
_FAR = 2.5
_SMALL_M_S = 0.1
_KEPT, _FAILED = style.LIGHT['x'], style.LIGHT['y']


def clouds(final: Floats, success: Bools, limits: tuple[float | None, float | None]) -> Any:
    """Return the final positions and velocities of runs (n, 6) in two planes each.

    limits : of position [m] and velocity [m/s] of an axis, drawn as a box; not if None, nor if it
        lies so far out that the cloud would be a dot
    """
    figure, panels = style.new_panels(7.6, 2, 2)
    small = np.abs(final[:, 3:]).max() < _SMALL_M_S
    units = (('m', 1.0), ('mm/s', 1e3) if small else ('m/s', 1.0))
    for row, first, (unit, factor), limit in zip(panels, (0, 3), units, limits, strict=True):
        prefix = 'v' if first else ''
        for axes, up in zip(row, (0, 2), strict=True):
            _cloud(axes, factor * final[:, [first + 1, first + up]], success)
            if limit is not None and limit <= _FAR * np.abs(final[:, first : first + 3]).max():
                box = factor * limit * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
                axes.plot(*box.T, **style.LIMIT, label='limit of success')
            axes.set(
                xlabel=f'final {prefix}y, V-bar [{unit}]',
                ylabel=f'final {prefix}{"xyz"[up]}, {"RVH"[up]}-bar [{unit}]',
            )
            axes.set_aspect('equal', adjustable='datalim')
            axes.locator_params(nbins=7)
    style.legend_below(figure, panels[0][0])
    return figure


def _cloud(axes: Any, points: Floats, success: Bools) -> None:
    for chosen, colour, name in ((success, _KEPT, 'success'), (~success, _FAILED, 'failure')):
        some = points[chosen][:MOST_POINTS]
        if len(some):
            axes.add_patch(_dots(some, colour))
            axes.update_datalim(some)
        label = f'{name}: {int(chosen.sum())} runs, {len(some)} drawn'
        axes.plot([], [], 'o', color=colour, markersize=4, label=label)
    axes.autoscale_view()


def _dots(points: Floats, colour: str) -> Any:
    """Return one path of round dots: a third of the bytes of as many markers."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    ends = points + 1e-9 * np.ptp(points)
    vertices = np.stack([points, ends], axis=1).reshape(-1, 2)
    path = Path(vertices, np.tile([Path.MOVETO, Path.LINETO], len(points)))
    path.should_simplify = False
    return PathPatch(path, edgecolor=colour, facecolor='none', linewidth=2.2, capstyle='round')


def distributions(columns: Mapping[str, Floats], success: Bools) -> Any:
    """Return histograms of metrics; columns : label with unit -> values (n,).

    Runs whose value is infinite, what they never did, are not drawn.
    """
    rows = -(-len(columns) // 2)
    figure, panels = style.new_panels(2.3 * rows, rows, 2, squeeze=False)
    for axes in panels.ravel()[len(columns) :]:
        axes.set_axis_off()
    for axes, (label, values) in zip(panels.flat, columns.items(), strict=False):
        known = np.isfinite(values)
        span = _span(values[known]) if known.any() else (0.0, 1.0)
        axes.hist(
            [values[success & known], values[~success & known]],
            bins=_BINS,
            range=span,
            stacked=True,
            color=[_KEPT, _FAILED],
            label=['success', 'failure'],
        )
        if known.any():
            axes.axvline(np.median(values[known]), **style.LIMIT, label='median')
        axes.set(xlabel=label, ylabel='number of runs', xlim=span)
        axes.grid(axis='x', visible=False)
    style.legend_below(figure, panels[0][0])
    return figure


def _span(values: Floats) -> tuple[float, float]:
    low, high = float(values.min()), float(np.quantile(values, 0.9995))
    return (low, high) if high > low else (low - 0.5, low + 0.5)


def sensitivity(found: Mapping[str, Sequence[Influence]], level: float) -> Any:
    """Return the influences of each column on each outcome, as bars; weak ones within `level`."""
    columns = [i.column for i in next(iter(found.values()))]
    height = 0.5 + 0.27 * len(columns)
    figure, (panels,) = style.new_panels(height, 1, len(found), sharey=True, squeeze=False)
    places = np.arange(len(columns))
    for axes, (outcome, influences) in zip(panels, found.items(), strict=True):
        by_name = {i.column: i for i in influences}
        signed = [by_name[name].signed for name in columns]
        size = [by_name[name].size for name in columns]
        axes.axvspan(-level, level, color=style.LIGHT['grid'], linewidth=0, label='chance')
        axes.hlines(places, 0.0, signed, color=_KEPT, linewidth=1.2)
        axes.plot(signed, places, 'o', color=_KEPT, markersize=5, label='of the deviation')
        hollow = {'markerfacecolor': 'none', 'markeredgecolor': _FAILED, 'markersize': 5}
        axes.plot(size, places, 'D', **hollow, label='of its size')
        axes.set(title=outcome, xlabel='rank correlation', xlim=(-1.0, 1.0))
        axes.set_xticks([-0.5, 0.0, 0.5])
        axes.axvline(0.0, color=style.LIGHT['muted'], linewidth=0.8)
    panels[0].set_yticks(places, columns)
    panels[0].invert_yaxis()
    style.legend_below(figure, panels[0])
    return figure


def rates(found: Sequence[Rate]) -> Any:
    """Return success rates with their intervals."""
    shares = np.array([rate.kept / rate.runs for rate in found])
    below = shares - [rate.low for rate in found]
    above = [rate.high for rate in found] - shares
    figure, axes = style.new_panels(0.9 + 0.36 * len(found))
    places = np.arange(len(found))
    axes.errorbar(
        100.0 * shares,
        places,
        xerr=100.0 * np.array([below, above]),
        fmt='o',
        color=_KEPT,
        capsize=4,
        markersize=5,
        label='share of runs, Wilson 95 %',
    )
    axes.set_yticks(places, [rate.name for rate in found])
    axes.set(xlabel='runs that keep it [%]', ylim=(len(found) - 0.5, -0.5))
    style.legend_below(figure, axes)
    return figure
