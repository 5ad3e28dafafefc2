# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Energy of compared controllers against the dispersed runs that keep position and speed.

A campaign without limits on position and speed is drawn by all its limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rpo_judge.evaluation.comparison import ComparedController, Share
from rpo_log.show import style
from rpo_montecarlo.campaign.judging import MOTION

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
