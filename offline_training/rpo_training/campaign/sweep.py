# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How many lost or late messages a closed loop bears: success against their share."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from rpo_training.campaign.config import Campaign, CampaignConfig, dumps
from rpo_training.campaign.faults import SHARES, Faults
from rpo_training.campaign.run_batch import COLUMNS, fly_unit, units
from rpo_training.campaign.statistics import Rate, rate, successes

STEP = 10
PERCENTS = tuple(range(0, 101, STEP))

FAULTS = {'lost': ('state_loss', 'force_loss'), 'late': ('state_delay', 'force_delay')}
"""What is swept: the share of states, and with it that of forces."""


class SweepPoint(NamedTuple):
    """Success at one share: of the campaign as it is dispersed, and of its scenario alone."""

    percent: int
    dispersed: Rate
    alone: Rate


class Edge(NamedTuple):
    """Where the scenario alone, without dispersions, ceases to succeed; percentages, to 1 %.

    all_up_to : the largest up to which every flight succeeded; None if not even without faults
    none_from : the least from which none did; None if some did at 100 %
    """

    all_up_to: int | None
    none_from: int | None


class Sweep:
    """Flies a campaign at one share after the other.

    runs : flights per share, dispersed and again without dispersions
    said : called after each share
    """

    def __init__(
        self, campaign: Campaign, runs: int, said: Callable[[], None] = lambda: None
    ) -> None:
        self._said = said
        self._base = campaign.config.faults or Faults()
        config = replace(campaign.config, runs=runs)
        self._dispersed = _with(campaign, config)
        self._alone = _with(campaign, replace(config, dispersions={}))
        self._pool = ThreadPoolExecutor(len(os.sched_getaffinity(0)), 'rpo-sweep')

    def rows(self, kind: str) -> list[SweepPoint]:
        """Return the rows of a kind of fault."""
        return [self._row(kind, percent) for percent in PERCENTS]

    def _row(self, kind: str, percent: int) -> SweepPoint:
        row = SweepPoint(
            percent, self._rate(self._dispersed, kind, percent), self._bare(kind, percent)
        )
        self._said()
        return row

    def edge(self, kind: str, rows: list[SweepPoint]) -> Edge:
        """Return between which percentages the scenario alone ceases to succeed."""
        whole = [row.percent for row in rows if row.alone.kept == row.alone.runs]
        lost = [row.percent for row in rows if row.alone.kept == 0]
        most = None
        if rows[0].percent in whole:
            most = max(p for p in whole if set(range(0, p + 1, STEP)) <= set(whole))
            while most < 100 and self._keeps_all(kind, most + 1):
                most += 1
        least = min(lost, default=None)
        while least and not self._bare(kind, least - 1).kept:
            least -= 1
        return Edge(most, least)

    def _keeps_all(self, kind: str, percent: int) -> bool:
        found = self._bare(kind, percent)
        return found.kept == found.runs

    def _bare(self, kind: str, percent: int) -> Rate:
        return self._rate(self._alone, kind, percent)

    def _rate(self, campaign: Campaign, kind: str, percent: int) -> Rate:
        share, chosen = percent / 100.0, None
        if percent:
            shares: dict[str, Any] = {name: share * (name in FAULTS[kind]) for name in SHARES}
            chosen = replace(self._base, **shares)
        flown = _with(campaign, replace(campaign.config, faults=chosen))
        parts = self._pool.map(lambda unit: fly_unit(flown, unit), range(units(flown.config.runs)))
        columns = dict(zip(COLUMNS, np.hstack(list(parts)), strict=True))
        return rate('success', int(successes(flown.config, columns).sum()), flown.config.runs)


def _with(campaign: Campaign, config: CampaignConfig) -> Campaign:
    texts = (dumps(config), *campaign.texts[1:])
    return Campaign(config, campaign.scenario, campaign.controller, texts)
