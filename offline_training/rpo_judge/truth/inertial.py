# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The world of a scenario in inertial axes, in NumPy: what pulls, where LVLH is.

It shares no code with `rpo_core.world.dynamics`. z is the pole of the body, x the ascending node.
Without section `dynamics` the target is on a circle in the plane of x and y. Gravity is always
true.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from rpo_core.files.scenario import Scenario
from rpo_core.world import cw
from rpo_core.world.dynamics import Drag, Dynamics

Floats = NDArray[np.float64]

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
        found = np.zeros(3)
        radius = math.sqrt(position @ position)
        if self.settings.j2:
            body, sine2 = self.body, (position[2] / radius) ** 2
            factor = 1.5 * body.j2 * body.mu_m3_s2 * body.equator_m**2 / radius**5
            found = factor * position * (np.array([5.0, 5.0, 5.0]) * sine2 - [1.0, 1.0, 3.0])
        return found + self._air(self.drag, position, velocity, coefficient) if self.drag else found

    def _air(self, drag: Drag, position: Floats, velocity: Floats, coefficient: float) -> Floats:
        x, y, _ = position
        wind = velocity - drag.atmosphere_rate_rad_s * np.array([-y, x, 0.0])
        density = drag.density_kg_m3
        if drag.scale_height_m is not None:
            sea_m = drag.density_radius_m or self.scenario.orbit_radius_m
            height_m = math.sqrt(position @ position) - sea_m
            density *= math.exp(-height_m / drag.scale_height_m)
        return -0.5 * density / coefficient * math.sqrt(wind @ wind) * wind

    def of_target(self, target: Floats) -> Floats:
        """Return the target's acceleration (3,) beside point-mass gravity."""
        coefficient = self.drag.target_ballistic_coefficient_kg_m2 if self.drag else 1.0
        return self.perturbation(target[:3], target[3:], coefficient)

    def of_chaser(self, position: Floats, velocity: Floats, mass_kg: float) -> Floats:
        """Return the chaser's acceleration (3,) beside point-mass gravity."""
        share = mass_kg / self.scenario.mass_kg
        coefficient = self.drag.chaser_ballistic_coefficient_kg_m2 * share if self.drag else 1.0
        return self.perturbation(position, velocity, coefficient)

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
        change = change + self.of_chaser(position + offset, velocity + drift, mass_kg)
        if force_n.any():
            change = change + self.frame(y[:6])[0] @ force_n / mass_kg
        return np.concatenate([velocity, disturbed - mu / radius**3 * position, drift, change])


def integrate(
    rate: Callable[[float, Floats], Floats], begin_s: float, end_s: float, y: Floats
) -> Floats:
    """Return the state at the end, by DOP853."""
    solver = DOP853(
        rate, begin_s, y, end_s, rtol=_TOLERANCE, atol=_TOLERANCE, first_step=end_s - begin_s
    )
    while solver.status == 'running':
        solver.step()
    return np.asarray(solver.y)
