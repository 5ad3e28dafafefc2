# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a training run: how it converged, and the controller that it found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rpo_core.control.controller import FuzzyController
from rpo_judge.evaluation.comparison import ComparedController, Share
from rpo_judge.evaluation.sensitivity import effects
from rpo_log.show import style
from rpo_montecarlo.campaign.judging import MOTION
from rpo_report.controller import (
    control_surface,
    draw_effects,
    membership_functions,
    rules,
)
from rpo_training.training import FINALISTS, FRONT, HISTORY

_ENERGIES = (2.5, 3, 3.5, 4, 5, 7, 10, 15, 20)
_SHARES = (0.01, 0.1, 1, 10, 100)


def best(rows: Sequence[ComparedController]) -> list[ComparedController]:
    """Return the controllers that no other beats in energy and in runs kept, by rising energy."""
    found: list[ComparedController] = []
    for row in sorted(rows, key=lambda row: (row.mean_energy_n2s, -_kept(row))):
        if row.met and all(_kept(row) > _kept(other) for other in found):
            found.append(row)
    return found


def draw(rows: Sequence[ComparedController], path: Path) -> None:
    """Write the picture; a controller that arrives from no start is left out.

    The share of missed runs is logarithmic, the better the higher; none missed is drawn at half a
    run.
    """
    shown = [row for row in rows if row.met]
    with style.applied():
        figure, axes = style.new_panels(4.6, 1, 1)
        for row in shown:
            x, y = row.mean_energy_n2s, _missed(row)
            share = _share(row)
            low, high = max(1.0 - share.high, 0.1 / row.runs), 1.0 - share.low
            fuzzy = row.kind in ('fuzzy', 'more_words', 'pace', 'time_to_go')
            colour = style.LIGHT['x'] if fuzzy else style.LIGHT['muted']
            axes.plot([x, x], [100 * low, 100 * high], color=colour, linewidth=1)
            axes.plot(x, 100 * y, 'o' if fuzzy else 's', color=colour, markersize=6)
            side = 'right' if _crowded(row, shown) else 'left'
            at = (-6, 4) if side == 'right' else (6, 4)
            axes.annotate(row.name, (x, 100 * y), at, textcoords='offset points', ha=side)
        front = best(shown)
        axes.step(
            [row.mean_energy_n2s for row in front],
            [100 * _missed(row) for row in front],
            where='post',
            color=style.LIGHT['ink'],
            linewidth=0.8,
            linestyle=':',
        )
        axes.set(
            xscale='log',
            yscale='log',
            xlabel='mean J of the training starts [N²s]',
            ylabel=f'dispersed runs that miss {_judged(rows)} [%], the fewer the higher',
            title=f'Energy against {_judged(rows)} kept: fuzzy controllers ●, baselines ■',
        )
        axes.invert_yaxis()
        energies = [row.mean_energy_n2s for row in shown] or [1.0]
        axes.set_xlim(0.8 * min(energies), 1.5 * max(energies))
        for axis, ticks in ((axes.xaxis, _ENERGIES), (axes.yaxis, _SHARES)):
            low, high = sorted(axis.get_view_interval())
            inside = [tick for tick in ticks if low <= tick <= high]
            axis.set_ticks(inside, [f'{tick:g}' for tick in inside])
            axis.set_ticks([], minor=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)


def _crowded(row: ComparedController, shown: Sequence[ComparedController]) -> bool:
    """Return whether the name of a point would hide its neighbour on the right."""
    x, y = row.mean_energy_n2s, _missed(row)
    return any(
        1.0 < other.mean_energy_n2s / x < 1.25 and 0.5 < _missed(other) / y < 2.0 for other in shown
    )


def _share(row: ComparedController) -> Share:
    return row.moving or Share(row.kept, row.low, row.high)


def _judged(rows: Sequence[ComparedController]) -> str:
    return MOTION if any(row.moving for row in rows) else 'all limits'


def _kept(row: ComparedController) -> float:
    return _share(row).kept / row.runs


def _missed(row: ComparedController) -> float:
    return max(1.0 - _kept(row), 0.5 / row.runs)


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
            drawings['sensitivity.png'] = draw_effects(*effects(controller))
        for name, figure in drawings.items():
            figure.savefig(folder / name)
    return [folder / name for name in drawings]


def _columns(path: Path) -> Any:
    """Return the columns of a table with headings, by name."""
    return np.genfromtxt(path, delimiter=',', names=True, encoding='utf-8', ndmin=1)


def _convergence(history: Path) -> Any:
    columns = _columns(history)
    figure, axes = style.new_panels(4.4)
    for (name, label), colour in zip(
        (
            ('mean_fitness', 'fitness, mean of the generation'),
            ('best_fitness', 'fitness, best so far'),
            ('best_energy_n2s', "the best's mean J"),
        ),
        style.AXES,
        strict=True,
    ):
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
