# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What an axis that is proven alone takes from those that were proven before it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rpo_proof import probing
from rpo_proof.apart import ALONE, Beside
from rpo_proof.cells import Found
from rpo_proof.problem import APART, Problem

Floats = NDArray[np.float64]

FLIGHTS, SEED = 200, 7
"""Flights whose states are the corridor."""

WIDER, MARGIN = 1.2, (1.5, 0.03)
"""The corridor is so many times as wide, and wider by so much [m], [m/s]. Through Coriolis y feels
the velocity; positions may be far."""


def around_of(
    problem: Problem, group: str, groups: Mapping[str, Found]
) -> tuple[Floats | None, Beside]:
    """Return what a group adds to, and what is beside it; groups : those that are proven."""
    tails = [found.tail for found in groups.values()]
    above = tails[0] if tails else None
    if len(tails) > 1:  # of each, the greatest of all units
        above = np.sum([tail.max(axis=0, keepdims=True) for tail in tails], axis=0)
    if group == 'y':
        return above, Beside(_corridor(problem.texts), None)
    if group == 'x':
        return above, Beside(groups['y'].reach, _corridor(problem.texts))
    return above, ALONE


@lru_cache(maxsize=2)
def _corridor(texts: tuple[str, str, str]) -> Floats:
    """Return the corridor of x: (2, N+1, 2). What it is matters not for what follows from it."""
    problem = Problem.of_texts(texts)
    rng, chosen = np.random.default_rng(SEED), list(APART['x'])
    low, high = np.full((2, 1, 2), [[[np.inf]], [[-np.inf]]])
    for start in probing.anywhere(problem, FLIGHTS, SEED):
        states = probing.fly(problem, probing.varied(problem, rng, start)).states[:, chosen]
        low, high = np.minimum(low, states), np.maximum(high, states)
    half = 0.5 * WIDER * (high - low) + np.array(MARGIN)
    middle = 0.5 * (low + high)
    return np.array([middle - half, middle + half])
