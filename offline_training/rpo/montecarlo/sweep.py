# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How many lost or late messages a closed loop tolerates: success against their share."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from rpo.montecarlo.config import Campaign
from rpo.montecarlo.execution import kept_of
from rpo.montecarlo.faults import SHARES, Faults
from rpo.montecarlo.statistics import Rate, rate

PERCENTS = tuple(range(0, 101, 10))

FAULTS = {'lost': ('state_loss', 'force_loss'), 'late': ('state_delay', 'force_delay')}
"""The shares that a sweep changes together: of states, and of forces."""


class SweepPoint(NamedTuple):
    """Success at one share: of the campaign as it is dispersed, and of its scenario alone."""

    percent: int
    dispersed: Rate
    alone: Rate


def sweep(campaign: Campaign, runs: int, kind: str) -> Iterator[SweepPoint]:
    """Yield the success of so many flights, dispersed and alone, at each share of a kind."""
    config = replace(campaign.config, runs=runs)
    base = config.faults or Faults()
    for percent in PERCENTS:
        shares: dict[str, Any] = {n: percent / 100.0 * (n in FAULTS[kind]) for n in SHARES}
        faults = replace(base, **shares) if percent else None
        rates = []
        for dispersions in (config.dispersions, {}):
            flown = replace(config, dispersions=dispersions, faults=faults)
            (kept,) = kept_of(campaign.with_config(flown), [flown.success])
            rates.append(rate('success', kept, runs))
        yield SweepPoint(percent, *rates)
