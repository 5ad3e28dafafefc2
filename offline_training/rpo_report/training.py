# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a training run: how it converged, and the controller that it found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import expit, logit

from rpo_core.control.controller import FuzzyController
from rpo_judge.evaluation.comparison import Row
from rpo_log.show import style
from rpo_montecarlo.campaign.judging import MOTION
from rpo_report.controller import control_surface, membership_functions, rules
from rpo_training.run import HISTORY
from rpo_training.training import FINALISTS, FRONT

_ENERGIES = (2.5, 3, 3.5, 4, 5, 7, 10, 15, 20)
_SHARES = (0.01, 0.1, 1, 10, 50, 90, 99, 99.9, 99.99)
_FUZZY = ('fuzzy', 'more_words', 'time_to_go')


def best(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points (energy, value) that no other beats in both, by rising energy.

    The larger a value, the better.
    """
    found: list[tuple[float, float]] = []
    for point in sorted(points, key=lambda point: (point[0], -point[1])):
        if all(point[1] > value for _, value in found):
            found.append(point)
    return found


def draw(rows: Sequence[Row]) -> Any:
    """Return the picture: energy against two shares of the dispersed runs, and against time.

    In every panel the better is higher, and further left. A controller that arrives from no start
    is left out. Shares are on a logistic scale; none and all are drawn at half a run.
    """
    shown = [row for row in rows if row['met']]
    figure, panels = style.new_panels(11.5, 3, 1, sharex=True)
    heights = [
        _draw_shares(panels[0], shown, MOTION, lambda row: row['moving']),
        _draw_shares(panels[1], shown, 'all limits', lambda row: row),
        [-row['settled_s'] for row in shown],
    ]
    panels[2].set(
        title='Energy against time',
        ylabel='mean time to stay within 0.5 m [s]',
        xlabel='mean J of the training starts [N²s]',
    )
    panels[2].yaxis.set_major_formatter(lambda value, _: f'{-value:g}')
    style.log_scale(panels[2], x=True, y=False)
    for axes, values in zip(panels, heights, strict=True):
        _draw_points(axes, shown, values)
    energies = [row['mean_energy_n2s'] for row in shown] or [1.0]
    panels[2].set_xlim(0.8 * min(energies), 1.3 * max(energies))
    _set_ticks(panels[2].xaxis, _ENERGIES)
    figure.suptitle('fuzzy controllers ●, baselines ■; dotted: no other is better in both')
    for axes, values in zip(panels, heights, strict=True):
        names = [
            (row['mean_energy_n2s'], y, row['name']) for row, y in zip(shown, values, strict=True)
        ]
        style.label_points(axes, names)
    return figure


def _draw_shares(
    axes: Any,
    rows: Sequence[Row],
    what: str,
    share: Callable[[Row], Row | None],
) -> list[float]:
    """Draw the intervals of shares [%], and return the shares; none of a controller is 0."""
    found = []
    for row in rows:
        own, least = share(row) or {'kept': 0, 'low': 0.0, 'high': 0.0}, 0.5 / row['runs']
        low, middle, high = (
            100.0 * min(max(part, least), 1.0 - least)
            for part in (own['low'], own['kept'] / row['runs'], own['high'])
        )
        axes.plot([row['mean_energy_n2s']] * 2, [low, high], color=_colour(row), linewidth=1)
        found.append(middle)
    scale = (
        lambda percent: logit(np.clip(np.asarray(percent) / 100.0, 1e-7, 1.0 - 1e-7)),
        lambda scaled: 100.0 * expit(scaled),
    )
    axes.set_yscale('function', functions=scale)
    axes.margins(y=0.15)
    axes.set(title=f'Energy against {what} kept', ylabel='dispersed runs [%]')
    _set_ticks(axes.yaxis, _SHARES)
    return found


def _draw_points(axes: Any, rows: Sequence[Row], values: Sequence[float]) -> None:
    """Draw points, the higher the better, and the line of those that no other beats."""
    for row, value in zip(rows, values, strict=True):
        marker = 'o' if row['kind'] in _FUZZY else 's'
        axes.plot(row['mean_energy_n2s'], value, marker, color=_colour(row), markersize=6)
    front = best([(row['mean_energy_n2s'], value) for row, value in zip(rows, values, strict=True)])
    x, y = np.repeat(np.reshape(front, (-1, 2)), 2, axis=0).T
    axes.plot(x[1:], y[:-1], ':', color=style.LIGHT['ink'], linewidth=0.8)


def _set_ticks(axis: Any, ticks: Sequence[float]) -> None:
    """Set those ticks that are in view."""
    low, high = sorted(axis.get_view_interval())
    inside = [tick for tick in ticks if low <= tick <= high]
    axis.set_ticks(inside, [f'{tick:g}' for tick in inside])
    axis.set_ticks([], minor=True)


def _colour(row: Row) -> str:
    return style.LIGHT['x' if row['kind'] in _FUZZY else 'muted']


def draw_run(folder: Path, controller: FuzzyController) -> list[Path]:
    """Draw the pictures of a finished run into its folder; return their paths."""
    with style.applied():
        drawings = {
            'convergence.png': _convergence(folder / HISTORY),
            'membership_functions.png': membership_functions(controller),
            'rules.png': rules(controller),
            'surface.png': control_surface(controller),
        }
        if (folder / FRONT).exists():
            drawings['front.png'] = _front(folder / FRONT)
        if (folder / FINALISTS).exists():
            drawings['held_out.png'] = _held_out(folder / FINALISTS)
        for name, figure in drawings.items():
            style.save_figure(figure, folder / name)
    return [folder / name for name in drawings]


def _columns(path: Path) -> Any:
    """Return the columns of a table with headings, by name."""
    return np.genfromtxt(path, delimiter=',', names=True, encoding='utf-8', ndmin=1)


def _convergence(history: Path) -> Any:
    columns = _columns(history)
    figure, axes = style.new_panels(4.4)
    labels = 'fitness, mean of the generation', 'fitness, best so far', "the best's mean J"
    names = 'mean_fitness', 'best_fitness', 'best_energy_n2s'
    for name, label, colour in zip(names, labels, style.AXES, strict=True):
        axes.plot(columns['evaluations'], columns[name], color=colour, label=label)
    style.log_scale(axes)
    axes.set(xlabel='controllers evaluated', ylabel='fitness, J [N²s]')
    style.legend_below(figure, axes)
    return figure


def _held_out(path: Path) -> Any:
    """Return the finalists: fitness by held-out draws, over fitness by those of the training."""
    columns = _columns(path)
    trained, held_out = columns['training_fitness'], columns['held_out_fitness']
    figure, axes = style.new_panels(4.4)
    best = int(held_out.argmin())
    ends = [min(trained.min(), held_out.min()), max(trained.max(), held_out.max())]
    axes.plot(ends, ends, color=style.LIGHT['muted'], linewidth=1.0, label='equal')
    axes.plot(trained, held_out, 'o', markersize=4, label='finalist')
    axes.plot(trained[best], held_out[best], 'D', markersize=6, label='chosen')
    style.log_scale(axes, x=True)
    axes.set(xlabel='fitness by the draws of its training [N²s]', ylabel='by held-out draws [N²s]')
    style.legend_below(figure, axes)
    return figure


def _front(path: Path) -> Any:
    columns = _columns(path)
    figure, axes = style.new_panels(4.4)
    if columns.size:
        axes.plot(columns['mean_arrival_s'], columns['mean_energy_n2s'], 'o-', markersize=4)
    axes.set(xlabel='mean arrival time, free of penalties [s]', ylabel='mean J [N²s]')
    return figure
