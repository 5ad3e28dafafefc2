# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Work on the threads of this machine, or on a `dask.distributed` cluster.

A cluster is one of this machine, or a scheduler at an address. A result depends on the function and
its arguments only: another worker repeats the task of a lost one, and the bits are those of one
machine. A few tasks per thread are under way at a time, so that memory stays flat.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from importlib.metadata import version
from importlib.util import find_spec
from itertools import islice
from logging import CRITICAL
from typing import Any, TypeVar
from uuid import uuid4

from rpo_core.files.validation import InputError

Result = TypeVar('Result')

AHEAD = 3
"""Tasks under way per thread."""

CONNECT_S = 10
"""How long a cluster may take to answer."""

RETRIES = 10
"""After so many workers have died on one task, the work fails."""


def versions() -> dict[str, str]:
    """Return the versions of the libraries that the bits of results depend on."""
    return {name: version(name) for name in ('numba', 'numpy', 'scipy')}


def on_threads(
    function: Callable[..., Result], calls: Iterable[tuple[int, tuple[Any, ...]]], workers: int
) -> Generator[tuple[int, Result], None, None]:
    """Call a function on threads, as `run` does."""
    executor, todo = ThreadPoolExecutor(workers, 'rpo-work'), iter(calls)
    under_way: dict[Future[Result], int] = {}
    try:
        while True:
            for number, arguments in islice(todo, AHEAD * workers - len(under_way)):
                under_way[executor.submit(function, *arguments)] = number
            if not under_way:
                return
            done, _ = wait(under_way, return_when=FIRST_COMPLETED)
            for future in done:
                yield under_way.pop(future), future.result()
    finally:
        executor.shutdown(wait=False, cancel_futures=True)


def run(
    function: Callable[..., Result],
    calls: Iterable[tuple[int, tuple[Any, ...]]],
    workers: int,
    address: str = '',
) -> Generator[tuple[int, Result], None, None]:
    """Call a function on threads or on a cluster; yield (number, result) of each as they come in.

    calls : (number, arguments) of each
    workers : threads, or processes of a local cluster; 0, one per core
    address : of a cluster: '', on threads; 'local'; that of a scheduler, tcp://host:port

    Raises
    ------
    InputError
        If the cluster does not answer, is lost, or has other versions of what bits depend on.
    """
    workers = workers or len(os.sched_getaffinity(0))
    if not address:
        yield from on_threads(function, calls, workers)
        return
    with connected(address, workers) as client:
        yield from results(client, function, calls)


def _call(function: Callable[..., Any], *arguments: Any) -> tuple[dict[str, str], Any]:
    """Call a function on a worker; return the versions its bits depend on, and the result."""
    return versions(), function(*arguments)


@contextmanager
def _as_input_errors(client: Any) -> Iterator[None]:
    """Raise the errors of a cluster as InputError."""
    from distributed import KilledWorker
    from distributed.client import ClosedClientError
    from distributed.comm import CommClosedError

    address = client.scheduler_info().get('address', 'local')
    try:
        yield
    except KilledWorker as error:
        raise InputError(f'{RETRIES} workers died on one task: {error}') from None
    except ImportError as error:
        raise InputError(f'a worker of {address} cannot import the work: {error}') from None
    except (CommClosedError, ClosedClientError, CancelledError, OSError):
        raise InputError(
            f'cluster {address} was lost; finished work is saved, go on with --resume'
        ) from None


def results(
    client: Any, function: Callable[..., Any], calls: Iterable[tuple[int, tuple[Any, ...]]]
) -> Iterator[tuple[int, Any]]:
    """Call a function on the workers, as `run` does."""
    from distributed import as_completed

    name, todo = f'rpo-{uuid4().hex}', iter(calls)

    def submit(call: tuple[int, tuple[Any, ...]]) -> Any:
        return client.submit(_call, function, *call[1], key=(name, call[0]))

    with _as_input_errors(client):
        ahead = AHEAD * max(1, sum(client.nthreads().values()))
        futures = as_completed(map(submit, islice(todo, ahead)))
        for future in futures:
            number, (theirs, result) = future.key[1], future.result()
            if theirs != versions():
                raise InputError(f'a worker has {theirs}; the same bits need {versions()}')
            for following in islice(todo, 1):
                futures.add(submit(following))
            yield number, result


@contextmanager
def _ignoring_ctrl_c() -> Iterator[None]:
    """Ignore SIGINT, also in processes started meanwhile, which this process stops itself."""
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)


@contextmanager
def connected(address: str, workers: int) -> Iterator[Any]:
    """Yield a client of the scheduler at an address like tcp://host:port.

    address : 'local' makes a cluster of `workers` processes on this machine

    Raises
    ------
    InputError
        If no scheduler answers there, or dask.distributed is not installed.
    """
    if find_spec('distributed') is None:
        raise InputError('`--cluster` needs dask.distributed: `make setup LAYERS=campaign`')
    import dask
    from distributed import Client, LocalCluster

    with dask.config.set({'distributed.scheduler.allowed-failures': RETRIES}):
        if address == 'local':
            with _ignoring_ctrl_c():
                cluster = LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    processes=True,
                    dashboard_address=None,
                    silence_logs=CRITICAL,  # of a worker that stops first, after Ctrl-C
                )
            with cluster, Client(cluster) as client:
                yield client
            return
        try:
            client = Client(address, timeout=CONNECT_S)
        except (OSError, ValueError, TypeError) as error:  # TypeError: TLS without certificates
            raise InputError(
                f'`--cluster` must be local or the address of a scheduler that answers, like '
                f'tcp://127.0.0.1:8786; got {address} ({type(error).__name__}); a tls:// address '
                'needs the certificates in the configuration of dask, see docs/campaigns.md'
            ) from None
        with client:
            yield client
