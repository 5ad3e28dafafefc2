# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a training run, and of a comparison: energy against dispersed runs and time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rpo.analysis.comparison import Row
from rpo.montecarlo.judging import MOTION
from rpo.training.run import HISTORY
from rpo.training.training import FINALISTS, FRONT
from rpo_log.show import style


def draw_run(folder: Path) -> list[Path]:
    """Draw the pictures of a finished run into its folder; return their paths."""
    with style.applied():
        drawings = {
            'convergence.png': _convergence(folder / HISTORY),
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
    figure, axes = style.new_panels(4.4)
    convergence(axes, _columns(history))
    style.legend_below(figure, axes)
    return figure


def convergence(axes: Any, columns: Any) -> None:
    """Draw how a training converged; columns : those of its history, by name."""
    labels = 'fitness, mean of the generation', 'fitness, best so far', "the best's mean J"
    names = 'mean_fitness', 'best_fitness', 'best_energy_n2s'
    for name, label, colour in zip(names, labels, style.AXES, strict=True):
        axes.plot(columns['evaluations'], columns[name], color=colour, label=label)
    style.log_scale(axes)
    axes.set(xlabel='controllers evaluated', ylabel='fitness, J [N²s]')


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


_FUZZY = ('fuzzy', 'more_words', 'time_to_go')


def draw_comparison(rows: Sequence[Row]) -> Any:
    """Return the picture; a controller that arrives from no training start is left out.

    Shares are on a logistic scale, with their intervals; none and all are drawn at half a run.
    """
    figure, (kept, time) = style.new_panels(7.0, 2, 1, sharex=True)
    shown = [row for row in rows if row['met'] and row['moving']]
    for i, row in enumerate(sorted(shown, key=lambda row: row['mean_energy_n2s']), 1):
        moving, energy, half_a_run = row['moving'], row['mean_energy_n2s'], 0.5 / row['runs']
        fuzzy = row['kind'] in _FUZZY
        colour = style.LIGHT['x' if fuzzy else 'muted']
        mark = {'marker': 'o' if fuzzy else 's', 'color': colour, 'markersize': 13}
        shares = (moving['low'], moving['kept'] / row['runs'], moving['high'])
        low, middle, high = (min(max(share, half_a_run), 1.0 - half_a_run) for share in shares)
        kept.errorbar(energy, middle, [[max(middle - low, 0.0)], [max(high - middle, 0.0)]], **mark)
        time.plot(energy, row['settled_s'], linestyle='', label=f'{i} {row["name"]}', **mark)
        for axes, y in ((kept, middle), (time, row['settled_s'])):
            axes.text(energy, y, i, color=style.LIGHT['paper'], ha='center', va='center', size=9)
    kept.set_yscale('logit')
    kept.set(title='fuzzy controllers ●, baselines ■', ylabel=f'dispersed runs, {MOTION} kept')
    kept.yaxis.set_major_formatter(lambda share, _: f'{100.0 * share:.4g} %')
    kept.yaxis.set_minor_formatter('')
    time.set(
        xlabel='mean J of the training starts [N²s]', ylabel='mean time to stay within 0.5 m [s]'
    )
    style.log_scale(time, x=True, y=False)
    for axes in (kept, time):
        axes.margins(y=0.15)
    style.legend_below(figure, time, columns=5)
    return figure
