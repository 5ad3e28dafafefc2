# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The picture of a comparison: energy against dispersed runs that keep their limits, and time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rpo.analysis.comparison import Row
from rpo.montecarlo.judging import MOTION
from rpo_log.show import style

_FUZZY = ('fuzzy', 'more_words', 'time_to_go')


def draw(rows: Sequence[Row]) -> Any:
    """Return the picture; a controller that arrives from no training start is left out.

    Shares are on a logistic scale, with their intervals; none and all are drawn at half a run.
    """
    figure, (kept, time) = style.new_panels(7.0, 2, 1, sharex=True)
    shown = [row for row in rows if row['met'] and row['moving']]
    for i, row in enumerate(sorted(shown, key=lambda row: row['mean_energy_n2s']), 1):
        moving, energy, least = row['moving'], row['mean_energy_n2s'], 0.5 / row['runs']
        fuzzy = row['kind'] in _FUZZY
        colour = style.LIGHT['x' if fuzzy else 'muted']
        mark = {'marker': 'o' if fuzzy else 's', 'color': colour, 'markersize': 13}
        shares = (moving['low'], moving['kept'] / row['runs'], moving['high'])
        low, middle, high = (min(max(share, least), 1.0 - least) for share in shares)
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
