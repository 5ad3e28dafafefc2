# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of a campaign: rates with Wilson's interval, quantiles, and the worst runs."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from rpo_training.campaign.config import METRICS, THRUSTER_METRICS, CampaignConfig, metrics_of
from rpo_training.campaign.store import Store

_UNITS = METRICS | THRUSTER_METRICS

Floats = NDArray[np.float64]

CONFIDENCE = 0.95
QUANTILES = (0.5, 0.95, 0.99)


class Rate(NamedTuple):
    """A share of runs, with Wilson's score interval at 95 % confidence."""

    name: str
    kept: int
    runs: int
    low: float
    high: float


def rate(name: str, kept: int, runs: int) -> Rate:
    """Return a rate with its interval.

    The interval is for independent runs. Runs of a Latin hypercube scatter less: it is then wide.
    """
    interval = binomtest(kept, runs).proportion_ci(CONFIDENCE, method='wilson')
    return Rate(name, kept, runs, float(interval.low), float(interval.high))


def successes(config: CampaignConfig, columns: dict[str, Floats]) -> NDArray[np.bool_]:
    """Return which runs (n,) keep every limit; a metric that is not a number keeps no limit."""
    return np.logical_and.reduce([columns[name] <= limit for name, limit in config.success.items()])


class Spread(NamedTuple):
    """A metric over all runs; worst_run : number of the run with the largest value."""

    name: str
    unit: str
    mean: float
    quantiles: tuple[float, ...]
    worst: float
    worst_run: int


def spread(name: str, values: Floats) -> Spread:
    """Return how a metric is distributed."""
    worst = int(np.argmax(values))
    quantiles = tuple(float(q) for q in np.quantile(values, QUANTILES))
    return Spread(name, _UNITS[name], float(values.mean()), quantiles, float(values[worst]), worst)


def rates(store: Store) -> list[Rate]:
    """Return the rate of success, then of each of its conditions."""
    config = store.campaign.config
    columns = {name: store.column(name) for name in config.success}
    found = [rate('success', int(successes(config, columns).sum()), config.runs)]
    for name, limit in config.success.items():
        label = f'{name} <= {limit:g} {_UNITS[name]}'
        found.append(rate(label, int((columns[name] <= limit).sum()), config.runs))
    return found


def spreads(store: Store) -> list[Spread]:
    """Return how every metric is distributed; one column in memory at a time."""
    return [spread(name, store.column(name)) for name in metrics_of(store.campaign.scenario)]


def document(found_rates: list[Rate], found_spreads: list[Spread]) -> dict[str, Any]:
    """Return the summary as a document."""
    return {
        'confidence': CONFIDENCE,
        'rates': {
            r.name: {
                'count': r.kept,
                'runs': r.runs,
                'share': r.kept / r.runs,
                'low': r.low,
                'high': r.high,
            }
            for r in found_rates
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
