# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flights from the box of starts: worst values, counterexamples, and the corridor of x."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import lru_cache

import numpy as np

from rpo.proof.cells import CellBounds
from rpo.proof.claims import Groups, of_planar, values_of
from rpo.proof.per_axis import UNCOUPLED, OtherAxis
from rpo.proof.problem import PER_AXIS, Problem
from rpo_core.chain.flight import JUDGED, fly
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario
from rpo_core.world.disturbance import Disturbance

Flown = dict[str, tuple[float, tuple[float, ...], Scenario]]
"""Requirement -> greatest value, start (6,) and scenario of that flight."""


def vary(problem: Problem, rng: np.random.Generator, start: Floats) -> Scenario:
    """Return the scenario from a start, with what may differ drawn at random.

    In every second flight constants, amplitudes and the mass are as far out as they may be.
    """
    base, settings = problem.scenario.starting_at(start.tolist()), problem.settings
    far = rng.random() < 0.5

    def share() -> float:
        drawn = float(rng.uniform(-1.0, 1.0))
        return math.copysign(1.0, drawn) if far else drawn

    mass = base.mass_kg * (1.0 + settings.mass_share * share())
    disturbance, factor = base.disturbance, settings.disturbance_share
    if factor > 0.0:
        cx, cy, cz = (factor * c * share() for c in disturbance.constant_n)
        harmonics = tuple(
            replace(
                h,
                amplitude_n=h.amplitude_n * factor * abs(share()) ** 0.5,
                phase_rad=float(rng.uniform(0.0, 6.28)),
            )
            for h in disturbance.harmonics
        )
        disturbance = Disturbance((cx, cy, cz), harmonics)
    return replace(base, mass_kg=mass, disturbance=disturbance)


def probe(
    problem: Problem, starts: Iterator[Floats], seed: int, before: Flown | None = None
) -> Flown:
    """Fly from starts (6,); return the greatest value of each claim, of those before too."""
    rng, worst = np.random.default_rng(seed), dict(before or {})
    for start in starts:
        scenario = vary(problem, rng, start)
        flight = fly(scenario, problem.controller, kept=JUDGED)
        for key, value in values_of(problem, flight).items():
            if key not in worst or value > worst[key][0]:
                worst[key] = value, scenario.start, scenario
    return worst


def random_starts(problem: Problem, count: int, seed: int) -> Iterator[Floats]:
    """Yield random starts of the box: first corners, then every second one on an edge.

    On an edge two of the three positions are as far out as they can be: there flights last longest.
    """
    rng = np.random.default_rng(seed)
    centre, half = np.array(problem.settings.centre), np.array(problem.settings.half)
    for number in range(count):
        share = rng.uniform(-1.0, 1.0, 6)
        if number < 8:
            share = np.where(np.arange(6) % 3 == 0, 1.0, 1.0 - 2.0 * (number >> np.arange(6) & 1))
        elif number % 2:
            outside = [number % 3, (number + 1) % 3]
            share[outside] = np.sign(share[outside])
        yield centre + half * share


def worst_starts(
    problem: Problem, groups: Groups, key: str, count: int, seed: int
) -> Iterator[Floats]:
    """Yield starts from the planar and the vertical cells whose bounds of a claim are greatest."""
    rng = np.random.default_rng(seed)
    column = 'slew_n_s' if key == 'slew_per_axis_n_s' else 'mean_error_m'
    orders = {name: np.argsort(bounds.column(column))[::-1] for name, bounds in groups.items()}
    orders[list(groups)[-1]] = np.argsort(of_planar(groups, key))[::-1]
    for number in range(count):
        start = np.zeros(6)
        for name, order in orders.items():
            bounds, cell = groups[name], order[(number // 4) % len(order)]
            chosen = list(problem.groups[name])
            share = rng.uniform(-1.0, 1.0, len(chosen))
            size = bounds.half[cell][: len(chosen)]
            start[chosen] = bounds.centre[cell][: len(chosen)] + share * size
        yield start


FLIGHTS, SEED = 200, 7
"""Flights whose states are the corridor."""

WIDER, MARGIN = 1.2, (1.5, 0.03)
"""The corridor is so many times as wide, and wider by so much [m], [m/s]. Through Coriolis y feels
the velocity; positions may be far."""


def context_of(
    problem: Problem, group: str, groups: Mapping[str, CellBounds]
) -> tuple[Floats | None, OtherAxis]:
    """Return what a group adds to, and what is beside it; groups : those that are proven."""
    tails = [found.tail for found in groups.values()]
    above = tails[0] if tails else None
    if len(tails) > 1:  # of each, the greatest of all units
        above = np.sum([tail.max(axis=0, keepdims=True) for tail in tails], axis=0)
    if group == 'y':
        return above, OtherAxis(_corridor(problem.texts), None)
    if group == 'x':
        return above, OtherAxis(groups['y'].reach, _corridor(problem.texts))
    return above, UNCOUPLED


@lru_cache(maxsize=2)
def _corridor(texts: tuple[str, str, str]) -> Floats:
    """Return the corridor of x: (2, N+1, 2). What it is matters not for what follows from it."""
    problem = Problem.of_texts(texts)
    rng, chosen = np.random.default_rng(SEED), list(PER_AXIS['x'])
    low, high = np.full((2, 1, 2), [[[np.inf]], [[-np.inf]]])
    for start in random_starts(problem, FLIGHTS, SEED):
        states = fly(vary(problem, rng, start), problem.controller).states[:, chosen]
        low, high = np.minimum(low, states), np.maximum(high, states)
    half = 0.5 * WIDER * (high - low) + np.array(MARGIN)
    middle = 0.5 * (low + high)
    return np.array([middle - half, middle + half])
