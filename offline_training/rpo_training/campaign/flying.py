# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flying a campaign, on the threads of this machine or on a `dask.distributed` cluster.

A unit's results depend on nothing but the campaign and the unit: who flies it, and when, does not
matter. A few units a worker are under way at a time, so that memory stays flat.
"""

from __future__ import annotations

import hashlib
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import closing, contextmanager
from functools import lru_cache
from importlib.util import find_spec
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.validation import InputError
from rpo_training.campaign.config import Campaign
from rpo_training.campaign.fleet import COLUMNS, fly_unit
from rpo_training.campaign.statistics import document, rates, spreads, successes
from rpo_training.campaign.store import Store, versions

Floats = NDArray[np.float64]
Results = Iterator[tuple[int, Floats]]

AHEAD = 3
"""Units under way per thread of a worker."""

CONNECT_S = 10
"""How long a cluster may take to answer."""

RETRIES = 10
"""Workers that may die on one unit before the campaign gives up."""


def fly(
    store: Store,
    workers: int = 0,
    cluster: str = '',
    progress: Callable[[int, int], None] = lambda runs, successful: None,
) -> None:
    """Fly what is still to be flown, then finish the folder.

    workers : threads, or processes of a local cluster; 0, one per core
    cluster : '', on threads; 'local', or the address of a scheduler, tcp://host:port
    progress : is told the runs that came in and how many of them succeeded
    """
    with store.alone():
        pending = store.pending()
        if not store.finished:
            _fly(store, pending, workers or len(os.sched_getaffinity(0)), cluster, progress)


def _fly(
    store: Store,
    pending: list[int],
    workers: int,
    cluster: str,
    progress: Callable[[int, int], None],
) -> None:
    campaign = store.campaign
    if cluster and find_spec('distributed') is None:
        raise InputError('`--cluster` needs dask.distributed: `make setup LAYERS=campaign`')
    source = (
        on_cluster(campaign, pending, cluster, workers)
        if cluster
        else on_threads(campaign, pending, workers)
    )
    with closing(source):  # type: ignore[type-var]
        for unit, results in source:
            store.put(unit, results)
            figures = dict(zip(COLUMNS, results, strict=True))
            progress(results.shape[1], int(successes(campaign.config, figures).sum()))
    store.finish(document(rates(store), spreads(store)))


def on_threads(campaign: Campaign, pending: list[int], workers: int) -> Results:
    """Yield results as they come in."""
    pool = ThreadPoolExecutor(workers, 'rpo-campaign')
    todo = iter(pending)
    under_way: dict[Future[Floats], int] = {}
    try:
        while True:
            for unit in islice(todo, AHEAD * workers - len(under_way)):
                under_way[pool.submit(fly_unit, campaign, unit)] = unit
            if not under_way:
                return
            done, _ = wait(under_way, return_when=FIRST_COMPLETED)
            for future in done:
                yield under_way.pop(future), future.result()
    finally:
        pool.shutdown(cancel_futures=True)


@lru_cache(maxsize=2)
def _campaign(texts: tuple[str, str, str]) -> Campaign:
    return Campaign.of_texts(texts, ('campaign', 'scenario', 'controller'))


def fly_remote(texts: tuple[str, str, str], unit: int) -> tuple[dict[str, str], Floats]:
    """Fly a unit on a worker; return the versions its bits depend on, and the results."""
    return versions(), fly_unit(_campaign(texts), unit)


def on_cluster(campaign: Campaign, pending: list[int], address: str, workers: int) -> Results:
    """Yield results as they come in; a unit whose worker is lost is flown by another.

    Raises
    ------
    InputError
        If the cluster does not answer, is lost, or has other versions of what bits depend on.
    """
    from distributed import KilledWorker, as_completed
    from distributed.comm import CommClosedError

    mark = hashlib.sha256('\0'.join(campaign.texts).encode()).hexdigest()[:16]
    with _client(address, workers) as client:
        threads = max(1, sum(client.nthreads().values()))
        todo = iter(pending)

        def submit(unit: int) -> Any:
            return client.submit(
                fly_remote, campaign.texts, unit, key=(f'rpo-campaign-{mark}', unit)
            )

        futures = as_completed(map(submit, islice(todo, AHEAD * threads)))
        try:
            for future in futures:
                unit, (theirs, results) = future.key[1], future.result()
                if theirs != versions():
                    raise InputError(f'a worker has {theirs}; needed, for the bits, {versions()}')
                for following in islice(todo, 1):
                    futures.add(submit(following))
                yield unit, results
        except KilledWorker as error:
            raise InputError(
                f'{RETRIES} workers died on one unit of the campaign: {error}'
            ) from None
        except ImportError as error:
            raise InputError(f'a worker of {address} cannot import the campaign: {error}') from None
        except (CommClosedError, CancelledError, OSError):
            raise InputError(
                f'cluster {address} was lost; what was flown is saved, go on with --resume'
            ) from None


@contextmanager
def _deaf_to_ctrl_c() -> Iterator[None]:
    """Ignore SIGINT, as do the processes that are started meanwhile: it is for this one to stop."""
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)


@contextmanager
def _client(address: str, workers: int) -> Iterator[Any]:
    """Yield a client of a scheduler, or of a cluster made for it."""
    import dask
    from distributed import Client, LocalCluster

    with dask.config.set({'distributed.scheduler.allowed-failures': RETRIES}):
        if address == 'local':
            with _deaf_to_ctrl_c():
                cluster = LocalCluster(
                    n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None
                )
            with cluster, Client(cluster) as client:
                yield client
            return
        try:
            client = Client(address, timeout=CONNECT_S)
        except (OSError, ValueError) as error:
            raise InputError(
                f'`--cluster` must be local or the address of a scheduler that answers, like '
                f'tcp://127.0.0.1:8786; got {address} ({type(error).__name__})'
            ) from None
        with client:
            yield client
