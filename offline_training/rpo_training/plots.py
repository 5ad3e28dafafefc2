# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a run and of a controller: convergence, membership functions, rules, surface."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use('Agg')

import matplotlib.pyplot as plt
import numpy as np

from rpo_core.controller import FuzzyController
from rpo_core.fuzzy import WORDS
from rpo_training import lanes
from rpo_training.genes import population_of
from rpo_training.training import FRONT, HISTORY

_COLOURS = ('#4c72b0', '#8fb3d9', '#8c8c8c', '#e8a87c', '#c44e52')
"""LN..LP."""


def draw_run(folder: Path, controller: FuzzyController) -> list[Path]:
    """Draw the pictures of a finished run into its folder; return their paths."""
    drawings = {
        'convergence.png': _convergence(folder / HISTORY),
        'membership_functions.png': draw_functions(controller),
        'rules.png': draw_rules(controller),
        'surface.png': draw_surface(controller),
    }
    if (folder / FRONT).exists():
        drawings['front.png'] = _front(folder / FRONT)
    for name, figure in drawings.items():
        figure.savefig(folder / name, dpi=120, bbox_inches='tight')
        plt.close(figure)
    return [folder / name for name in drawings]


def _columns(path: Path) -> dict[str, list[str]]:
    with path.open(newline='') as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]} if rows else {}


def _convergence(history: Path) -> Any:
    columns = _columns(history)
    evaluations = np.array(columns['evaluations'], dtype=float)
    figure, axes = plt.subplots(figsize=(7, 4))
    for name, label in (
        ('mean_fitness', 'mean of the generation'),
        ('best_fitness', 'best so far'),
        ('best_energy_n2s', "the best's mean J"),
    ):
        axes.semilogy(evaluations, np.array(columns[name], dtype=float), label=label)
    axes.set(xlabel='controllers flown', ylabel='fitness [N² s]', title='Convergence')
    axes.legend()
    axes.grid(alpha=0.3)
    return figure


def _front(path: Path) -> Any:
    columns = _columns(path)
    figure, axes = plt.subplots(figsize=(6, 4))
    if columns:
        axes.plot(
            np.array(columns['mean_arrival_s'], dtype=float),
            np.array(columns['mean_energy_n2s'], dtype=float),
            'o-',
            ms=3,
        )
    axes.set(
        xlabel='mean arrival time [s]',
        ylabel='mean J [N² s]',
        title='Energy against arrival time, penalty-free',
    )
    axes.grid(alpha=0.3)
    return figure


def draw_functions(controller: FuzzyController) -> Any:
    """Draw the membership functions of the three variables, in their units."""
    system = controller.system
    x = np.linspace(-1.0, 1.0, 2001)
    figure, all_axes = plt.subplots(3, 1, figsize=(7, 7), layout='constrained')
    for axes, name, unit, scale, functions in zip(
        all_axes,
        ('position error', 'velocity error', 'force'),
        ('m', 'm/s', 'N'),
        controller.scales,
        (system.position, system.velocity, system.force),
        strict=True,
    ):
        for grades, word, colour in zip(functions.grades(x).T, WORDS, _COLOURS, strict=True):
            axes.plot(scale * x, grades, label=word, color=colour)
        axes.set(xlabel=f'{name} [{unit}]', ylabel='grade', xlim=(-scale, scale))
    all_axes[0].legend(ncols=5, loc='upper center', bbox_to_anchor=(0.5, 1.25))
    return figure


def draw_rules(controller: FuzzyController) -> Any:
    """Draw the rule table."""
    codes = controller.system.rules.codes
    figure, axes = plt.subplots(figsize=(4, 4))
    axes.imshow(codes, cmap=matplotlib.colors.ListedColormap(_COLOURS), vmin=0, vmax=4)
    for (row, column), code in np.ndenumerate(codes):
        axes.text(column, row, WORDS[code], ha='center', va='center')
    axes.set(
        xticks=range(5),
        yticks=range(5),
        xticklabels=WORDS,
        yticklabels=WORDS,
        xlabel='position error',
        ylabel='velocity error',
        title='Force',
    )
    return figure


def draw_surface(controller: FuzzyController, points: int = 121) -> Any:
    """Draw the force over the two errors."""
    population, errors = population_of(controller), np.linspace(-1.0, 1.0, points)
    law, rows = lanes.make_law(controller.system.samples), lanes.make_scratch()
    lanes.set_law(law, *(field[0] for field in population))
    surface = np.empty((points, points))
    for i, velocity in enumerate(errors):
        rows[lanes.E_R : lanes.E_R + points] = errors
        rows[lanes.E_V : lanes.E_V + points] = velocity
        lanes.infer_lanes(rows, points, law)
        surface[i] = rows[lanes.OUTPUT : lanes.OUTPUT + points]
    r, v, f = controller.scales
    figure, axes = plt.subplots(figsize=(6, 4.5))
    image = axes.contourf(r * errors, v * errors, f * surface, 21, cmap='RdBu_r', vmin=-f, vmax=f)
    figure.colorbar(image, label='force [N]')
    axes.set(xlabel='position error [m]', ylabel='velocity error [m/s]', title='Control surface')
    return figure
