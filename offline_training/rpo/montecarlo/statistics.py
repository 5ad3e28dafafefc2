# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of a campaign: rates with Wilson's interval, quantiles, and the worst runs."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from rpo.montecarlo import judging
from rpo.montecarlo.config import CampaignConfig
from rpo.montecarlo.store import Results
from rpo_core.judge.verdicts import number
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.requirements import SHARES

CONFIDENCE = 0.95
QUANTILES = (0.5, 0.95, 0.99)


class Rate(NamedTuple):
    """A share of runs, with Wilson's score interval at 95 % confidence."""

    name: str
    kept: int
    runs: int
    low: float
    high: float

    @property
    def percent(self) -> str:
        """The share [%]; of more runs than 10 000 a digit more, so that one run still shows."""
        return self._shown(self.kept / self.runs)

    @property
    def interval(self) -> str:
        """The ends of the interval [%]."""
        return f'{self._shown(self.low)} to {self._shown(self.high)}'

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Name, runs, share and interval, as tables show them."""
        return self.name, f'{self.kept} / {self.runs}', f'{self.percent} %', f'{self.interval} %'

    def __str__(self) -> str:
        return f'{self.percent} % ({self.interval} %), {self.kept} of {self.runs} runs'

    def __repr__(self) -> str:
        return f'<Rate {self.name}: {self}>'

    def _shown(self, share: float) -> str:
        return f'{100 * share:.{2 if self.runs <= 10_000 else 3}f}'


def rate(name: str, kept: int, runs: int) -> Rate:
    """Return a rate with its interval.

    The interval is for independent runs. Runs of a Latin hypercube scatter less: it is then wide.
    """
    interval = binomtest(kept, runs).proportion_ci(CONFIDENCE, method='wilson')
    return Rate(name, kept, runs, float(interval.low), float(interval.high))


def successes(
    config: CampaignConfig, columns: Mapping[str, Floats], names: Collection[str] | None = None
) -> NDArray[np.bool_]:
    """Return which runs (n,) keep every limit; a metric that is not a number keeps no limit.

    names : of the limits; all if not given
    """
    names = config.success if names is None else names
    return np.logical_and.reduce([kept(config, name, columns) for name in names])


def kept(config: CampaignConfig, name: str, columns: Mapping[str, Floats]) -> NDArray[np.bool_]:
    """Return which runs (n,) keep a limit."""
    values, limit = config.limit(name, columns)
    return np.asarray(values <= limit)


class Spread(NamedTuple):
    """A metric over all runs.

    worst_run : number of the run with the largest value
    never : runs of which it is infinite: they never do that
    """

    name: str
    unit: str
    mean: float
    quantiles: tuple[float, ...]
    worst: float
    worst_run: int
    never: int = 0


def spread(name: str, unit: str, values: Floats, ends_m: Floats | None = None) -> Spread:
    """Return how a metric is distributed; infinite: what a run never did, like to arrive.

    ends_m : distances from the goal at the end; of runs that never do, the farthest is the worst
    """
    worst, never = int(np.argmax(values)), np.isinf(values)
    if ends_m is not None and never[worst]:
        worst = int(np.argmax(np.where(never, ends_m, -1.0)))
    if np.isfinite(values[worst]):
        found = np.quantile(values, QUANTILES)
    else:  # there is nothing between a number and infinity
        found = np.quantile(values, QUANTILES, method='higher')
    quantiles = tuple(float(q) for q in found)
    count = int(never.sum())
    return Spread(name, unit, float(values.mean()), quantiles, float(values[worst]), worst, count)


def ends_m(store: Results) -> Floats:
    """Return how far (n,) the runs end from the goal."""
    names, goal_m = ('final_x_m', 'final_y_m', 'final_z_m'), store.campaign.scenario.goal_position_m
    offsets = [store.column(name) - r for name, r in zip(names, goal_m, strict=True)]
    return np.asarray(np.sqrt(sum(offset * offset for offset in offsets)))


def cells(found: Spread) -> list[str]:
    """Return mean, quantiles and worst of a figure for people, and the run that is the worst."""
    mean = '–' if found.never else f'{found.mean:.3g}'
    numbers = (number(x) for x in (*found.quantiles, found.worst))
    return [mean, *numbers, str(found.worst_run)]


def nevers(found: Iterable[Spread], runs: int) -> list[str]:
    """Return how many of the runs never do what some figures are about, each once."""
    said = (f'{s.never} of {runs} {judging.never(s.name, s.never)}' for s in found if s.never)
    return list(dict.fromkeys(said))


def rates(store: Results) -> list[Rate]:
    """Return the rate of success, that of the limits of motion, then of each limit by itself.

    The second is left out where it is one of the others. The last are those of limits of the
    scenario that success has at another value.
    """
    success, stated = store.campaign.config.success, judging.stated(store.campaign)
    moving = judging.motion(success)
    together = {judging.MOTION: moving} if 1 < len(moving) < len(success) else {}
    each = {judging.label(name, limit): [name] for name, limit in success.items()}
    groups = {'success': list(success), **together, **each}
    config, runs = store.campaign.config, store.campaign.config.runs
    columns = {name: store.column(name) for name in {*config.judging, *stated.judging}}
    found = [
        rate(label, int(successes(config, columns, names).sum()), runs)
        for label, names in groups.items()
    ]
    beside = [
        rate(judging.label(name, x), int(kept(stated, name, columns).sum()), runs)
        for name, x in stated.success.items()
    ]
    return found + beside


def rows(store: Results) -> list[tuple[str, str, str, str]]:
    """Return the rates as tables show them, and what is not judged."""
    required = store.campaign.required
    return [rate.cells for rate in rates(store)] + [
        (judging.label(name, required[name]), judging.NOT_JUDGED, '', '')
        for name in judging.not_judged(store.campaign)
    ]


def spreads(store: Results, names: Iterable[str] | None = None) -> list[Spread]:
    """Return how metrics are distributed, all if none are named; few columns in memory at a time.

    The share that is judged is added, where it is.
    """
    config, units, ends = store.campaign.config, store.campaign.metrics, ends_m(store)
    chosen = units if names is None else names
    found = [spread(name, units[name], store.column(name), ends) for name in chosen]
    for share in SHARES.keys() & config.success.keys():
        value, level = (store.column(name) for name in config.judging_of(share))
        found.append(spread(share, judging.OF_ITS_OWN, value / level))
    return found


def document(store: Results) -> dict[str, Any]:
    """Return the summary as a document: what was judged, the rates, the figures."""
    campaign, found_rates, found_spreads = store.campaign, rates(store), spreads(store)
    return {
        'confidence': CONFIDENCE,
        'success': judging.sentence(campaign),
        'judged': judging.judged(campaign),
        'not_judged': judging.not_judged(campaign),
        'rates': {
            name: dict(count=kept, runs=runs, share=kept / runs, low=low, high=high)
            for name, kept, runs, low, high in found_rates
        },
        'figures': {
            s.name: {
                'unit': s.unit,
                'mean': s.mean,
                **{f'p{100 * q:g}': x for q, x in zip(QUANTILES, s.quantiles, strict=True)},
                'worst': s.worst,
                'worst_run': s.worst_run,
            }
            for s in found_spreads
        },
    }
