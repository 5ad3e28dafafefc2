# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The OPEN and the APPROACH set, and their backup laws. docs/safety.md has the proof.

Plain functions of floats, interpreted or compiled (`rpo_core.kernels.jit`) with the same bits: only
+ - * / sqrt and comparisons. r [m], v [m/s], f [N] in target LVLH; rho = |r|, closing speed
c = -r.v/rho, m mass [kg].

OPEN set, outside the keep-out sphere : rho - R >= c^2 / (2 a(rho)) where c > 0; the same outward,
rho_max - rho >= c^2 / (2 a_e) where c < 0; and |v| <= L(rho)
APPROACH set, in the corridor : able to stop before its walls, slow enough for contact at the port
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from rpo_core.kernels.arithmetic import State, Vector, saturate
from rpo_core.kernels.jit import kernel

OPEN, APPROACH, CONTACT = 0, 1, 2
"""Modes: outside the keep-out sphere; inside the corridor; at the port, where assurance ends."""

FAR = 1e30
"""Margin of a constraint that a scenario does not have."""

LARGEST = 1e100
"""A command or a state beyond it counts as not finite: its square would not be."""


class Guard(NamedTuple):
    """The numbers of the filter, from `rpo_core.assurance.guard.guard_of`.

    dt_s, mass_kg, limit_n : tick, mass, largest |f| of an axis
    slew_n : largest change of a command in a tick, per axis; 0: no limit
    least : 1.0 for the least change of a command, 0.0 for the backup law instead (Simplex)
    keep_out_m : radius R, grown by what a path may dip between ticks; 0: none
    brake_n : radial share of the backup law; authority_m_s2 : a(0) along the range that it
        leaves for certain; tide_1_s2 : what a(rho) loses per metre of range
    speed_m_s, speed_1_s, deceleration_m_s2 : limit v0 + k rho + sqrt(2 a rho)
    slowing_m_s2, knee_m : how fast the limit may fall with the range, and where
    domain_m : range that the chaser does not leave, less what a path may rise between ticks
    top_m_s, edge_m_s2 : largest limit, and authority outward, with which it is kept
    here_m, here_m_s : error of the state to which the command will be applied
    next_m, next_m_s : the same one tick later
    axis, side : corridor along x, y, z (0, 1, 2), towards +1.0 or -1.0; side 0.0: none
    port_m, outer_m : range of the port, and of the outer end of the corridor
    width_m, slope : half-width W = width + slope x distance to the port
    contact_m_s, lateral_m_s, lateral_1_s : closing and lateral speed at the port; its growth
    wall_m_s2, doubt_m_s2 : authority per axis in the corridor, and what it may be off
    """

    dt_s: float
    mass_kg: float
    limit_n: float
    slew_n: float
    least: float
    keep_out_m: float
    brake_n: float
    authority_m_s2: float
    tide_1_s2: float
    speed_m_s: float
    speed_1_s: float
    deceleration_m_s2: float
    slowing_m_s2: float
    knee_m: float
    domain_m: float
    top_m_s: float
    edge_m_s2: float
    here_m: float
    here_m_s: float
    next_m: float
    next_m_s: float
    axis: int
    side: float
    port_m: float
    outer_m: float
    width_m: float
    slope: float
    contact_m_s: float
    lateral_m_s: float
    lateral_1_s: float
    wall_m_s2: float
    doubt_m_s2: float


@kernel
def speed_limit(range_m: float, g: Guard) -> float:
    """Largest speed [m/s] at a range: the limit of the file, lowered where nobody could keep it.

    The chaser, flying inwards, loses at most `slowing_m_s2`; so the square of the limit may fall by
    twice that per metre. docs/safety.md, "Speed by range".
    """
    rho = range_m if range_m > 0.0 else 0.0
    rho = rho if rho < g.domain_m else g.domain_m
    slope = 2.0 * g.slowing_m_s2
    if g.deceleration_m_s2 > 0.0:
        limit = g.speed_m_s + sqrt(2.0 * g.deceleration_m_s2 * rho)
        viable = sqrt(g.speed_m_s * g.speed_m_s + slope * rho)
        limit = limit if limit < viable else viable
    elif rho <= g.knee_m:
        limit = g.speed_m_s + g.speed_1_s * rho
    else:
        knee = g.speed_m_s + g.speed_1_s * g.knee_m
        limit = sqrt(knee * knee + slope * (rho - g.knee_m))
    return limit if limit < g.top_m_s else g.top_m_s


@kernel
def fastest_after(gap_m: float, closing_m_s: float, authority_m_s2: float, dt_s: float) -> float:
    """Largest closing speed [m/s] one tick later that still stops within a gap.

    With a constant deceleration in the tick the gap shrinks by (c + w) dt / 2, and w^2 / (2 a) must
    fit into the rest. -1.0: the chaser has to stop before the tick ends.
    """
    rest = gap_m - 0.5 * closing_m_s * dt_s
    if rest < 0.0:
        return -1.0
    half = 0.5 * dt_s
    return authority_m_s2 * (sqrt(half * half + 2.0 * rest / authority_m_s2) - half)


@kernel
def needed_deceleration(
    gap_m: float, closing_m_s: float, authority_m_s2: float, dt_s: float
) -> float:
    """Least deceleration [m/s^2] of this tick after which the chaser can stop within the gap.

    Negative: so much acceleration is allowed. At most the authority, if it could stop before.
    Where an error of the state makes the gap negative, what recedes need not do more than that.
    """
    w = fastest_after(gap_m, closing_m_s, authority_m_s2, dt_s)
    if w >= 0.0:
        return (closing_m_s - w) / dt_s
    if closing_m_s <= 0.0:
        return closing_m_s / dt_s
    if gap_m <= 0.0:
        return LARGEST
    return closing_m_s * closing_m_s / (2.0 * gap_m)


@kernel
def authority(range_m: float, g: Guard) -> float:
    """Deceleration [m/s^2] along the range that the backup law has for certain."""
    a = g.authority_m_s2 - g.tide_1_s2 * range_m
    return a if a > 1e-9 else 1e-9


@kernel
def closing(state: State) -> tuple[float, float, float]:
    """Range [m], closing speed [m/s], speed [m/s] of a state."""
    x, y, z, vx, vy, vz = state
    rho = sqrt(x * x + y * y + z * z)
    speed = sqrt(vx * vx + vy * vy + vz * vz)
    c = -(x * vx + y * vy + z * vz) / rho if rho > 0.0 else speed
    return rho, c, speed


@kernel
def both_margins(
    state: State, error_m: float, error_m_s: float, g: Guard
) -> tuple[float, float, float]:
    """Margins to the OPEN set: before the zone and the edge [m], below the speed limit [m/s].

    The first two are what is left when the chaser has stopped.
    Of all true states within the errors of `state`, those of the worst.
    """
    rho, c, speed = closing(state)
    near = rho - error_m
    slower = speed_limit(near, g) - speed - error_m_s
    if g.keep_out_m <= 0.0:
        return FAR, FAR, slower
    left = g.domain_m - rho - error_m
    if near <= 0.0:
        return near - g.keep_out_m, left, slower
    doubt = error_m_s + speed * error_m / near
    inward, outward = c + doubt, doubt - c
    stop = inward * inward / (2.0 * authority(rho + error_m, g)) if inward > 0.0 else 0.0
    back = outward * outward / (2.0 * g.edge_m_s2) if outward > 0.0 else 0.0
    return near - g.keep_out_m - stop, left - back, slower


@kernel
def open_margins(state: State, error_m: float, error_m_s: float, g: Guard) -> tuple[float, float]:
    """Margins to the OPEN set: left when stopped [m], and below the speed limit [m/s].

    Of all true states within the errors of `state`, those of the worst.
    """
    zone, edge, slower = both_margins(state, error_m, error_m_s, g)
    return (zone if zone < edge else edge), slower


@kernel
def push_needed(
    gap_m: float, closing_m_s: float, authority_m_s2: float, push_n: float, g: Guard
) -> float:
    """Thrust [N] of this tick against closing in, after which the chaser can stop within the gap.

    authority_m_s2 : what a thrust of `push_n` gives for certain
    """
    need = needed_deceleration(gap_m, closing_m_s, authority_m_s2, g.dt_s)
    # What the authority leaves out: the needed deceleration is of the chaser, this is the thrust.
    return push_n - g.mass_kg * (authority_m_s2 - need) if need < authority_m_s2 else push_n


@kernel
def backup_open(state: State, g: Guard) -> Vector:
    """Backup law [N] of the OPEN set: stop; along the range first, as zone and edge need at least.

    Its norm is at most the limit of one axis, so that any direction is within the box.
    """
    x, y, z, vx, vy, vz = state
    rho, c, speed = closing(state)
    stop = g.mass_kg / g.dt_s
    if speed <= 0.0 and g.keep_out_m <= 0.0:
        return 0.0, 0.0, 0.0
    if g.keep_out_m <= 0.0 or rho <= 0.0:
        k = stop if stop * speed < g.limit_n else g.limit_n / speed
        return -k * vx, -k * vy, -k * vz
    ex, ey, ez = x / rho, y / rho, z / rho
    near = rho - g.here_m
    turned = speed * g.here_m / near if near > 0.0 else speed
    a, left = authority(rho + g.here_m, g), g.domain_m - rho - g.here_m
    out = push_needed(near - g.keep_out_m, c + g.here_m_s + turned, a, g.brake_n, g)
    back = push_needed(left, turned + g.here_m_s - c, g.edge_m_s2, g.brake_n, g)
    radial = stop * c
    radial = radial if radial < -back else -back
    radial = out if radial < out else radial
    radial = saturate(radial, g.brake_n)
    tx, ty, tz = vx + c * ex, vy + c * ey, vz + c * ez
    across = sqrt(tx * tx + ty * ty + tz * tz)
    left = sqrt(g.limit_n * g.limit_n - radial * radial)
    k = stop if stop * across < left else left / across
    return radial * ex - k * tx, radial * ey - k * ty, radial * ez - k * tz


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
