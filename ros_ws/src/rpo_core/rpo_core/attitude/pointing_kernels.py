# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Where a chaser shall look, and how it lies at contact: + - * / and sqrt, the same bits.

Quaternions are (x, y, z, w), scalar last. A turn from the chaser's axes to the target's is written
as docked attitude (`mate`), then the turn that points its docking axis.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from rpo_core.attitude.attitude_kernels import Attitude, Frame, cross, seen_from
from rpo_core.attitude.chaser_kernels import Quaternion, relative_to, times, turn, turn_back
from rpo_core.kernels.arithmetic import State, Vector, norm, saturate
from rpo_core.kernels.jit import inlined, kernel

DEGREES = 57.29577951308232

SETTLE_S = 5.0
"""Time in which the chaser settles about its docking axis."""

_SMALL = 1e-9
"""Cosine of half a turn below which its axis is not known."""


class Aim(NamedTuple):
    """Section `pointing`, as the kernels read it.

    port : (3,) [m]; axis : (3,) of the docking axis when docked; aside : (3,) across it; all in
        the target's axes, the latter unit vectors
    mate : quaternion from the chaser's axes to the target's when docked
    own : (3,) the docking axis in the chaser's axes, a unit vector
    near_m, width_m : distance of the port within which the chaser is aligned, and of the passage
    most_rad_s, sine : largest rate against the target; sine of half of it in a tick
    dt : of a tick [s]
    """

    port: Vector
    axis: Vector
    aside: Vector
    mate: Quaternion
    own: Vector
    near_m: float
    width_m: float
    most_rad_s: float
    sine: float
    dt: float


@inlined
def looking(seen: State, aim: Aim) -> tuple[Quaternion, Vector]:
    """Return the smallest turn from the docked attitude that looks at the port, and its rate.

    seen : state (6,) [m, m/s] as the target sees it
    Quaternion in the target's axes, rate (3,) [rad/s] in the turned ones. Near the port no turn.
    """
    none, rest = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    x, y, z = aim.port[0] - seen[0], aim.port[1] - seen[1], aim.port[2] - seen[2]
    distance = norm(x, y, z)
    if distance <= aim.near_m:
        return none, rest
    x, y, z = x / distance, y / distance, z / distance
    grows = -(x * seen[3] + y * seen[4] + z * seen[5])
    along = (distance - aim.near_m) / aim.width_m
    share, more = 1.0, 0.0
    if along < 1.0:
        share = along * along * (3.0 - 2.0 * along)
        more = 6.0 * along * (1.0 - along) * grows / aim.width_m
    a, by = aim.axis, share / distance
    # from the docked axis a to what is looked at, and the change of that
    dx, dy, dz = x - a[0], y - a[1], z - a[2]
    b = (a[0] + share * dx, a[1] + share * dy, a[2] + share * dz)
    c = (
        more * dx - by * (seen[3] + x * grows),
        more * dy - by * (seen[4] + y * grows),
        more * dz - by * (seen[5] + z * grows),
    )
    size = norm(b[0], b[1], b[2])
    w = size + a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
    if w <= _SMALL:  # it looks the other way: about any axis across
        return (aim.aside[0], aim.aside[1], aim.aside[2], 0.0), rest
    u, du = cross(a, b), cross(a, c)
    dw = (b[0] * c[0] + b[1] * c[1] + b[2] * c[2]) / size
    dw += a[0] * c[0] + a[1] * c[1] + a[2] * c[2]
    turned = cross(u, du)
    square = u[0] * u[0] + u[1] * u[1] + u[2] * u[2] + w * w
    length, twice = sqrt(square), 2.0 / square
    return (u[0] / length, u[1] / length, u[2] / length, w / length), (
        twice * (w * du[0] - dw * u[0] - turned[0]),
        twice * (w * du[1] - dw * u[1] - turned[1]),
        twice * (w * du[2] - dw * u[2] - turned[2]),
    )


@inlined
def limited(q: Quaternion, rate: Vector, before: Quaternion, aim: Aim) -> tuple[Quaternion, Vector]:
    """Return a turn that follows a wanted one, and its rate: first the docking axis, then about it.

    q, rate : wanted turn, and its rate (3,) [rad/s] in the chaser's axes
    before : turn of the tick before; zeros where there was none
    The axis turns at most at the largest rate; so does the chaser about it, and settles there.
    """
    a, most = aim.own, aim.most_rad_s
    along = rate[0] * a[0] + rate[1] * a[1] + rate[2] * a[2]
    x, y, z = rate[0] - along * a[0], rate[1] - along * a[1], rate[2] - along * a[2]
    size = norm(x, y, z)
    share = most / size if size > most else 1.0
    across = (share * x, share * y, share * z)
    if before[0] == 0.0 and before[1] == 0.0 and before[2] == 0.0 and before[3] == 0.0:
        along = saturate(along, most)
        return q, (across[0] + along * a[0], across[1] + along * a[1], across[2] + along * a[2])
    now, wanted = turn(a, before), turn(a, q)
    x, y, z = cross(now, wanted)
    w = 1.0 + now[0] * wanted[0] + now[1] * wanted[1] + now[2] * wanted[2]
    sine, size = norm(x, y, z), sqrt(x * x + y * y + z * z + w * w)
    if sine > aim.sine * size:
        x, y, z = x / sine, y / sine, z / sine
        cosine = sqrt(1.0 - aim.sine * aim.sine)
        found = times((aim.sine * x, aim.sine * y, aim.sine * z, cosine), before)
        return found, turn_back((most * x, most * y, most * z), found)
    swung = before
    if size > 0.0:
        swung = times((x / size, y / size, z / size, w / size), before)
    x, y, z, w = relative_to(swung, q)
    off = 2.0 * w * (x * a[0] + y * a[1] + z * a[2])  # a sine: no jump at half a turn
    about = saturate(along + (off - along * aim.dt) / SETTLE_S, most)
    half = 0.5 * about * aim.dt
    step = (half * a[0], half * a[1], half * a[2], sqrt(1.0 - half * half))
    found = times(swung, step)
    x, y, z = turn(across, relative_to(found, q))
    return found, (x + about * a[0], y + about * a[1], z + about * a[2])


@inlined
def pointed(
    state: State, target: Attitude, f: Frame, before: Quaternion, aim: Aim
) -> tuple[Attitude, Quaternion]:
    """Return the reference attitude of a chaser, and its turn from the target's axes.

    state : (6,) [m, m/s], target LVLH; target, f : attitude of the target, and its frame
    before : the turn of the tick before; zeros where there was none
    """
    q, rate = looking(seen_from(state, f), aim)
    q, rate = limited(times(q, aim.mate), turn_back(rate, aim.mate), before, aim)
    own = turn_back((target[4], target[5], target[6]), q)
    x, y, z, w = times((target[0], target[1], target[2], target[3]), q)
    side = 1.0 if w >= 0.0 else -1.0
    return (
        side * x, side * y, side * z, side * w,
        own[0] + rate[0], own[1] + rate[1], own[2] + rate[2],
    ), q  # fmt: skip


@inlined
def from_target(q: Quaternion, target: Attitude) -> Quaternion:
    """Return the turn from the axes of a chaser to those of the target; q : its attitude."""
    return relative_to((target[0], target[1], target[2], target[3]), q)


@kernel
def begun(q: Quaternion, target: Attitude) -> Quaternion:
    """Return `from_target`."""
    return from_target(q, target)


@kernel
def point(
    state: State, target: Attitude, f: Frame, before: Quaternion, aim: Aim
) -> tuple[Attitude, Quaternion]:
    """Return `pointed`."""
    return pointed(state, target, f, before, aim)


@inlined
def off_contact(chaser: Attitude, target: Attitude, mate: Quaternion) -> tuple[float, float]:
    """Return how far a chaser is turned from its docked attitude, and how fast it turns.

    The largest of the three angles [deg], each 2 sin(half of the turn) along an axis; the norm of
    the rate against the target [deg/s].
    """
    turned = from_target((chaser[0], chaser[1], chaser[2], chaser[3]), target)
    x, y, z, _ = relative_to(mate, turned)
    p = turn_back((target[4], target[5], target[6]), turned)
    rate = norm(chaser[4] - p[0], chaser[5] - p[1], chaser[6] - p[2])
    return 2.0 * DEGREES * max(abs(x), abs(y), abs(z)), DEGREES * rate


@kernel
def contact_turn(chaser: Attitude, target: Attitude, mate: Quaternion) -> tuple[float, float]:
    """Return `off_contact`."""
    return off_contact(chaser, target, mate)
