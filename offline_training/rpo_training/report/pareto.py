# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Energy against success of compared controllers, as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rpo_log.show import style
from rpo_training.evaluation.comparison import ComparedController


def best(rows: Sequence[ComparedController]) -> list[ComparedController]:
    """Return the controllers that no other beats in energy and in success, by rising energy."""
    found: list[ComparedController] = []
    for row in sorted(rows, key=lambda row: (row.mean_energy_n2s, -row.kept / row.runs)):
        if row.met and all(row.kept / row.runs > other.kept / other.runs for other in found):
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
            low, high = max(1.0 - row.high, 0.1 / row.runs), 1.0 - row.low
            fuzzy = row.kind in ('fuzzy', 'pace', 'time_to_go')
            colour = style.LIGHT['x'] if fuzzy else style.LIGHT['muted']
            axes.plot([x, x], [100 * low, 100 * high], color=colour, linewidth=1)
            axes.plot(x, 100 * y, 'o' if fuzzy else 's', color=colour, markersize=6)
            axes.annotate(row.name, (x, 100 * y), xytext=(6, 4), textcoords='offset points')
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
            ylabel='dispersed runs that miss [%], the fewer the higher',
            title='Energy against success: fuzzy controllers ●, baselines ■',
        )
        axes.invert_yaxis()
        ticks = [2.5, 3, 3.5, 4, 5, 7, 10, 15, 20]
        axes.set_xticks(ticks, [f'{tick:g}' for tick in ticks], minor=False)
        axes.set_xticks([], minor=True)
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)


def _missed(row: ComparedController) -> float:
    return max(1.0 - row.kept / row.runs, 0.5 / row.runs)
