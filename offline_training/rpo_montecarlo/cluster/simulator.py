# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The simulator on a cluster: each task flies some members of a population."""

from __future__ import annotations

import os
import pickle
from collections.abc import Sequence
from contextlib import ExitStack
from functools import lru_cache

import numpy as np

from rpo_kernels.arrays import Floats
from rpo_montecarlo.cluster import pool
from rpo_montecarlo.engine.cases import Case, DrawnCase
from rpo_montecarlo.engine.population import Population
from rpo_montecarlo.engine.simulator import Simulator

SHARES = 3
"""A population is cut into so many tasks per thread of the cluster."""


@lru_cache(maxsize=2)
def _simulator(cases: bytes) -> Simulator:
    return Simulator(pickle.loads(cases), workers=1)


def fly_remote(cases: bytes, members: Population, some: slice) -> list[Floats]:
    """Fly members of a population through some cases, on a worker, in the thread of the task."""
    return _simulator(cases).fly(members, some)


class ClusterSimulator:
    """Flies populations through cases like `Simulator`, on a cluster.

    address : 'local', or that of a scheduler, tcp://host:port
    workers : processes of a local cluster; 0, one per core

    Raises InputError if the cluster does not answer, or is lost later.
    """

    def __init__(self, cases: Sequence[Case | DrawnCase], workers: int, address: str) -> None:
        self.take(cases)
        self._stack = ExitStack()
        count = workers or len(os.sched_getaffinity(0))
        self._client = self._stack.enter_context(pool.connected(address, count))

    def __enter__(self) -> ClusterSimulator:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def take(self, cases: Sequence[Case | DrawnCase]) -> None:
        """Fly these cases from now on."""
        self._shapes = [(len(case.starts), case.columns) for case in cases]
        self._cases = pickle.dumps(tuple(cases))

    def fly(self, population: Population, some: slice = slice(None)) -> list[Floats]:
        """Return the metrics (members, starts, columns) of each case, or of some."""
        n = len(population.scales)
        outcomes = [np.empty((n, *shape)) for shape in self._shapes[some]]
        size = -(-n // (SHARES * pool.threads(self._client)))
        calls = (
            (first, (self._cases, population.members(slice(first, first + size)), some))
            for first in range(0, n, size)
        )
        for first, rows in pool.results(self._client, fly_remote, calls):
            for outcome, part in zip(outcomes, rows, strict=True):
                outcome[first : first + len(part)] = part
        return outcomes
