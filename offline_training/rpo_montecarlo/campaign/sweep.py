# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How many lost or late messages a closed loop tolerates: success against their share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from rpo_montecarlo.campaign.config import Campaign
from rpo_montecarlo.campaign.execution import kept_of
from rpo_montecarlo.campaign.faults import SHARES, Faults
from rpo_montecarlo.campaign.statistics import Rate, rate

STEP = 10
PERCENTS = tuple(range(0, 101, STEP))

FAULTS = {'lost': ('state_loss', 'force_loss'), 'late': ('state_delay', 'force_delay')}
"""The shares that a sweep changes together: of states, and of forces."""


class SweepPoint(NamedTuple):
    """Success at one share: of the campaign as it is dispersed, and of its scenario alone."""

    percent: int
    dispersed: Rate
    alone: Rate


class Edge(NamedTuple):
    """Shares [%], to 1 %, of faults between which success of the scenario alone goes to zero.

    all_up_to : largest share up to which every flight succeeded; None if some failed without faults
    none_from : least share from which no flight succeeded; None if some succeeded at 100 %
    """

    all_up_to: int | None
    none_from: int | None


class Sweep:
    """Flies a campaign at each share of faults.

    runs : flights per share, dispersed and again without dispersions
    progress : called after each share
    """

    def __init__(
        self, campaign: Campaign, runs: int, progress: Callable[[], None] = lambda: None
    ) -> None:
        self._progress = progress
        self._base = campaign.config.faults or Faults()
        config = replace(campaign.config, runs=runs)
        self._campaigns = [campaign.with_config(config)]
        self._campaigns.append(campaign.with_config(replace(config, dispersions={})))

    def rows(self, kind: str) -> list[SweepPoint]:
        """Return the rows of a kind of fault."""
        found = []
        for percent in PERCENTS:
            rates = (self._rate(campaign, kind, percent) for campaign in self._campaigns)
            found.append(SweepPoint(percent, *rates))
            self._progress()
        return found

    def edge(self, kind: str, rows: list[SweepPoint]) -> Edge:
        """Return the shares between which success of the scenario alone goes to zero."""

        def kept(percent: int) -> int:
            return self._rate(self._campaigns[1], kind, percent).kept

        all_runs = rows[0].alone.runs
        some_fail = (row.percent for row in rows if row.alone.kept < all_runs)
        none_keep = (row.percent for row in rows if row.alone.kept == 0)
        most = next(some_fail, 100 + STEP) - STEP
        while 0 <= most < 100 and kept(most + 1) == all_runs:
            most += 1
        least = next(none_keep, None)
        while least and not kept(least - 1):
            least -= 1
        return Edge(most if most >= 0 else None, least)

    def _rate(self, campaign: Campaign, kind: str, percent: int) -> Rate:
        share, chosen = percent / 100.0, None
        if percent:
            shares: dict[str, Any] = {name: share * (name in FAULTS[kind]) for name in SHARES}
            chosen = replace(self._base, **shares)
        faulty = campaign.with_config(replace(campaign.config, faults=chosen))
        (kept,) = kept_of(faulty, [faulty.config.success])
        return rate('success', kept, faulty.config.runs)
