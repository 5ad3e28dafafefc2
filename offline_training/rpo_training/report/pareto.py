# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Energy against success of compared controllers, as a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rpo_log.show import style
from rpo_training.evaluation.comparison import ComparedController

_ENERGIES = (2.5, 3, 3.5, 4, 5, 7, 10, 15, 20)
_SHARES = (0.01, 0.1, 1, 10, 100)


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
            ylabel='dispersed runs that miss [%], the fewer the higher',
            title='Energy against success: fuzzy controllers ●, baselines ■',
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


def _missed(row: ComparedController) -> float:
    return max(1.0 - row.kept / row.runs, 0.5 / row.runs)
