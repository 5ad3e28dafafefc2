# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Making a proof: cells on all cores, then the claims. Estimates from a sample."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rpo.montecarlo import pool
from rpo.proof import flights
from rpo.proof.cells import CellBounds, Prover, Targets, roots
from rpo.proof.certificate import REFUTED
from rpo.proof.claims import (
    BOUNDS,
    Claim,
    Range,
    bound_of,
    claims_of,
    empty_set,
    of_planar,
    ranges_of,
    requirements_of,
    summary_of,
)
from rpo.proof.flights import context_of
from rpo.proof.folder import Folder, joined
from rpo.proof.invariant import invariant_set_of
from rpo.proof.problem import Problem

UNIT, UNIT_PER_AXIS = 25, 1
"""First cells of a unit; in a proof per axis, each has many cells."""

PROBES, SUSPECTS = 2000, 200
"""Flights before the proof, from anywhere, and after it for each claim, from the worst cells."""

PROBES_OF_ESTIMATE = 100

SEED = 1

Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Outcome:
    """A finished proof.

    ranges : what the tubes say beside the claims
    resumed : group -> units of an earlier call, and all
    """

    claims: list[Claim]
    ranges: dict[str, Range]
    resumed: dict[str, tuple[int, int]]


def prove(folder: Folder, workers: int, progress: Progress, probes: int = PROBES) -> Outcome:
    """Make the proof of a folder, from where it was interrupted.

    workers : threads; 0, one per core
    probes : flights from anywhere, before
    """
    problem = folder.problem
    folder.put_table()
    limits = problem.limits
    speed = limits.get('hold_speed_per_axis_m_s')
    omega = invariant_set_of(problem, problem.hold_error_m, speed)
    asked = omega or empty_set(problem)
    flown = flights.probe(problem, flights.random_starts(problem, probes, SEED), SEED)
    refuted = {key for key, (value, _, _) in flown.items() if value > limits[key]}
    groups: dict[str, CellBounds] = {}
    resumed: dict[str, tuple[int, int]] = {}
    targets = targets_of(problem, refuted) if set(requirements_of(problem)) - refuted else None
    for group in problem.groups:
        prover = Prover(problem, group, asked, *context_of(problem, group, groups))
        groups[group], resumed[group] = _cells(folder, prover, targets, workers, progress)
    for claim in claims_of(problem, groups, omega, flown):
        if claim.bound > claim.limit >= claim.found:
            progress('looking for a counterexample', 0, SUSPECTS)
            starts = flights.worst_starts(problem, groups, claim.key, SUSPECTS, SEED)
            flown = flights.probe(problem, starts, SEED, flown)
    claims = claims_of(problem, groups, omega, flown)
    ranges = ranges_of(problem, groups)
    for claim in claims:
        if claim.key in flown:
            folder.put_flight(claim.key, claim.verdict == REFUTED, flown[claim.key][2])
    folder.finish(groups, summary_of(claims, omega, ranges, groups))
    return Outcome(claims, ranges, resumed)


def targets_of(problem: Problem, refuted: set[str]) -> Targets:
    """Return what tubes should show; nothing of what is refuted already."""
    keys = {column: key for key, (column, _) in BOUNDS.items() if key not in refuted}
    return Targets(*(problem.limits.get(keys.get(name, ''), np.inf) for name in Targets._fields))


def _cells(
    folder: Folder, prover: Prover, targets: Targets | None, workers: int, progress: Progress
) -> tuple[CellBounds, tuple[int, int]]:
    """Return all cells of a group, and how many units of all are of an earlier call."""
    problem, group = prover.problem, prover.group
    cells, size = roots(problem, group), UNIT_PER_AXIS if problem.settings.axes_apart else UNIT
    units = [cells[first : first + size] for first in range(0, len(cells), size)]
    parts = {unit: folder.done(group, unit) for unit in range(len(units))}
    pending = [unit for unit, bounds in parts.items() if bounds is None]
    resumed = finished = len(units) - len(pending)
    progress(f'{group} cells', finished * size, len(cells))
    calls = ((unit, (units[unit], targets)) for unit in pending)
    for unit, bounds in pool.run(prover.prove, calls, workers):
        folder.put(group, unit, bounds)
        parts[unit] = bounds
        finished += 1
        progress(f'{group} cells', min(finished * size, len(cells)), len(cells))
    every = joined(part for part in parts.values() if part is not None)
    return every, (resumed, len(units))


class Estimate(NamedTuple):
    """What was found in some of the first cells: the planar ones, or those of x.

    cells, sampled : first cells in all, and those that were proven
    tubes, seconds : of these, in all
    hours : of one core for all first cells of all groups
    open_cells, bounds, flown : requirement -> first cells that stay open, largest bound of all
        cells, greatest value of some flights from anywhere in the box
    never_inside : first cells of which some tube does not enter the invariant set
    """

    cells: int
    sampled: int
    tubes: int
    seconds: float
    open_cells: dict[str, int]
    bounds: dict[str, float]
    flown: dict[str, float]
    never_inside: int
    hours: float


def estimate(problem: Problem, count: int, progress: Progress) -> Estimate:
    """Prove some first cells of each group, drawn at random; return what they say of all."""
    limits = {key: limit for key, limit in problem.limits.items() if key in BOUNDS}
    omega = invariant_set_of(problem, problem.hold_error_m, limits.get('hold_speed_per_axis_m_s'))
    flown = flights.probe(problem, flights.random_starts(problem, PROBES_OF_ESTIMATE, SEED), SEED)
    values = {key: value for key, (value, _, _) in flown.items()}
    targets = targets_of(problem, {key for key in values if values[key] > limits[key]})
    groups: dict[str, CellBounds] = {}
    parts: list[CellBounds] = []
    total, seconds, hours = 0, 0.0, 0.0
    for group in problem.groups:
        around = context_of(problem, group, groups)
        prover = Prover(problem, group, omega or empty_set(problem), *around)
        every = roots(problem, group)
        chosen = np.random.default_rng(SEED).permutation(len(every))[:count].tolist()
        prover.fly(every[0])  # the kernels are compiled before the time is taken
        began, parts = time.process_time(), []
        for number, k in enumerate(chosen):
            progress(f'some {group} cells', number, len(chosen))
            parts.append(prover.prove([every[k]], targets))
        seconds, total = time.process_time() - began, len(every)
        hours += seconds / len(parts) * total / 3600.0
        groups[group] = joined(parts)
    each = [{**groups, group: part} for part in parts]
    return Estimate(
        total,
        len(parts),
        sum(2 * len(part.values) - 1 for part in parts),
        seconds,
        {key: sum(bool((of_planar(g, key) > limits[key]).any()) for g in each) for key in limits},
        {key: bound_of(problem, groups, omega, key) for key in limits},
        values,
        sum(not bool(np.isfinite(part.column('inside_s')).all()) for part in parts),
        hours,
    )
