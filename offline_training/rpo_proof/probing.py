# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flights from the box of starts: what they reach, and counterexamples to claims."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.flight import Flight
from rpo_core.files.scenario import Scenario
from rpo_core.world.disturbance import Disturbance
from rpo_proof import flights
from rpo_proof.claims import Groups, of_planar, values_of
from rpo_proof.problem import Problem

Floats = NDArray[np.float64]
Flown = dict[str, tuple[float, tuple[float, ...], Scenario]]
"""Requirement -> greatest value, start (6,) and scenario of that flight."""


def varied(problem: Problem, rng: np.random.Generator, start: Floats) -> Scenario:
    """Return the scenario from a start, with what may differ drawn at random.

    In every second flight constants, amplitudes and the mass are as far out as they may be.
    """
    base, settings = problem.scenario, problem.settings
    x, y, z, vx, vy, vz = start.tolist()
    far = rng.random() < 0.5

    def share() -> float:
        drawn = float(rng.uniform(-1.0, 1.0))
        return math.copysign(1.0, drawn) if far else drawn

    mass = base.mass_kg * (1.0 + settings.mass_share * share())
    disturbance, most = base.disturbance, settings.disturbance_share
    if most > 0.0:
        cx, cy, cz = (most * c * share() for c in disturbance.constant_n)
        harmonics = tuple(
            replace(
                h,
                amplitude_n=h.amplitude_n * most * abs(share()) ** 0.5,
                phase_rad=float(rng.uniform(0.0, 6.28)),
            )
            for h in disturbance.harmonics
        )
        disturbance = Disturbance((cx, cy, cz), harmonics)
    return replace(
        base,
        initial_position_m=(x, y, z),
        initial_velocity_m_s=(vx, vy, vz),
        mass_kg=mass,
        disturbance=disturbance,
    )


def fly(problem: Problem, scenario: Scenario) -> Flight:
    """Return a flight; its bits are those of `rpo simulate`."""
    ticks, controller = scenario.ticks, problem.controller
    states, forces = np.zeros((ticks + 1, 6)), np.zeros((ticks + 1, 3))
    states[0] = scenario.start
    disturbances = np.zeros((ticks + 1, 3))
    if not scenario.disturbance.is_zero:
        disturbances = scenario.disturbance.over(scenario.times_s)
    flights.fly(
        controller.scales,
        controller.system.tables,
        scenario.max_force_n,
        scenario.step,
        disturbances,
        states,
        forces,
    )
    return Flight(scenario, states, forces, disturbances)


def probe(problem: Problem, starts: Iterator[Floats], seed: int) -> Flown:
    """Fly from starts (6,); return the greatest value of each claim."""
    rng, found = np.random.default_rng(seed), dict[str, tuple[float, tuple[float, ...], Scenario]]()
    for start in starts:
        scenario = varied(problem, rng, start)
        flight = fly(problem, scenario)
        for key, value in values_of(problem, flight).items():
            if key not in found or value > found[key][0]:
                found[key] = value, scenario.start, scenario
    return found


def anywhere(problem: Problem, count: int, seed: int) -> Iterator[Floats]:
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


def suspects(problem: Problem, groups: Groups, key: str, count: int, seed: int) -> Iterator[Floats]:
    """Yield starts from the planar and the vertical cells whose bounds of a claim are greatest."""
    rng = np.random.default_rng(seed)
    column = 'slew_n_s' if key == 'slew_per_axis_n_s' else 'mean_error_m'
    orders = {name: np.argsort(found.column(column))[::-1] for name, found in groups.items()}
    orders[list(groups)[-1]] = np.argsort(of_planar(groups, key))[::-1]
    for number in range(count):
        start = np.zeros(6)
        for name, order in orders.items():
            found, cell = groups[name], order[(number // 4) % len(order)]
            chosen = list(problem.groups[name])
            share = rng.uniform(-1.0, 1.0, len(chosen))
            size = found.half[cell][: len(chosen)]
            start[chosen] = found.centre[cell][: len(chosen)] + share * size
        yield start


def merged(first: Flown, second: Flown) -> Flown:
    """Return the greater of both, claim by claim."""
    found = dict(first)
    for key, item in second.items():
        if key not in found or item[0] > found[key][0]:
            found[key] = item
    return found
