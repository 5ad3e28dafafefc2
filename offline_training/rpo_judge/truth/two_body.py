# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Truths that fly the same forces as the plant, open loop, under true gravity.

The target follows its orbit, a circle or that of section `dynamics`; the chaser is under gravity,
and J2 and drag where the scenario has them, and forces held for a tick in the axes of
`target_lvlh`, to which its body axes stay parallel.

Target and relative motion are integrated in inertial axes (`rpo_judge.truth.inertial`), by SciPy's
DOP853. In a checkout `tools.basilisk` is another truth, with nothing in common.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.flight import Flight
from rpo_core.files.scenario import Scenario
from rpo_core.world import cw
from rpo_judge.truth.inertial import World, integrate

Floats = NDArray[np.float64]
Truth = Callable[[Scenario, Floats, Floats], Floats]
"""From a scenario, the forces (N, 3) [N] applied in its ticks and the masses (N,) [kg] that they
move to the states (N + 1, 6)."""

DISTANCES_M = (10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)
AXIS_NAMES = ('R-bar', 'V-bar', 'H-bar')


def total_forces_n(flight: Flight) -> Floats:
    """Return the forces (N, 3) on the chaser in each tick: of the thrusters, and disturbance.

    The commands are those of the flight; the controller does not run again.
    """
    return np.asarray(flight.thrust.forces_n + flight.disturbances_n[:-1])


def by_scipy(scenario: Scenario, forces_n: Floats, masses_kg: Floats) -> Floats:
    """Return the states (N + 1, 6) under forces (N, 3), by DOP853 from tick to tick."""
    world, states = World(scenario), [np.array(scenario.start)]
    target = world.target()
    y = np.concatenate([target, world.to_inertial(target, states[0])])
    for tick, (force, mass_kg) in enumerate(zip(forces_n, masses_kg.tolist(), strict=True)):

        def rate(_t_s: float, y: Floats, force: Floats = force, mass_kg: float = mass_kg) -> Floats:
            return world.rate(y, force, mass_kg)

        y = integrate(rate, scenario.time_s(tick), scenario.time_s(tick + 1), y)
        states.append(world.to_lvlh(y[:6], y[6:]))
    return np.array(states)


class Growth(NamedTuple):
    """Error of the linear plant [m, m/s] after drifting freely from rest, at one distance.

    position_m, velocity_m_s : (3,) start along R-bar, V-bar, H-bar
    """

    distance_m: float
    position_m: Floats
    velocity_m_s: Floats


def drift_errors(scenario: Scenario, duration_s: float) -> list[Growth]:
    """Return how the error of the linear plant on a circle grows with the distance of the start."""
    plain = replace(scenario, sections=())
    world, rest = World(plain), np.zeros(3)
    linear, _ = cw.matrices(cw.discretise(plain.mean_motion_rad_s, plain.mass_kg, duration_s))
    target, found = world.target(), []
    for distance in DISTANCES_M:
        errors = []
        for axis in range(3):
            start = np.zeros(6)
            start[axis] = distance
            y = np.concatenate([target, world.to_inertial(target, start)])
            y = integrate(lambda _t_s, y: world.rate(y, rest, plain.mass_kg), 0.0, duration_s, y)
            errors.append(linear @ start - world.to_lvlh(y[:6], y[6:]))
        parts = np.array(errors).reshape(3, 2, 3)
        norms = np.linalg.norm(parts, axis=2)
        found.append(Growth(distance, norms[:, 0], norms[:, 1]))
    return found


SHOWN = 8
"""Moments in the table of a flight."""


@dataclass(frozen=True)
class Comparison:
    """A flight beside truths.

    errors : name of the truth -> states of the plant less true ones (N + 1, 6)
    disagreement_m : largest distance between two truths; None if there is only one
    """

    title: str
    scenario: Scenario
    errors: Mapping[str, Floats]
    disagreement_m: float | None
    growth: tuple[Growth, ...]

    @property
    def plant(self) -> str:
        """What the plant is called: linear, without section `dynamics`."""
        settings = self.scenario.dynamics
        return 'linear' if settings is None else settings.kind

    def moments(self) -> Iterator[tuple[Any, ...]]:
        """Yield time [s], then per truth the errors of position [m] and velocity [m/s]."""
        ticks = self.scenario.ticks
        for index in range(1, min(SHOWN, ticks) + 1):
            tick = index * ticks // min(SHOWN, ticks)
            yield (
                self.scenario.time_s(tick),
                *(
                    tuple(float(np.linalg.norm(part)) for part in np.split(e[tick], 2))
                    for e in self.errors.values()
                ),
            )


def compare(flight: Flight, title: str, truths: Mapping[str, Truth]) -> Comparison:
    """Fly the forces of a flight under true gravity, by truths that have what acts."""
    scenario, forces, masses = flight.scenario, total_forces_n(flight), flight.thrust.masses_kg
    true = {name: by(scenario, forces, masses) for name, by in truths.items()}
    disagreement_m = None
    if len(true) == 2:
        first, second = true.values()
        disagreement_m = float(np.linalg.norm((first - second)[:, :3], axis=1).max())
    errors = {name: flight.states - states for name, states in true.items()}
    growth = tuple(drift_errors(scenario, scenario.duration_s))
    return Comparison(title, scenario, errors, disagreement_m, growth)
