# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The picture of what each parameter of a controller does."""

from __future__ import annotations

from typing import Any

from rpo_judge.evaluation.sensitivity import RUNS, STEP, Effect, Outcome
from rpo_log.show import style


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
