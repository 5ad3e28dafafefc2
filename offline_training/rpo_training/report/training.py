# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a training run: how it converged, and the controller that it found."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.controller import FuzzyController
from rpo_log.show import style
from rpo_training.report import controller_plots
from rpo_training.search.training import FRONT, HISTORY

Floats = NDArray[np.float64]

_DRAWN = (
    *('evaluations', 'mean_fitness', 'best_fitness', 'best_energy_n2s'),
    *('mean_arrival_s', 'mean_energy_n2s'),
)


def draw_run(folder: Path, controller: FuzzyController) -> list[Path]:
    """Draw the pictures of a finished run into its folder; return their paths."""
    with style.applied():
        drawings = {
            'convergence.png': _convergence(folder / HISTORY),
            'membership_functions.png': controller_plots.membership_functions(controller),
            'rules.png': controller_plots.rules(controller),
            'surface.png': controller_plots.control_surface(controller),
        }
        if (folder / FRONT).exists():
            drawings['front.png'] = _front(folder / FRONT)
        for name, figure in drawings.items():
            figure.savefig(folder / name)
    return [folder / name for name in drawings]


def _columns(path: Path) -> dict[str, Floats]:
    """Return the columns of numbers of a table with headings."""
    with path.open(newline='') as file:
        rows = list(csv.DictReader(file))
    return {
        name: np.array([row[name] for row in rows], dtype=np.float64)
        for name in (rows[0] if rows else ())
        if name in _DRAWN
    }


def _convergence(history: Path) -> Any:
    columns = _columns(history)
    figure = style.new_figure(4.4)
    axes = figure.subplots()
    for (name, label), colour in zip(
        (
            ('mean_fitness', 'fitness, mean of the generation'),
            ('best_fitness', 'fitness, best so far'),
            ('best_energy_n2s', "the best's mean J"),
        ),
        style.AXES,
        strict=True,
    ):
        axes.semilogy(columns['evaluations'], columns[name], color=colour, label=label)
    axes.set(xlabel='controllers flown [1]', ylabel='fitness, J [N²s]')
    style.legend_below(figure, axes)
    return figure


def _front(path: Path) -> Any:
    columns = _columns(path)
    figure = style.new_figure(4.4)
    axes = figure.subplots()
    if columns:
        axes.plot(columns['mean_arrival_s'], columns['mean_energy_n2s'], 'o-', markersize=4)
    axes.set(xlabel='mean arrival time, free of penalties [s]', ylabel='mean J [N²s]')
    return figure
