# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The APPROACH set in the corridor, and its backup law. docs/safety.md has the proof.

APPROACH set : able to stop before the walls of the corridor, slow enough for contact at the port.
"""

from __future__ import annotations

from math import sqrt

from rpo_core.assurance.kernels import Guard, closing, needed_deceleration, speed_limit
from rpo_core.kernels.arithmetic import State, Vector, saturate
from rpo_core.kernels.jit import kernel


@kernel
def in_corridor(state: State, g: Guard) -> tuple[float, float, float, float, float, float]:
    """Distance d to the port, speed towards it; both offsets from the axis, and their speeds."""
    x, y, z, vx, vy, vz = state
    if g.axis == 0:
        return g.side * x - g.port_m, -g.side * vx, y, z, vy, vz
    if g.axis == 1:
        return g.side * y - g.port_m, -g.side * vy, z, x, vz, vx
    return g.side * z - g.port_m, -g.side * vz, x, y, vx, vy


@kernel
def behind_port(distance_m: float, g: Guard) -> float:
    """Distance [m] to the end of the corridor behind the port; negative: beyond that.

    It is in the sphere: who comes to the target from its other side is not in the corridor.
    """
    return distance_m + 0.5 * (g.keep_out_m + g.port_m)


@kernel
def at_port(state: State, beyond_m: float, g: Guard) -> bool:
    """Whether a state has come through the corridor, and so far beyond the plane of the port."""
    d, _, p, q, _, _ = in_corridor(state, g)
    wide = g.width_m + g.here_m
    if d > -beyond_m or behind_port(d, g) < 0.0:
        return False
    return abs(p) <= wide and abs(q) <= wide


@kernel
def wall_margin(gap_m: float, closing_m_s: float, g: Guard) -> float:
    """Distance [m] left to a wall of the corridor when stopped."""
    if closing_m_s <= 0.0:
        return gap_m
    return gap_m - closing_m_s * closing_m_s / (2.0 * g.wall_m_s2)


@kernel
def approach_margins(
    state: State, error_m: float, error_m_s: float, g: Guard
) -> tuple[float, float]:
    """Margins to the APPROACH set: left of the walls when stopped [m], below the speeds [m/s]."""
    d, w, p, q, vp, vq = in_corridor(state, g)
    near = d - error_m
    near = near if near > 0.0 else 0.0
    worst = error_m_s * (1.0 + g.slope)
    half = g.width_m + g.slope * near - error_m
    narrowing = g.slope * w
    walls = wall_margin(half - p, vp + narrowing + worst, g)
    other = wall_margin(half + p, narrowing - vp + worst, g)
    walls = walls if walls < other else other
    other = wall_margin(half - q, vq + narrowing + worst, g)
    walls = walls if walls < other else other
    other = wall_margin(half + q, narrowing - vq + worst, g)
    walls = walls if walls < other else other
    rho, _, speed = closing(state)
    other = g.outer_m - rho - error_m
    walls = walls if walls < other else other
    other = behind_port(d, g) - error_m
    walls = walls if walls < other else other
    slower = speed_limit(rho - error_m, g) - speed
    # The speeds of contact hold from the last tick before it on: it comes between two ticks.
    left = near - (g.contact_m_s + 0.5 * (g.wall_m_s2 + g.doubt_m_s2) * g.dt_s) * g.dt_s
    left = left if left > 0.0 else 0.0
    closes = sqrt(g.contact_m_s * g.contact_m_s + 2.0 * g.wall_m_s2 * left)
    other = closes - w
    slower = slower if slower < other else other
    # Across, at least as fast as the walls come nearer to each other.
    across, follows = g.lateral_1_s * left, g.slope * (closes - g.contact_m_s)
    across = g.lateral_m_s + (across if across > follows else follows)
    other = across - abs(vp)
    slower = slower if slower < other else other
    other = across - abs(vq)
    slower = slower if slower < other else other
    return walls, slower - error_m_s


@kernel
def centring(offset_m: float, speed_m_s: float, half_m: float, narrowing: float, g: Guard) -> float:
    """Acceleration [m/s^2] of an offset that stops it, and at least keeps it between the walls."""
    low = needed_deceleration(half_m + offset_m, narrowing - speed_m_s, g.wall_m_s2, g.dt_s)
    high = -needed_deceleration(half_m - offset_m, narrowing + speed_m_s, g.wall_m_s2, g.dt_s)
    a = -speed_m_s / g.dt_s
    a = low + g.doubt_m_s2 if a < low + g.doubt_m_s2 else a
    return high - g.doubt_m_s2 if a > high - g.doubt_m_s2 else a


@kernel
def backup_approach(state: State, g: Guard) -> Vector:
    """Backup law [N] of the APPROACH set: stop along the axis, stop across it between the walls."""
    d, w, p, q, vp, vq = in_corridor(state, g)
    near = d - g.here_m
    half = g.width_m + g.slope * (near if near > 0.0 else 0.0) - g.here_m
    narrowing = g.slope * w + g.here_m_s * (1.0 + g.slope)
    out = g.side * saturate(g.mass_kg * (w if w > 0.0 else 0.0) / g.dt_s, g.limit_n)
    fp = saturate(g.mass_kg * centring(p, vp, half, narrowing, g), g.limit_n)
    fq = saturate(g.mass_kg * centring(q, vq, half, narrowing, g), g.limit_n)
    if g.axis == 0:
        return out, fp, fq
    if g.axis == 1:
        return fq, out, fp
    return fp, fq, out
