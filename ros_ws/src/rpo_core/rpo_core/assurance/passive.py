# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Passive safety: how long a chaser whose thrusters fall silent certainly stays clear.

The drift is that of Clohessy and Wiltshire in closed form, with a constant acceleration along the
orbit, unknown within bounds: differential drag. At each moment the chaser is on a segment, between
its places for both bounds. Its distance to the target changes at most as fast as the largest speed
of the drift, so nothing happens while that cannot have used up the distance: the check goes on by
such steps, and misses no moment between them.
"""

from __future__ import annotations

from math import sqrt

from rpo_core.kernels.arithmetic import State, Vector, sin_cos
from rpo_core.kernels.jit import kernel

NEAR_M = 1e-3
"""A distance that is within so much of the radius counts as inside."""


@kernel
def drifted(state: State, t: float, n: float, along_m_s2: float) -> Vector:
    """Position [m] after a drift of t [s] with a constant acceleration along y; n [rad/s]."""
    x, y, z, vx, vy, vz = state
    s, c = sin_cos(n * t)
    a = along_m_s2 / (n * n)
    return (
        (4.0 - 3.0 * c) * x + (s * vx + 2.0 * (1.0 - c) * vy) / n + 2.0 * a * (n * t - s),
        6.0 * (s - n * t) * x
        + y
        - 2.0 * (1.0 - c) * vx / n
        + (4.0 * s / n - 3.0 * t) * vy
        + a * (4.0 * (1.0 - c) - 1.5 * n * n * t * t),
        c * z + s * vz / n,
    )


@kernel
def fastest(state: State, duration_s: float, n: float, along_m_s2: float) -> float:
    """Bound of the speed [m/s] of a drift of at most a duration, |acceleration| at most so much."""
    x, _, z, vx, vy, vz = state
    swing = sqrt(vx * vx + (3.0 * n * x + 2.0 * vy) * (3.0 * n * x + 2.0 * vy))
    a = abs(along_m_s2)
    sx = swing + 4.0 * a / n
    sy = abs(6.0 * n * x + 3.0 * vy) + 2.0 * swing + a * (4.0 / n + 3.0 * duration_s)
    sz = sqrt(vz * vz + n * n * z * z)
    return sqrt(sx * sx + sy * sy + sz * sz)


@kernel
def to_segment(p: Vector, q: Vector) -> float:
    """Distance [m] of the origin to the segment between two points."""
    dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    square = dx * dx + dy * dy + dz * dz
    k = -(p[0] * dx + p[1] * dy + p[2] * dz) / square if square > 0.0 else 0.0
    k = 0.0 if k < 0.0 else (1.0 if k > 1.0 else k)
    x, y, z = p[0] + k * dx, p[1] + k * dy, p[2] + k * dz
    return sqrt(x * x + y * y + z * z)


@kernel
def clear_for(
    state: State, radius_m: float, duration_s: float, n: float, least: float, most: float
) -> float:
    """Return for how long [s] a drift certainly stays out of a sphere; the duration if for all.

    least, most : bounds of the acceleration along y [m/s^2]
    """
    bound = abs(least) if abs(least) > abs(most) else abs(most)
    speed = fastest(state, duration_s, n, bound) + 1e-12
    t = 0.0
    while t < duration_s:
        distance = to_segment(drifted(state, t, n, least), drifted(state, t, n, most))
        if distance < radius_m + NEAR_M:
            return t
        t += (distance - radius_m) / speed
    return duration_s
