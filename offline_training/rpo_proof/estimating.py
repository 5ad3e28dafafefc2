# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a proof would cost, and where it would stay open: from some first cells, at random."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rpo_proof import probing
from rpo_proof.cells import Found, roots
from rpo_proof.claims import BOUNDS, bound_of, nowhere, of_planar
from rpo_proof.corridor import around_of
from rpo_proof.folder import joined
from rpo_proof.problem import Problem
from rpo_proof.prover import Prover
from rpo_proof.proving import targets_of
from rpo_proof.rest import rest_of

PROBES = 100
SEED = 1

Progress = Callable[[str, int, int], None]


class Estimate(NamedTuple):
    """What was found in some of the first cells: the planar ones, or those of x.

    cells, sampled : first cells in all, and those that were proven
    tubes, seconds : of these, in all
    hours : of one core for all first cells of all groups
    open_cells, bounds, flown : requirement -> first cells that stay open, largest bound of all
        cells, greatest value of some flights from anywhere in the box
    restless : first cells of which some tube does not come to rest
    """

    cells: int
    sampled: int
    tubes: int
    seconds: float
    open_cells: dict[str, int]
    bounds: dict[str, float]
    flown: dict[str, float]
    restless: int
    hours: float


def estimate(problem: Problem, count: int, progress: Progress) -> Estimate:
    """Prove some first cells of each group, drawn at random; return what they say of all."""
    limits = {key: limit for key, limit in problem.limits.items() if key in BOUNDS}
    rest = rest_of(problem, problem.hold_error_m, limits.get('hold_speed_per_axis_m_s'))
    flown = probing.probe(problem, probing.anywhere(problem, PROBES, SEED), SEED)
    values = {key: value for key, (value, _, _) in flown.items()}
    targets = targets_of(problem, {key for key in values if values[key] > limits[key]})
    groups: dict[str, Found] = {}
    parts: list[Found] = []
    total, seconds, hours = 0, 0.0, 0.0
    for group in problem.groups:
        around = around_of(problem, group, groups)
        prover = Prover(problem, group, rest or nowhere(problem), *around)
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
        {key: bound_of(problem, groups, rest, key) for key in limits},
        values,
        sum(not bool(np.isfinite(part.column('rest_s')).all()) for part in parts),
        hours,
    )
