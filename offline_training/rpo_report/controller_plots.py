# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of a fuzzy controller: membership functions, rules, surface, the 216 starts."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.control.controller import FuzzyController
from rpo_core.control.fuzzy import WORDS
from rpo_core.judge.metrics import ARRIVAL_DISTANCE, ARRIVAL_SPEED, ENERGY, SLEW
from rpo_judge.analysis import surface
from rpo_judge.evaluation.assessment import Assessment
from rpo_judge.evaluation.sensitivity import RUNS, STEP, Effect, Outcome
from rpo_judge.scoring import fitness
from rpo_log.show import style
from rpo_report.surface_plots import draw_force, force_bar

Floats = NDArray[np.float64]

_SLICES = (-1.0, -0.5, 0.0, 0.5, 1.0)
_CONDITIONS = {
    'mean speed, last 30 s': ARRIVAL_SPEED,
    'slew': SLEW,
    'mean distance, last 30 s': ARRIVAL_DISTANCE,
}


def membership_functions(controller: FuzzyController) -> Any:
    """Return the membership functions of the three variables, in their units."""
    system, x = controller.system, np.linspace(-1.0, 1.0, 1001)
    figure, panels = style.new_panels(5.6, 3)
    for axes, name, scale, functions in zip(
        panels,
        ('position error [m]', 'velocity error [m/s]', 'force [N]'),
        controller.scales,
        (system.position, system.velocity, system.force),
        strict=True,
    ):
        for grades, word, colour in zip(functions.grades(x).T, WORDS, style.WORDS, strict=True):
            axes.plot(scale * x, np.where(grades > 0.0, grades, np.nan), label=word, color=colour)
        axes.set(xlabel=name, ylabel='grade', xlim=(-scale, scale), ylim=(0.0, 1.05))
    style.legend_below(figure, panels[0])
    return figure


def rules(controller: FuzzyController) -> Any:
    """Return the rule table."""
    from matplotlib.patches import Rectangle

    figure, axes = style.new_panels(4.0)
    table = controller.system.rules
    for (row, column), code in np.ndenumerate(table.codes):
        shade = style.SCALE[round(int(code) * (style.SHADES - 1) / 4)]
        corner, edge = (column - 0.5, row - 0.5), style.LIGHT['paper']
        axes.add_patch(Rectangle(corner, 1, 1, facecolor=shade, edgecolor=edge))
        axes.text(column, row, table.words[row][column], ha='center', va='center')
    axes.set(
        xticks=range(5),
        yticks=range(5),
        xticklabels=WORDS,
        yticklabels=WORDS,
        xlim=(-0.5, 4.5),
        ylim=(-0.5, 4.5),
        xlabel='word of the position error',
        ylabel='word of the velocity error',
        title='word of the force',
    )
    axes.set_aspect('equal')
    axes.grid(False)
    return figure


def control_surface(controller: FuzzyController) -> Any:
    """Return the force over both errors, and over the position error at some velocity errors."""
    position, velocity, force = controller.scales
    figure, (wide, slices) = style.new_panels(4.2, 1, 2, width_ratios=(5, 4))
    image = draw_force(wide, controller, (position, velocity), sign=1.0)
    wide.set(xlabel='position error [m]', ylabel='velocity error [m/s]')
    force_bar(figure, image, wide)
    e = np.linspace(-1.0, 1.0, 401)
    for share, colour in zip(_SLICES, style.WORDS, strict=True):
        u = surface.values(controller.system, e, np.full_like(e, share))
        label = f'velocity error {share * velocity:.3g} m/s'
        slices.plot(position * e, force * u, color=colour, label=label)
    slices.set(xlabel='position error [m]', ylabel='force [N]')
    slices.margins(x=0.01)
    style.legend_below(figure, slices, columns=3)
    return figure


def starts(found: Assessment) -> Any:
    """Return energy and conditions over the training starts."""
    figure, (energy, conditions) = style.new_panels(4.0, 1, 2)
    _energies(energy, found)
    count = np.arange(1, len(found.starts) + 1)
    for (name, column), limit, colour in zip(
        _CONDITIONS.items(), fitness.LIMITS, style.AXES, strict=True
    ):
        share = np.sort(found.metrics[:, column]) / limit
        conditions.step(share, count, where='post', color=colour, label=name)
    conditions.axvline(1.0, **style.LIMIT, label='limit')
    conditions.set(xlabel='share of its limit', ylabel='starts that stay below', xlim=(0.0, None))
    style.legend_below(figure, energy, conditions, columns=3)
    return figure


def _energies(axes: Any, found: Assessment) -> None:
    energy = found.metrics[:, ENERGY]
    axes.plot(found.least, energy, 'o', color=style.LIGHT['x'], markersize=4, label='a start')
    most = np.array([0.0, 1.05 * found.least.max()])
    for factor, line, label in ((1, '-', 'the least itself'), (2, (0, (5, 2)), 'twice the least')):
        colour = style.LIGHT['optimum']
        axes.plot(most, factor * most, color=colour, linestyle=line, label=label)
    axes.set(
        xlabel='least J to rest in 200 s [N²s]',
        ylabel='J of the flight [N²s]',
        xlim=most,
        ylim=(0.0, 1.05 * max(energy.max(), most[1])),
    )


def draw_effects(base: Outcome, found: list[Effect]) -> Any:
    """Return bars of energy, margin and missed runs after a step of each parameter."""
    figure, panels = style.new_panels(0.26 * len(found) + 1.2, 1, 3, sharey=True)
    values = (
        ('mean J [N²s]', base.energy_n2s, lambda o: o.energy_n2s),
        ('smallest margin [%]', 100.0 * base.margin, lambda o: max(100.0 * o.margin, -100.0)),
        (f'missed, of {RUNS} runs', base.missed, lambda o: o.missed),
    )
    labels = [f'{e.part}: {e.parameter} = {e.value}' for e in found]
    for axes, (name, now, value) in zip(panels, values, strict=True):
        for shift, side, colour in ((-0.2, 'down', style.AXES[0]), (0.2, 'up', style.AXES[1])):
            shown = [(i, getattr(e, side)) for i, e in enumerate(found)]
            places = [i + shift for i, o in shown if o is not None]
            ends = [value(o) - now for _, o in shown if o is not None]
            step = f'{100 * STEP:g} % or one word {side}'
            axes.barh(places, ends, 0.38, left=now, color=colour, label=step)
        axes.axvline(now, **style.LIMIT)
        axes.set(xlabel=name)
    panels[0].set(yticks=range(len(found)), yticklabels=labels)
    panels[0].invert_yaxis()
    style.legend_below(figure, panels[0])
    return figure
