# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""True gravity: the forces of a flight, flown again open loop beside the target's orbit.

The target follows its orbit, a circle or that of section `dynamics`; the chaser is under gravity,
and J2 and drag where the scenario has them, and forces held for a tick in the axes of
`target_lvlh`, to which its body axes stay parallel.

Target and relative motion are integrated in inertial axes by SciPy's DOP853: z is the pole of the
body, x the ascending node. Nothing is shared with `rpo_core.world.dynamics`. Without section
`dynamics` the target is on a circle in the plane of x and y. `analysis.basilisk` is another truth,
with nothing in common.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rpo_core.attitude.target import motion_of
from rpo_core.chain.flight import Flight
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario
from rpo_core.world import cw
from rpo_core.world.dynamics import Dynamics

_TOLERANCE = 1e-13
_CIRCLE = Dynamics(kind='two_body')


def cross(a: Floats, b: Floats) -> Floats:
    """Return a x b; np.cross takes five times as long."""
    (ax, ay, az), (bx, by, bz) = a, b
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def encke(offset_m: Floats, target_m: Floats, mu_m3_s2: float = cw.MU_EARTH_M3_S2) -> Floats:
    """Return the gravity (3,) [m/s^2] at the chaser less that at the target, without cancellation.

    Battin, An Introduction to the Mathematics and Methods of Astrodynamics (1999), section 8.7:
    -mu/R^3 (d + F(q) r), r = R + d, q = d.(d - 2 r)/r^2, F = q (3 + 3 q + q^2)/(1 + (1 + q)^(3/2)).
    """
    chaser = target_m + offset_m
    q = offset_m @ (offset_m - 2.0 * chaser) / (chaser @ chaser)
    f = q * (3.0 + q * (3.0 + q)) / (1.0 + (1.0 + q) ** 1.5)
    radius = math.sqrt(target_m @ target_m)
    return np.asarray(-mu_m3_s2 / radius**3 * (offset_m + f * chaser))


class World:
    """What acts on both spacecraft of a scenario."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self.settings = scenario.dynamics or _CIRCLE
        self.body, self.drag = scenario.body, self.settings.drag

    def perturbation(self, position: Floats, velocity: Floats, coefficient: float) -> Floats:
        """Return the acceleration (3,) beside point-mass gravity: J2 and drag."""
        accel = np.zeros(3)
        radius = math.sqrt(position @ position)
        if self.settings.j2:
            body, sine2 = self.body, (position[2] / radius) ** 2
            factor = 1.5 * body.j2 * body.mu_m3_s2 * body.equator_m**2 / radius**5
            accel = factor * position * (np.array([5.0, 5.0, 5.0]) * sine2 - [1.0, 1.0, 3.0])
        drag = self.drag
        if drag is None:
            return accel
        x, y, _ = position
        wind = velocity - drag.atmosphere_rate_rad_s * np.array([-y, x, 0.0])
        density = drag.density_kg_m3
        if drag.scale_height_m is not None:
            sea_m = drag.density_radius_m or self.scenario.orbit_radius_m
            height_m = radius - sea_m
            density *= math.exp(-height_m / drag.scale_height_m)
        return accel - 0.5 * density / coefficient * math.sqrt(wind @ wind) * wind

    def of_target(self, target: Floats) -> Floats:
        """Return the target's acceleration (3,) beside point-mass gravity."""
        coefficient = self.drag.target_ballistic_coefficient_kg_m2 if self.drag else 1.0
        return self.perturbation(target[:3], target[3:], coefficient)

    def target(self) -> Floats:
        """Return the target's state (6,) at tick 0, from its orbital elements."""
        s, mu = self.settings, self.body.mu_m3_s2
        anomaly, argument, tilt = (
            math.radians(angle or 0.0)
            for angle in (s.true_anomaly_deg, s.argument_of_periapsis_deg, s.inclination_deg)
        )
        p = self.scenario.orbit_radius_m * (1.0 - s.eccentricity**2)
        radius, speed = p / (1.0 + s.eccentricity * math.cos(anomaly)), math.sqrt(mu / p)
        node = np.array([1.0, 0.0, 0.0])
        up = np.array([0.0, math.cos(tilt), math.sin(tilt)])
        periapsis = math.cos(argument) * node + math.sin(argument) * up
        ahead = -math.sin(argument) * node + math.cos(argument) * up
        out = math.cos(anomaly) * periapsis + math.sin(anomaly) * ahead
        velocity = -math.sin(anomaly) * periapsis + (s.eccentricity + math.cos(anomaly)) * ahead
        return np.concatenate([radius * out, speed * velocity])

    def frame(self, target: Floats) -> tuple[Floats, Floats]:
        """Return the axes of LVLH as columns (3, 3), and its angular velocity (3,)."""
        position, velocity = target[:3], target[3:]
        momentum = cross(position, velocity)
        r, h = math.sqrt(position @ position), math.sqrt(momentum @ momentum)
        x, z = position / r, momentum / h
        axes = np.column_stack([x, cross(z, x), z])
        return axes, h / (r * r) * z + (r / h) * (self.of_target(target) @ z) * x

    def to_inertial(self, target: Floats, state: Floats) -> Floats:
        """Return relative position and velocity (6,), inertial, of an LVLH state (6,)."""
        axes, rate = self.frame(target)
        position = axes @ state[:3]
        return np.concatenate([position, axes @ state[3:] + cross(rate, position)])

    def to_lvlh(self, target: Floats, relative: Floats) -> Floats:
        """Undo `to_inertial`."""
        axes, rate = self.frame(target)
        position = relative[:3]
        velocity = axes.T @ (relative[3:] - cross(rate, position))
        return np.concatenate([axes.T @ position, velocity])

    def rate(self, y: Floats, force_n: Floats, mass_kg: float) -> Floats:
        """Return the derivative of target and relative state (12,), force in axes of LVLH."""
        position, velocity, offset, drift = y[:3], y[3:6], y[6:9], y[9:]
        mu, radius = self.body.mu_m3_s2, math.sqrt(position @ position)
        disturbed = self.of_target(y[:6])
        change = encke(offset, position, mu) - disturbed
        coefficient = 1.0
        if self.drag:
            share = mass_kg / self.scenario.mass_kg
            coefficient = self.drag.chaser_ballistic_coefficient_kg_m2 * share
        change = change + self.perturbation(position + offset, velocity + drift, coefficient)
        if force_n.any():
            change = change + self.frame(y[:6])[0] @ force_n / mass_kg
        return np.concatenate([velocity, disturbed - mu / radius**3 * position, drift, change])


def integrate(
    rate: Callable[[float, Floats], Floats], begin_s: float, end_s: float, y: Floats
) -> Floats:
    """Return the state at the end, by DOP853."""
    options = {'rtol': _TOLERANCE, 'atol': _TOLERANCE, 'first_step': end_s - begin_s}
    return np.asarray(solve_ivp(rate, (begin_s, end_s), y, 'DOP853', **options).y[:, -1])


Truth = Callable[[Scenario, Floats, Floats], Floats]
"""From a scenario, the forces (N, 3) [N] applied in its ticks and the masses (N,) [kg] that they
move to the states (N + 1, 6)."""

DISTANCES_M = (10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)
AXIS_NAMES = ('R-bar', 'V-bar', 'H-bar')


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


def attitude_by_scipy(scenario: Scenario) -> Floats:
    """Return the matrix (3, 3) from the target's axes to inertial ones at the end, by DOP853.

    The inertial axes are those of target LVLH at tick 0.
    """
    target = scenario.target
    inertia = np.array(target.inertia_kg_m2)

    def rate(_t_s: float, y: Floats) -> Floats:
        turned, w = y[:9].reshape(3, 3), y[9:]
        change = np.linalg.solve(inertia, cross(inertia @ w, w))
        return np.concatenate([*(cross(row, w) for row in turned), change])

    y = np.concatenate([_matrix(target.attitude).ravel(), target.rates_rad_s])
    for begin_s, end_s in pairwise(np.linspace(0.0, scenario.duration_s, 401).tolist()):
        y = integrate(rate, begin_s, end_s, y)
    return y[:9].reshape(3, 3)


def _matrix(quaternion: Sequence[float]) -> Floats:
    return np.asarray(Rotation.from_quat(quaternion).as_matrix())


def attitude_error_rad(scenario: Scenario, true: Floats) -> float:
    """Return by how much our target is turned at the end against a matrix (3, 3), inertial."""
    ours = _matrix(motion_of(scenario.target, scenario).attitude(scenario.ticks)[:4])
    angle = scenario.mean_motion_rad_s * scenario.duration_s
    orbit = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    return float(Rotation.from_matrix(true.T @ orbit @ ours).magnitude())


def drift_errors(scenario: Scenario, duration_s: float) -> dict[float, Floats]:
    """Return distance [m] -> errors (3,) [m] of the linear plant on a circle after free drift.

    From rest at that distance along R-bar, V-bar, H-bar.
    """
    plain = replace(scenario, sections=(), requirements=None)
    world, rest = World(plain), np.zeros(3)
    linear, _ = cw.matrices(cw.discretise(plain.mean_motion_rad_s, plain.mass_kg, duration_s))
    target, by_distance = world.target(), {}
    for distance in DISTANCES_M:
        errors = np.empty(3)
        for axis in range(3):
            start = np.zeros(6)
            start[axis] = distance
            y = np.concatenate([target, world.to_inertial(target, start)])
            y = integrate(lambda _t_s, y: world.rate(y, rest, plain.mass_kg), 0.0, duration_s, y)
            error = linear @ start - world.to_lvlh(y[:6], y[6:])
            errors[axis] = np.linalg.norm(error[:3])
        by_distance[distance] = errors
    return by_distance


SHOWN = 4
"""Moments in the table of a flight."""


@dataclass(frozen=True)
class Comparison:
    """A flight beside truths.

    errors : name of the truth -> states of the plant less true ones (N + 1, 6)
    disagreement_m : largest distance between two truths; None if there is only one
    growth : `drift_errors`
    """

    scenario: Scenario
    errors: Mapping[str, Floats]
    disagreement_m: float | None
    growth: Mapping[float, Floats]

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


def compare(flight: Flight, truths: Mapping[str, Truth]) -> Comparison:
    """Fly the forces of a flight under true gravity, by truths that have what acts."""
    scenario, masses = flight.scenario, flight.thrust.masses_kg
    # The commands are those of the flight; the controller does not run again.
    forces = flight.thrust.forces_n + flight.disturbances_n[:-1]
    true = {name: by(scenario, forces, masses) for name, by in truths.items()}
    disagreement_m = None
    if len(true) == 2:
        first, second = true.values()
        disagreement_m = float(np.linalg.norm((first - second)[:, :3], axis=1).max())
    errors = {name: flight.states - states for name, states in true.items()}
    growth = drift_errors(scenario, scenario.duration_s)
    return Comparison(scenario, errors, disagreement_m, growth)
