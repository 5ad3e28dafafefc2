# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flying a campaign, on the threads of this machine or on a `dask.distributed` cluster.

The results of a unit depend on the campaign and the unit only, not on the worker or the order. A
few units per worker are under way at a time, so that memory stays flat.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterable, Sequence
from contextlib import closing
from functools import lru_cache

from rpo.montecarlo import pool
from rpo.montecarlo.config import Campaign
from rpo.montecarlo.run_batch import columns_of, fly_unit, units
from rpo.montecarlo.statistics import document, successes
from rpo.montecarlo.store import Store
from rpo_core.kernels.arrays import Floats

Results = Generator[tuple[int, Floats], None, None]


def fly(
    store: Store,
    workers: int = 0,
    address: str = '',
    progress: Callable[[int, int], None] = lambda runs, successful: None,
) -> None:
    """Fly the pending units, then finish the folder.

    workers : threads, or processes of a local cluster; 0, one per core
    address : of a cluster: '', on threads; 'local'; that of a scheduler, tcp://host:port
    progress : called with the runs of each finished unit, and how many of them succeeded
    """
    campaign = store.campaign
    with store.alone():
        if store.finished:
            return
        with closing(results_of(campaign, store.pending(), workers, address)) as source:
            for unit, results in source:
                store.put(unit, results)
                columns = dict(zip(columns_of(campaign), results, strict=True))
                progress(results.shape[1], int(successes(campaign.config, columns).sum()))
        store.finish(document(store))


def results_of(campaign: Campaign, pending: Iterable[int], workers: int, address: str) -> Results:
    """Yield the results of units as they come in; a cluster gets the texts of the campaign."""
    if address:
        calls = ((unit, (campaign.texts, unit)) for unit in pending)
        return pool.run(fly_remote, calls, workers, address)
    return pool.run(fly_unit, ((unit, (campaign, unit)) for unit in pending), workers, '')


def kept_of(
    campaign: Campaign,
    groups: Sequence[Collection[str]],
    workers: int = 0,
    progress: Callable[[int, int], None] = lambda done, runs: None,
) -> list[int]:
    """Fly all runs on threads; return how many keep all limits of each group.

    progress : called with the runs that were done before each unit, and their number in all
    """
    kept, done, runs = [0] * len(groups), 0, campaign.config.runs
    with closing(results_of(campaign, range(units(runs)), workers, '')) as source:
        for _, results in source:
            progress(done, runs)
            columns = dict(zip(columns_of(campaign), results, strict=True))
            for place, names in enumerate(groups):
                kept[place] += int(successes(campaign.config, columns, names).sum())
            done += results.shape[1]
    return kept


@lru_cache(maxsize=2)
def _campaign(texts: tuple[str, str, str]) -> Campaign:
    return Campaign.of_texts(texts, ('campaign', 'scenario', 'controller'))


def fly_remote(texts: tuple[str, str, str], unit: int) -> Floats:
    """Fly a unit on a worker."""
    return fly_unit(_campaign(texts), unit)
