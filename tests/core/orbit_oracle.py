# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Target and chaser in inertial axes, by SciPy's DOP853: nothing of our orbit kernels."""

from __future__ import annotations

import math
from functools import partial

import numpy as np
from scipy.integrate import DOP853

TOLERANCE = 1e-13


def gravity(position, body, oblate):
    """Return the acceleration (3,) of a body whose pole is the z axis; J2 as textbooks print it."""
    x, y, z = position
    r = math.sqrt(position @ position)
    found = -body.mu_m3_s2 / r**3 * position
    if oblate:
        k = 1.5 * body.j2 * body.mu_m3_s2 * body.equator_m**2 / r**5
        s = 5.0 * z * z / (r * r)
        found = found - k * np.array([x * (1.0 - s), y * (1.0 - s), z * (3.0 - s)])
    return found


def drag(position, velocity, air, coefficient, reference_m):
    """Return the acceleration (3,) by an atmosphere that turns about the z axis."""
    if air is None:
        return np.zeros(3)
    wind = velocity - np.cross([0.0, 0.0, air.atmosphere_rate_rad_s], position)
    density = air.density_kg_m3
    if air.scale_height_m is not None:
        height = math.sqrt(position @ position) - reference_m
        density *= math.exp(-height / air.scale_height_m)
    return -0.5 * density * math.sqrt(wind @ wind) / coefficient * wind


def kepler_start(scenario):
    """Return the target's inertial state (6,), by rotation matrices."""
    d, mu = scenario.dynamics, scenario.body.mu_m3_s2
    nu, argument, tilt = (
        math.radians(a or 0.0)
        for a in (d.true_anomaly_deg, d.argument_of_periapsis_deg, d.inclination_deg)
    )
    p = scenario.orbit_radius_m * (1.0 - d.eccentricity**2)
    r = p / (1.0 + d.eccentricity * math.cos(nu))
    position = r * np.array([math.cos(nu), math.sin(nu), 0.0])
    velocity = math.sqrt(mu / p) * np.array([-math.sin(nu), d.eccentricity + math.cos(nu), 0.0])
    about_z = np.array(
        [
            [math.cos(argument), -math.sin(argument), 0.0],
            [math.sin(argument), math.cos(argument), 0.0],
            [0.0, 0.0, 1.0],
        ]
    )
    about_x = np.array(
        [
            [1.0, 0.0, 0.0],
            [0.0, math.cos(tilt), -math.sin(tilt)],
            [0.0, math.sin(tilt), math.cos(tilt)],
        ]
    )
    turn = about_x @ about_z
    return np.concatenate([turn @ position, turn @ velocity])


class Inertial:
    """The motion of both spacecraft: (target's position, velocity, chaser's less the target's)."""

    def __init__(self, scenario):
        self.scenario, self.d = scenario, scenario.dynamics

    def target_pull(self, position, velocity):
        air = self.d.drag
        coefficient = air.target_ballistic_coefficient_kg_m2 if air else 1.0
        found = gravity(position, self.scenario.body, self.d.j2)
        return found + drag(position, velocity, air, coefficient, self.scenario.orbit_radius_m)

    def chaser_pull(self, position, velocity):
        air = self.d.drag
        coefficient = air.chaser_ballistic_coefficient_kg_m2 if air else 1.0
        found = gravity(position, self.scenario.body, self.d.j2)
        return found + drag(position, velocity, air, coefficient, self.scenario.orbit_radius_m)

    def frame(self, target):
        """Return the axes of LVLH as columns (3, 3), and its rate (3,), inertial."""
        r, v = target[:3], target[3:]
        h = np.cross(r, v)
        x, z = r / np.linalg.norm(r), h / np.linalg.norm(h)
        normal = self.target_pull(r, v) @ z
        rate = h / (r @ r) + (np.linalg.norm(r) / np.linalg.norm(h)) * normal * x
        return np.column_stack([x, np.cross(z, x), z]), rate

    def to_inertial(self, target, state):
        axes, rate = self.frame(target)
        r = axes @ state[:3]
        return np.concatenate([r, axes @ state[3:] + np.cross(rate, r)])

    def to_lvlh(self, target, relative):
        axes, rate = self.frame(target)
        r = relative[:3]
        return np.concatenate([axes.T @ r, axes.T @ (relative[3:] - np.cross(rate, r))])

    def rate(self, _t_s, y, force):
        """Return the derivative of the motion (12,) under a force (3,) in the axes of LVLH."""
        r, v, d, u = y.reshape(4, 3)
        pulled = self.target_pull(r, v)
        push = self.frame(y[:6])[0] @ force / self.scenario.mass_kg if force.any() else 0.0
        return np.concatenate([v, pulled, u, self.chaser_pull(r + d, v + u) - pulled + push])

    def drift(self, forces=((0.0, 0.0, 0.0),), each_s=None):
        """Return the last state (6,), target LVLH, under forces (n, 3), each held for `each_s`."""
        each_s = each_s or self.scenario.duration_s
        target = kepler_start(self.scenario)
        y = np.concatenate([target, self.to_inertial(target, np.array(self.scenario.start))])
        for number, force in enumerate(forces):
            rate = partial(self.rate, force=np.array(force))
            solver = DOP853(
                rate, number * each_s, y, (number + 1) * each_s, rtol=TOLERANCE, atol=1e-12
            )
            while solver.status == 'running':
                solver.step()
            y = solver.y
        return self.to_lvlh(y[:6], y[6:])
