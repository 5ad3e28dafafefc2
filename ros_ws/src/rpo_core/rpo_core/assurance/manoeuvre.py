# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Collision avoidance, hold and retreat: a velocity that the thrusters bring the chaser to.

An abort is a velocity from which the chaser drifts clear, found before it is flown. The thrusters
bring the chaser to it and hold it until any stuck thruster is known to be shut; then they fall
silent. For each candidate the path is computed with no thruster stuck, and with each of the six
stuck on; with the velocity at the end off to both sides along the orbit; with drag between two
bounds. Its margin is the least distance of all these paths, and the candidate with the largest
margin is flown.

The drift is that of Clohessy and Wiltshire in closed form, with a constant acceleration along the
orbit, unknown within bounds: differential drag. At each moment the chaser is on a segment, between
its places for both bounds. Its distance to the target changes at most as fast as the largest speed
of the drift, so the check goes on by such steps, and misses no moment between them.

The filter follows a hold or a retreat as every command, so the assured sets are kept.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from rpo_core.assurance.kernels import Guard, closing, speed_limit
from rpo_core.kernels.arithmetic import State, Vector, norm, saturate, sin_cos
from rpo_core.kernels.jit import kernel
from rpo_core.world.cw import CwStep, cw_step

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


RESPONSE_S = 1.0
"""Time constant with which the thrusters bring the chaser to a velocity."""

STEP_S = 0.5
"""Segment of the predicted burn."""

TOLERANCE_M = 0.05
"""A computed least distance is so much too small at most; it counts as less by so much."""

SPEEDS_M_S = (0.1, 0.2, 0.4)

DIRECTIONS: tuple[Vector, ...] = tuple(
    (
        x / sqrt(x * x + y * y + z * z),
        y / sqrt(x * x + y * y + z * z),
        z / sqrt(x * x + y * y + z * z),
    )
    for x in (-1.0, 0.0, 1.0)
    for y in (-1.0, 0.0, 1.0)
    for z in (-1.0, 0.0, 1.0)
    if x or y or z
)
"""The axes of target LVLH, and the diagonals between them."""


class PathModel(NamedTuple):
    """What a path is computed with.

    n_rad_s, mass_kg, limit_n : mean motion, mass, largest |f| of an axis
    stuck_s, burn_s : a thruster is stuck on for at most so long; longest burn
    drift_s : so long the drift shall be clear
    drag_m_s2 : largest acceleration along the orbit, either way
    error_m_s : the velocity at the end of the burn is known to so much
    done_m_s : the burn is over when the wanted velocity is reached to so much
    """

    n_rad_s: float
    mass_kg: float
    limit_n: float
    stuck_s: float
    burn_s: float
    drift_s: float
    drag_m_s2: float
    error_m_s: float
    done_m_s: float


@kernel
def towards(state: State, wanted: Vector, response_s: float, w: PathModel) -> Vector:
    """Force [N] that brings a velocity to the wanted one, within the limit of each axis.

    It makes up for gravity and Coriolis, so that the wanted velocity is reached.
    """
    x, _, z, vx, vy, vz = state
    m, n, k = w.mass_kg, w.n_rad_s, 1.0 / response_s
    return (
        saturate(m * (k * (wanted[0] - vx) - 3.0 * n * n * x - 2.0 * n * vy), w.limit_n),
        saturate(m * (k * (wanted[1] - vy) + 2.0 * n * vx), w.limit_n),
        saturate(m * (k * (wanted[2] - vz) + n * n * z), w.limit_n),
    )


@kernel
def with_stuck(force: float, side: float, limit: float) -> float:
    """Force [N] of an axis one of whose thrusters is stuck on: the other one can only oppose it."""
    against = force if force * side < 0.0 else 0.0
    return side * limit + against


@kernel
def reached(state: State, wanted: Vector, tolerance_m_s: float) -> bool:
    """Whether a velocity is the wanted one."""
    dx, dy, dz = wanted[0] - state[3], wanted[1] - state[4], wanted[2] - state[5]
    return dx * dx + dy * dy + dz * dz <= tolerance_m_s * tolerance_m_s


@kernel
def nearest(state: State, w: PathModel, floor_m: float) -> float:
    """Least distance [m] of a drift to the target, to TOLERANCE_M; less than a floor: anything.

    The velocity across y is known to an error e, so the place to less than 1.5 e t and 4.3 e / n.
    """
    n, e = w.n_rad_s, w.error_m_s
    speed = fastest(state, w.drift_s, n, w.drag_m_s2) + 1.5 * e + 1e-12
    t, found = 0.0, 1e30
    while t < w.drift_s:
        near = drifted(state, t, n, -w.drag_m_s2)
        distance = to_segment(near, drifted(state, t, n, w.drag_m_s2))
        distance -= 1.5 * e * t if 1.5 * t < 4.3 / n else 4.3 * e / n
        found = distance if distance < found else found
        if found < floor_m:
            return found
        t += (distance - found + TOLERANCE_M) / speed
    return found - TOLERANCE_M


@kernel
def drift_margin(state: State, w: PathModel, floor_m: float) -> float:
    """Least distance [m] of the drifts from a state whose velocity is known to an error."""
    x, y, z, vx, vy, vz = state
    found = 1e30
    for side in (-1.0, 1.0):
        off = (x, y, z, vx, vy + side * w.error_m_s, vz)
        near = nearest(off, w, floor_m)
        found = near if near < found else found
        if found < floor_m or w.error_m_s == 0.0:
            return found
    return found


@kernel
def burn_margin(
    state: State, wanted: Vector, stuck: int, c: CwStep, w: PathModel, floor_m: float
) -> tuple[float, State]:
    """Least distance [m] while the thrusters bring the chaser to a velocity; its state after that.

    stuck : 0 for none, 1 to 6 for the thruster that pushes to +x, -x, +y, -y, +z, -z
    c : step of STEP_S
    """
    found, t = 1e30, 0.0
    while t < w.stuck_s or (t < w.burn_s and not reached(state, wanted, w.done_m_s)):
        fx, fy, fz = towards(state, wanted, RESPONSE_S, w)
        if stuck > 0 and t < w.stuck_s:
            side = 1.0 if stuck % 2 == 1 else -1.0
            fx = with_stuck(fx, side, w.limit_n) if stuck <= 2 else fx
            fy = with_stuck(fy, side, w.limit_n) if 2 < stuck <= 4 else fy
            fz = with_stuck(fz, side, w.limit_n) if stuck > 4 else fz
        after = cw_step(state, (fx, fy, fz), c)
        near = to_segment((state[0], state[1], state[2]), (after[0], after[1], after[2]))
        found = near if near < found else found
        if found < floor_m:
            return found, state
        state = after
        t += STEP_S
    return found - TOLERANCE_M, state


@kernel
def margin(state: State, wanted: Vector, c: CwStep, w: PathModel, floor_m: float) -> float:
    """Least distance [m] of a manoeuvre and the drift after it, whichever thruster is stuck."""
    found = 1e30
    for stuck in range(7):
        near, after = burn_margin(state, wanted, stuck, c, w, floor_m)
        found = near if near < found else found
        if found < floor_m:
            return found
        near = drift_margin(after, w, floor_m)
        found = near if near < found else found
        if found < floor_m:
            return found
    return found


class Choice(NamedTuple):
    """A manoeuvre.

    velocity_m_s : (3,) that the thrusters bring the chaser to
    margin_m : least distance of its paths to the target, less the radius that they shall keep;
        negative: no candidate is clear, and this one is the best of them
    """

    velocity_m_s: Vector
    margin_m: float


def choose(
    state: State,
    radius_m: float,
    c: CwStep,
    w: PathModel,
    fastest_m_s: float = SPEEDS_M_S[-1],
    only: Vector | None = None,
) -> Choice:
    """Return the candidate whose paths keep the largest distance.

    radius_m : of the sphere that they shall keep out of
    c : step of STEP_S
    fastest_m_s : no candidate is faster
    only : the one direction (3,) in which it may go, as in a corridor; None: any

    Of candidates that are as good, it is the slowest.
    """
    x, y, z = state[:3]
    rho = sqrt(x * x + y * y + z * z)
    away = (x / rho, y / rho, z / rho) if rho > 0.0 else (0.0, 1.0, 0.0)
    directions = (away, *DIRECTIONS) if only is None else (only,)
    best, best_m = (0.0, 0.0, 0.0), -1.0
    speeds = [speed for speed in SPEEDS_M_S if speed <= fastest_m_s] or [fastest_m_s]
    for speed in speeds:
        for dx, dy, dz in directions:
            wanted = (speed * dx, speed * dy, speed * dz)
            margin_m = margin(state, wanted, c, w, best_m + TOLERANCE_M)
            if margin_m >= best_m + TOLERANCE_M:
                best, best_m = wanted, margin_m
    return Choice(best, best_m - radius_m)


RECOVERY_S = 2.0
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


@kernel
def holding(state: State, point_m: Vector, w: PathModel) -> Vector:
    """Return the force (3,) [N] that keeps the chaser at a point (3,) [m]."""
    return towards(state, to_point(state, point_m, HOLD_M_S), RECOVERY_S, w)


@kernel
def retreating(state: State, point_m: Vector, radius_m: float, w: PathModel, g: Guard) -> Vector:
    """Return the force (3,) [N] towards a point (3,) [m], around a sphere about the target."""
    speed = LIMIT_SHARE * speed_limit(closing(state)[0], g)
    speed = speed if speed < RETREAT_M_S else RETREAT_M_S
    wanted = to_point(state, point_m, speed)
    return towards(state, around(state, wanted, radius_m), RECOVERY_S, w)


@kernel
def to_point(state: State, point_m: Vector, speed_m_s: float) -> Vector:
    """Return the velocity (3,) [m/s] towards a point, slower where it is near."""
    gx, gy, gz = point_m[0] - state[0], point_m[1] - state[1], point_m[2] - state[2]
    distance = norm(gx, gy, gz)
    k = speed_m_s / distance if distance > 0.0 else 0.0
    k = k if k < APPROACH_1_S else APPROACH_1_S
    return k * gx, k * gy, k * gz


@kernel
def around(state: State, wanted: Vector, radius_m: float) -> Vector:
    """Return a velocity (3,) [m/s] that passes a sphere instead of one that leads into it."""
    radius = radius_m + PASSING_M
    x, y, z = state[0], state[1], state[2]
    speed, rho = norm(wanted[0], wanted[1], wanted[2]), norm(x, y, z)
    if radius_m <= 0.0 or speed == 0.0 or rho == 0.0:
        return wanted
    inward = -(x * wanted[0] + y * wanted[1] + z * wanted[2]) / speed
    left = rho * rho - inward * inward
    past = sqrt(left if left > 0.0 else 0.0)
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
    sine = radius / rho if radius < rho else 1.0
    out = -speed * sqrt(1.0 - sine * sine)
    if rho < radius:
        out = APPROACH_1_S * (radius - rho)
        out = out if out < speed else speed
    k = sqrt(speed * speed - out * out) / size
    return k * tx + out * ex, k * ty + out * ey, k * tz + out * ez
