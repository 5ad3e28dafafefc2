# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a training run: how it converged, and the controller that it found."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rpo_core.controller import FuzzyController
from rpo_log.show import style
from rpo_training.report import controller_plots
from rpo_training.search.training import FRONT, HISTORY


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
        axes.semilogy(columns['evaluations'], columns[name], color=colour, label=label)
    axes.set(xlabel='controllers evaluated', ylabel='fitness, J [N²s]')
    style.legend_below(figure, axes)
    return figure


def _front(path: Path) -> Any:
    columns = _columns(path)
    figure, axes = style.new_panels(4.4)
    if columns.size:
        axes.plot(columns['mean_arrival_s'], columns['mean_energy_n2s'], 'o-', markersize=4)
    axes.set(xlabel='mean arrival time, free of penalties [s]', ylabel='mean J [N²s]')
    return figure
