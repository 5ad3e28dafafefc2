# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Two-body truths that fly the same forces as the linear (Clohessy-Wiltshire) plant, open loop.

Target on its circular orbit; chaser under point-mass gravity and forces held for a tick in the
axes of `target_lvlh`, to which its body axes stay parallel. At t = 0 the inertial axes are those of
LVLH: the target at (r, 0, 0), moving along +y; LVLH then turns about z with the mean motion n.

Two of them, with nothing in common: Basilisk's spacecraft with an external force in body axes, body
turning freely at n; and Encke's form of the relative motion in inertial axes, by SciPy's DOP853.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from rpo_core import cw
from rpo_core.flight import Flight
from rpo_core.interfaces import THRUST_FORCE
from rpo_core.scenario import Scenario
from rpo_core.thrusters import ThrustersStage

Floats = NDArray[np.float64]
Truth = Callable[[Scenario, Floats], Floats]
"""From a scenario and the forces (N, 3) [N] applied in its ticks to the states (N + 1, 6)."""

DISTANCES_M = (10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0)
AXIS_NAMES = ('R-bar', 'V-bar', 'H-bar')

_TOLERANCE = 1e-13


def total_forces_n(flight: Flight) -> Floats:
    """Return the forces (N, 3) on the chaser in each tick: of the thrusters, and disturbance.

    The commands are those of the flight; the controller does not run again.
    """
    stage = ThrustersStage(flight.scenario.thrusters, flight.scenario.max_force_n)
    ticks = np.arange(len(flight.forces_n) - 1)
    thrust = stage.steps(ticks, flight.forces_n[:-1])[stage.outputs.index(THRUST_FORCE)]
    return np.asarray(thrust + flight.disturbances_n[:-1])


def _turn(angle_rad: float) -> Floats:
    """Return the matrix (3, 3) from LVLH, turned by an angle about z, to inertial axes."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _to_inertial(state: Floats, n: float, t_s: float) -> Floats:
    """Return relative position and velocity (6,) in inertial axes of an LVLH state (6,)."""
    spin = np.cross([0.0, 0.0, n], state[:3])
    turn = _turn(n * t_s)
    return np.concatenate([turn @ state[:3], turn @ (state[3:] + spin)])


def _to_lvlh(inertial: Floats, n: float, t_s: float) -> Floats:
    """Undo `_to_inertial`."""
    turn = _turn(n * t_s).T
    position = turn @ inertial[:3]
    return np.concatenate([position, turn @ inertial[3:] - np.cross([0.0, 0.0, n], position)])


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


def by_scipy(scenario: Scenario, forces_n: Floats) -> Floats:
    """Return the states (N + 1, 6) under forces (N, 3), by DOP853 from tick to tick."""
    n, radius = scenario.mean_motion_rad_s, scenario.orbit_radius_m
    mu, states = scenario.body.mu_m3_s2, [np.array(scenario.start)]
    inertial = _to_inertial(states[0], n, 0.0)
    for tick, force in enumerate(forces_n):

        def rate(t_s: float, y: Floats, force: Floats = force) -> Floats:
            turn = _turn(n * t_s)
            pull = encke(y[:3], turn @ np.array([radius, 0.0, 0.0]), mu)
            return np.concatenate([y[3:], pull + turn @ force / scenario.mass_kg])

        inertial = _integrate(rate, scenario.time_s(tick), scenario.time_s(tick + 1), inertial)
        states.append(_to_lvlh(inertial, n, scenario.time_s(tick + 1)))
    return np.array(states)


def _integrate(rate: Callable[..., Floats], begin_s: float, end_s: float, y: Floats) -> Floats:
    solver = DOP853(
        rate, begin_s, y, end_s, rtol=_TOLERANCE, atol=_TOLERANCE, first_step=end_s - begin_s
    )
    while solver.status == 'running':
        solver.step()
    return np.asarray(solver.y)


def _basilisk(scenario: Scenario) -> tuple[Any, Any, Any]:
    """Return Basilisk's simulation of the chaser at its start, the chaser, the force on it."""
    from Basilisk.simulation import extForceTorque, spacecraft
    from Basilisk.utilities import SimulationBaseClass, simIncludeGravBody

    n, radius = scenario.mean_motion_rad_s, scenario.orbit_radius_m
    simulation = SimulationBaseClass.SimBaseClass()
    task = simulation.CreateNewTask('flight', scenario.dt_ns)
    simulation.CreateNewProcess('truth').addTask(task)
    chaser, force = spacecraft.Spacecraft(), extForceTorque.ExtForceTorque()
    chaser.hub.mHub = scenario.mass_kg
    chaser.hub.IHubPntBc_B = np.eye(3).tolist()
    bodies = simIncludeGravBody.gravBodyFactory()
    earth = bodies.createEarth()
    earth.isCentralBody, earth.mu = True, scenario.body.mu_m3_s2
    bodies.addBodiesTo(chaser)
    chaser.addDynamicEffector(force)
    for model in (chaser, force):
        simulation.AddModelToTask('flight', model)
    relative = _to_inertial(np.array(scenario.start), n, 0.0)
    start = np.array([radius, 0.0, 0.0, 0.0, n * radius, 0.0]) + relative
    chaser.hub.r_CN_NInit, chaser.hub.v_CN_NInit = start[:3].tolist(), start[3:].tolist()
    chaser.hub.omega_BN_BInit = [[0.0], [0.0], [n]]  # so that body axes stay parallel to LVLH
    simulation.InitializeSimulation()
    return simulation, chaser, force


def by_basilisk(scenario: Scenario, forces_n: Floats) -> Floats:
    """Return the states (N + 1, 6) under forces (N, 3), by Basilisk (layer `truth`)."""
    n, radius = scenario.mean_motion_rad_s, scenario.orbit_radius_m
    simulation, chaser, force = _basilisk(scenario)
    states = [np.array(scenario.start)]
    simulation.ConfigureStopTime(0)
    simulation.ExecuteSimulation()
    for tick, applied in enumerate(forces_n.tolist()):
        force.extForce_B = [[component] for component in applied]
        simulation.ConfigureStopTime((tick + 1) * scenario.dt_ns)
        simulation.ExecuteSimulation()
        t_s = scenario.time_s(tick + 1)
        turn, message = _turn(n * t_s), chaser.scStateOutMsg.read()
        target = np.concatenate([turn @ [radius, 0.0, 0.0], turn @ [0.0, n * radius, 0.0]])
        found = np.concatenate([message.r_CN_N, message.v_CN_N])
        states.append(_to_lvlh(found - target, n, t_s))
    return np.array(states)


class Growth(NamedTuple):
    """Error of the linear plant [m, m/s] after drifting freely from rest, at one distance.

    position_m, velocity_m_s : (3,) start along R-bar, V-bar, H-bar
    """

    distance_m: float
    position_m: Floats
    velocity_m_s: Floats


def drift_errors(scenario: Scenario, duration_s: float) -> list[Growth]:
    """Return how the error of the linear plant grows with the distance of the start."""
    n, radius = scenario.mean_motion_rad_s, scenario.orbit_radius_m
    linear, _ = cw.matrices(cw.discretise(n, scenario.mass_kg, duration_s))

    def rate(t_s: float, y: Floats) -> Floats:
        pull = encke(y[:3], _turn(n * t_s) @ np.array([radius, 0.0, 0.0]))
        return np.concatenate([y[3:], pull])

    found = []
    for distance in DISTANCES_M:
        errors = []
        for axis in range(3):
            start = np.zeros(6)
            start[axis] = distance
            truth = _integrate(rate, 0.0, duration_s, _to_inertial(start, n, 0.0))
            errors.append(linear @ start - _to_lvlh(truth, n, duration_s))
        parts = np.array(errors).reshape(3, 2, 3)
        norms = np.linalg.norm(parts, axis=2)
        found.append(Growth(distance, norms[:, 0], norms[:, 1]))
    return found


TRUTHS: dict[str, Truth] = {'Basilisk': by_basilisk, 'SciPy': by_scipy}
"""Name -> simulation."""

SHOWN = 8
"""Moments in the table of a flight."""


@dataclass(frozen=True)
class Comparison:
    """A flight of the linear plant beside truths.

    errors : name of the truth -> linear less true states (N + 1, 6)
    disagreement_m : largest distance between two truths; None if there is only one
    """

    title: str
    scenario: Scenario
    errors: Mapping[str, Floats]
    disagreement_m: float | None
    growth: tuple[Growth, ...]

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


def compare(flight: Flight, title: str, names: Sequence[str] = tuple(TRUTHS)) -> Comparison:
    """Fly the forces of a flight under two-body gravity, by the named truths."""
    scenario, forces = flight.scenario, total_forces_n(flight)
    true = {name: TRUTHS[name](scenario, forces) for name in names}
    apart = None
    if len(true) == 2:
        first, second = true.values()
        apart = float(np.linalg.norm((first - second)[:, :3], axis=1).max())
    errors = {name: flight.states - states for name, states in true.items()}
    growth = tuple(drift_errors(scenario, scenario.duration_s))
    return Comparison(title, scenario, errors, apart, growth)
