# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Making a proof: units of cells on all cores or a cluster, then the claims."""

from __future__ import annotations

import os
import pickle
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_judge.analysis.certificate import REFUTED
from rpo_montecarlo.cluster import pool
from rpo_proof import probing
from rpo_proof.apart import Beside
from rpo_proof.cells import Cell, Found, Targets, roots
from rpo_proof.claims import Claim, Range, asked_of, claims_of, nowhere, ranges_of, summary_of
from rpo_proof.corridor import around_of
from rpo_proof.folder import Folder, joined
from rpo_proof.problem import HOLD, Problem
from rpo_proof.prover import Prover
from rpo_proof.rest import rest_of
from rpo_proof.sets import Rest

UNIT, UNIT_APART = 25, 1
"""First cells of a unit; where axes are apart, each has many cells."""

PROBES, SUSPECTS = 2000, 200
"""Flights before the proof, from anywhere, and after it for each claim, from the worst cells."""

SEED = 1

Progress = Callable[[str, int, int], None]


class Work(NamedTuple):
    """The cells of a group that are to be proven; see `Prover`."""

    problem: Problem
    group: str
    rest: Rest
    targets: Targets | None
    above: NDArray[np.float64] | None
    beside: Beside


@dataclass(frozen=True)
class Outcome:
    """A finished proof.

    ranges : what the tubes say beside the claims
    counterexamples : requirements that a flight breaks
    taken : group -> units of an earlier call, and all
    """

    claims: list[Claim]
    ranges: dict[str, Range]
    counterexamples: list[str]
    taken: dict[str, tuple[int, int]]


def prove(
    folder: Folder, workers: int, address: str, progress: Progress, probes: int = PROBES
) -> Outcome:
    """Make the proof of a folder, from where it was interrupted.

    workers : threads, or processes of a local cluster; 0, one per core
    address : of a cluster: '', on threads; 'local'; that of a scheduler
    probes : flights from anywhere, before
    """
    problem = folder.problem
    folder.put_table()
    limits = problem.limits
    speed = limits.get('hold_speed_per_axis_m_s')
    rest = rest_of(problem, problem.hold_error_m, speed)
    asked = rest or nowhere(problem)
    flown = probing.probe(problem, probing.anywhere(problem, probes, SEED), SEED)
    refuted = {key for key, (value, _, _) in flown.items() if value > limits[key]}
    groups: dict[str, Found] = {}
    taken: dict[str, tuple[int, int]] = {}
    targets = targets_of(problem, refuted) if set(asked_of(problem)) - refuted else None
    for group in problem.groups:
        around = around_of(problem, group, groups)
        work = Work(problem, group, asked, targets, *around)
        groups[group], taken[group] = _cells(folder, work, workers, address, progress)
    flown = _suspected(problem, groups, rest, flown, progress)
    values = {key: (value, start) for key, (value, start, _) in flown.items()}
    claims = claims_of(problem, groups, rest, values)
    ranges = ranges_of(problem, groups)
    for claim in claims:
        if claim.key in flown:
            folder.put_flight(claim.key, claim.verdict == REFUTED, flown[claim.key][2])
    folder.finish(groups, summary_of(claims, rest, ranges, groups))
    return Outcome(claims, ranges, [c.key for c in claims if c.verdict == REFUTED], taken)


def targets_of(problem: Problem, refuted: set[str]) -> Targets:
    """Return what tubes should show; nothing of what is refuted already."""
    limits = {k: v for k, v in problem.limits.items() if k not in refuted}
    keys = (
        HOLD,
        'hold_speed_per_axis_m_s',
        'mean_error_norm_m',
        'mean_speed_norm_m_s',
        'slew_per_axis_n_s',
    )
    return Targets(*(limits.get(key, np.inf) for key in keys))


def _suspected(
    problem: Problem,
    groups: dict[str, Found],
    rest: Rest | None,
    flown: probing.Flown,
    progress: Progress,
) -> probing.Flown:
    """Fly from the worst cells of the claims that are open; return the greatest values."""
    values = {key: (value, start) for key, (value, start, _) in flown.items()}
    for claim in claims_of(problem, groups, rest, values):
        if claim.bound > claim.limit >= claim.found:
            progress('looking for a counterexample', 0, SUSPECTS)
            starts = probing.suspects(problem, groups, claim.key, SUSPECTS, SEED)
            flown = probing.merged(flown, probing.probe(problem, starts, SEED))
    return flown


def _cells(
    folder: Folder, work: Work, workers: int, address: str, progress: Progress
) -> tuple[Found, tuple[int, int]]:
    """Return all cells of a group, and how many units of all are of an earlier call."""
    group, cells = work.group, roots(work.problem, work.group)
    size = UNIT_APART if work.problem.settings.axes_apart else UNIT
    units = [cells[first : first + size] for first in range(0, len(cells), size)]
    parts = {unit: folder.done(group, unit) for unit in range(len(units))}
    pending = [unit for unit, found in parts.items() if found is None]
    taken = finished = len(units) - len(pending)
    progress(f'{group} cells', finished * size, len(cells))
    make = _on_cluster if address else _on_threads
    for unit, found in make(work, units, pending, workers, address):
        folder.put(group, unit, found)
        parts[unit] = found
        finished += 1
        progress(f'{group} cells', min(finished * size, len(cells)), len(cells))
    every = joined(part for part in parts.values() if part is not None)
    return every, (taken, len(units))


Source = Iterator[tuple[int, Found]]


def _on_threads(
    work: Work, units: Sequence[list[Cell]], pending: Sequence[int], workers: int, _: str
) -> Source:
    """Yield units as they are finished."""
    prover = Prover(work.problem, work.group, work.rest, work.above, work.beside)
    workers = workers or len(os.sched_getaffinity(0))
    executor = ThreadPoolExecutor(workers, 'rpo-prove')
    todo, under_way = iter(pending), dict[Future[Found], int]()
    try:
        while True:
            for unit in islice(todo, 2 * workers - len(under_way)):
                under_way[executor.submit(prover.prove, units[unit], work.targets)] = unit
            if not under_way:
                return
            done, _pending = wait(under_way, return_when=FIRST_COMPLETED)
            for future in done:
                yield under_way.pop(future), future.result()
    finally:
        executor.shutdown(cancel_futures=True)


@lru_cache(maxsize=2)
def _prover(texts: tuple[str, str, str], group: str, rest: Rest, around: bytes) -> Prover:
    return Prover(Problem.of_texts(texts), group, rest, *pickle.loads(around))


def prove_remote(
    texts: tuple[str, str, str],
    group: str,
    rest: Rest,
    around: bytes,
    cells: list[Cell],
    targets: Targets | None,
) -> Found:
    """Prove a unit on a worker."""
    return _prover(texts, group, rest, around).prove(cells, targets)


def _on_cluster(
    work: Work, units: Sequence[list[Cell]], pending: Sequence[int], workers: int, address: str
) -> Source:
    """Yield units as they come in."""
    around = pickle.dumps((work.above, work.beside))
    same = work.problem.texts, work.group, work.rest, around
    calls = ((unit, (*same, units[unit], work.targets)) for unit in pending)
    with pool.connected(address, workers or len(os.sched_getaffinity(0))) as client:
        yield from pool.results(client, prove_remote, calls)
