# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The laws of a hold and a retreat, when the abort table has the command.

A velocity is wanted, and the thrusters bring the chaser to it. The filter follows, so the
assured sets are kept here as for every command.
"""

from __future__ import annotations

from math import sqrt

from rpo_core.assurance.kernels import Guard, closing, speed_limit
from rpo_core.assurance.manoeuvre import PathModel, towards
from rpo_core.kernels.arithmetic import State, Vector, norm

RESPONSE_S = 2.0
"""Time constant of the velocity."""

APPROACH_1_S = 0.1
"""Speed towards a point, for each metre to go."""

AT_REST_M_S = 0.02
"""At this speed a hold has its point."""

HOLD_M_S, RETREAT_M_S = 0.1, 0.3
"""Largest speed of a hold that has its point, and of a retreat."""

LIMIT_SHARE = 0.5
"""Share of the speed limit that a retreat flies with."""

PASSING_M = 3.0
"""A retreat passes the keep-out sphere by so much."""


def holding(state: State, point_m: Vector | None, w: PathModel) -> Vector:
    """Return the force (3,) [N] that stops the chaser (None), or keeps it at a point (3,) [m]."""
    if point_m is None:
        return towards(state, (0.0, 0.0, 0.0), RESPONSE_S, w)
    return towards(state, to_point(state, point_m, HOLD_M_S), RESPONSE_S, w)


def retreating(state: State, point_m: Vector, radius_m: float, w: PathModel, g: Guard) -> Vector:
    """Return the force (3,) [N] towards a point (3,) [m], around a sphere about the target."""
    speed = min(LIMIT_SHARE * speed_limit(closing(state)[0], g), RETREAT_M_S)
    wanted = to_point(state, point_m, speed)
    return towards(state, around(state, wanted, radius_m), RESPONSE_S, w)


def to_point(state: State, point_m: Vector, speed_m_s: float) -> Vector:
    """Return the velocity (3,) [m/s] towards a point, slower where it is near."""
    gx, gy, gz = point_m[0] - state[0], point_m[1] - state[1], point_m[2] - state[2]
    distance = norm(gx, gy, gz)
    k = min(APPROACH_1_S, speed_m_s / distance) if distance > 0.0 else 0.0
    return k * gx, k * gy, k * gz


def around(state: State, wanted: Vector, radius_m: float) -> Vector:
    """Return a velocity (3,) [m/s] that passes a sphere instead of one that leads into it."""
    radius = radius_m + PASSING_M
    x, y, z = state[:3]
    speed, rho = norm(*wanted), norm(x, y, z)
    if radius_m <= 0.0 or speed == 0.0 or rho == 0.0:
        return wanted
    inward = -(x * wanted[0] + y * wanted[1] + z * wanted[2]) / speed
    past = sqrt(max(rho * rho - inward * inward, 0.0))
    if inward <= 0.0 or past >= radius:
        return wanted
    ex, ey, ez = x / rho, y / rho, z / rho
    along = inward * speed / rho
    tx, ty, tz = wanted[0] + along * ex, wanted[1] + along * ey, wanted[2] + along * ez
    size = norm(tx, ty, tz)
    if size < 1e-3 * speed:  # straight through the centre: below it, or beside it
        tx, ty, tz = (-1.0, 0.0, 0.0) if abs(ex) < 0.9 else (0.0, 0.0, 1.0)
        size = 1.0
    # Nearly straight at the centre there is no hurry to turn: along the tangent cone.
    sine = min(radius / rho, 1.0)
    inwards = speed * sqrt(1.0 - sine * sine)
    out = min(APPROACH_1_S * (radius - rho), speed) if rho < radius else -inwards
    k = sqrt(speed * speed - out * out) / size
    return k * tx + out * ex, k * ty + out * ey, k * tz + out * ez
