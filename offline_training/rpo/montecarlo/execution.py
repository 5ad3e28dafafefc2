# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flying a campaign, on the threads of this machine or on a `dask.distributed` cluster.

The results of a unit depend on the campaign and the unit only, not on the worker or the order. A
few units per worker are under way at a time, so that memory stays flat.

`sweep`: how many lost or late messages a loop tolerates, success against their share.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from functools import lru_cache
from threading import Event
from typing import Any, NamedTuple

from rpo.montecarlo import pool
from rpo.montecarlo.config import Campaign
from rpo.montecarlo.faults import SHARES, Faults
from rpo.montecarlo.run_batch import columns_of, fly_run, fly_runs, fly_unit, units
from rpo.montecarlo.statistics import Rate, document, rate, successes
from rpo.montecarlo.store import Results
from rpo_core.chain.chain import Chain, start_of
from rpo_core.chain.driver import Driver
from rpo_core.chain.flight import Flight
from rpo_core.files.validation import InputError
from rpo_core.judge.metrics import FINAL
from rpo_core.kernels.arrays import Floats

Units = Generator[tuple[int, Floats], None, None]


def fly(
    store: Results,
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


def fly_again(
    campaign: Campaign, number: int, results: Results | None = None
) -> tuple[dict[str, Floats], Flight]:
    """Return the columns (1,) of a run, and its flight through the core.

    Raises InputError if the two have other bits, or other ones than its results.
    """
    columns, flight = fly_runs(campaign, number, 1), fly_run(campaign, number)
    same = [float(columns[name][0]) for name in FINAL] == flight.states[-1].tolist()
    if results is not None:
        same = same and all(results.column(n)[number] == columns[n][0] for n in columns)
    if not same:
        cause = 'this is a defect' if campaign.texts[2] else 'its function has memory'
        raise InputError(f'run {number}: the second flight has other bits: {cause}')
    return columns, flight


def results_of(campaign: Campaign, pending: Iterable[int], workers: int, address: str) -> Units:
    """Yield the results of units as they come in; a cluster gets the texts of the campaign.

    Who stops asking for them stops threads between two runs.
    """
    if address:
        remote = ((unit, (campaign.texts, unit)) for unit in pending)
        yield from pool.run(fly_remote, remote, workers, address)
        return
    chain = Chain.of(campaign.scenario, campaign.controller)
    Driver(chain).begin(start_of(campaign.scenario), 0)  # compiles where Ctrl-C ends it at once
    stopped = Event()
    calls = ((unit, (campaign, unit, stopped.is_set)) for unit in pending)
    with closing(pool.run(fly_unit, calls, workers)) as source:
        try:
            yield from source
        finally:
            stopped.set()


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
