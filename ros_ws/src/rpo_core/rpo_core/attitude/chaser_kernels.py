# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How the chaser turns: a rigid body with three wheels, on a circular orbit.

Kernels of + - * / and sqrt (`kernels.jit`), the same bits everywhere. Quaternions and rates as
in `attitude_kernels`. Torque, force and momentum are in the chaser's axes unless said otherwise.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from rpo_core.attitude.attitude_kernels import (
    Attitude,
    Body,
    accelerated,
    body_at,
    cross,
    momentum_of,
    plus,
    turning_at,
)
from rpo_core.kernels.arithmetic import State, Vector, saturate
from rpo_core.kernels.jit import inlined, kernel

Quaternion = tuple[float, float, float, float]


class Craft(NamedTuple):
    """A chaser as the kernels read it.

    body : its inertia, and the orbit
    gradient : 3 n^2 where gravity turns it [rad^2/s^2]; 0.0 where not
    torque, momentum : largest of a wheel, one along each axis [N m], [N m s]; 0.0: no wheels
    x, y, z : torque from outside [N m]
    """

    body: Body
    gradient: float
    torque: float
    momentum: float
    x: float
    y: float
    z: float


@inlined
def craft_at(t, i: int, n: int) -> Craft:  # type: ignore[no-untyped-def]
    """Return the craft whose numbers lie in a flat table from place i on, n places apart."""
    body = body_at(t[i], t, i + n, n)
    i = i + 14 * n
    return Craft(body, t[i], t[i + n], t[i + 2 * n], t[i + 3 * n], t[i + 4 * n], t[i + 5 * n])


@inlined
def turn(v: Vector, q: Quaternion) -> Vector:
    """Return a vector of the body's axes in target LVLH."""
    u = (q[0], q[1], q[2])
    x, y, z = cross(u, v)
    x, y, z = x + x, y + y, z + z
    a, b, c = cross(u, (x, y, z))
    return v[0] + q[3] * x + a, v[1] + q[3] * y + b, v[2] + q[3] * z + c


@inlined
def turn_back(v: Vector, q: Quaternion) -> Vector:
    """Return a vector of target LVLH in the body's axes."""
    return turn(v, (-q[0], -q[1], -q[2], q[3]))


@inlined
def times(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the attitude q, then p."""
    a, b, c, d = p
    x, y, z, w = q
    return (
        d * x + w * a + b * z - c * y,
        d * y + w * b + c * x - a * z,
        d * z + w * c + a * y - b * x,
        d * w - a * x - b * y - c * z,
    )


@inlined
def relative_to(p: Quaternion, q: Quaternion) -> Quaternion:
    """Return the attitude q as a body with the attitude p sees it."""
    return times((-p[0], -p[1], -p[2], p[3]), q)


@inlined
def upright(q: Quaternion) -> Quaternion:
    """Return a quaternion of length 1 with w >= 0."""
    x, y, z, w = q
    size = sqrt(x * x + y * y + z * z + w * w)
    size = size if w >= 0.0 else -size
    return x / size, y / size, z / size, w / size


@inlined
def _change(a: Attitude, h: Vector, torque: Vector, c: Craft) -> Attitude:
    """Return the derivative of an attitude; h : momentum of the wheels now [N m s].

    Gravity pulls the long axis towards the vertical: 3 n^2 o x J o, o = x of LVLH (Hughes,
    "Spacecraft Attitude Dynamics", 1986, 8.1).
    """
    x, y, z, w, p, q, r = a
    b = c.body
    g = momentum_of((p, q, r), b)
    tx, ty, tz = cross((g[0] + h[0], g[1] + h[1], g[2] + h[2]), (p, q, r))
    tx, ty, tz = tx + torque[0], ty + torque[1], tz + torque[2]
    if c.gradient > 0.0:
        up = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w))
        ux, uy, uz = cross(up, momentum_of(up, b))
        tx, ty, tz = tx + c.gradient * ux, ty + c.gradient * uy, tz + c.gradient * uz
    return turning_at(a, b.orbit, accelerated((tx, ty, tz), b))


@inlined
def _ahead(v: Vector, h: float, rate: Vector) -> Vector:
    return v[0] + h * rate[0], v[1] + h * rate[1], v[2] + h * rate[2]


@inlined
def unit(a: Attitude) -> Attitude:
    """Return an attitude whose quaternion has length 1 and w >= 0."""
    x, y, z, w = upright((a[0], a[1], a[2], a[3]))
    return x, y, z, w, a[4], a[5], a[6]


@inlined
def chaser_step(
    a: Attitude, wheels: Vector, torque: Vector, spun: Vector, h: float, c: Craft
) -> Attitude:
    """Return the attitude a time h [s] later, by Runge and Kutta's method of fourth order.

    wheels : their momentum now; spun : its change a second; torque : on the body, that of the
    wheels too
    """
    half = _ahead(wheels, 0.5 * h, spun)
    k1 = _change(a, wheels, torque, c)
    k2 = _change(plus(a, 0.5 * h, k1), half, torque, c)
    k3 = _change(plus(a, 0.5 * h, k2), half, torque, c)
    k4 = _change(plus(a, h, k3), _ahead(wheels, h, spun), torque, c)
    s = plus(plus(a, h / 6.0, k1), h / 3.0, k2)
    return unit(plus(plus(s, h / 3.0, k3), h / 6.0, k4))


@inlined
def _spun(wanted: float, momentum: float, dt: float, c: Craft) -> float:
    """Return the torque that a wheel takes from the body: limited, and none beyond its momentum."""
    torque = c.torque if wanted > c.torque else -c.torque if wanted < -c.torque else wanted
    after = momentum - torque * dt
    if after > c.momentum:
        return (momentum - c.momentum) / dt
    return (momentum + c.momentum) / dt if after < -c.momentum else torque


@inlined
def _against(momentum: float, above: float, torque: float) -> float:
    return -torque if momentum > above else torque if momentum < -above else 0.0


@kernel
def unloaded(wheels: Vector, above: float, torque: float, dt: float) -> tuple[Vector, Vector]:
    """Return the torque [N m] of thrusters on each wheel above a momentum [N m s], to empty it.

    And the momentum of the wheels after a tick of it; torque : 0.0 where none are unloaded
    """
    if torque == 0.0:
        return (0.0, 0.0, 0.0), wheels
    x, y, z = wheels
    u = (_against(x, above, torque), _against(y, above, torque), _against(z, above, torque))
    return u, _ahead(wheels, dt, u)


@inlined
def wheels_after(wheels: Vector, torque: Vector, dt: float, most: float) -> Vector:
    """Return the momentum (3,) [N m s] of wheels that exert a torque on the body for a tick."""
    return (
        saturate(wheels[0] - torque[0] * dt, most),
        saturate(wheels[1] - torque[1] * dt, most),
        saturate(wheels[2] - torque[2] * dt, most),
    )


@inlined
def chaser_tick(
    a: Attitude, wheels: Vector, wanted: Vector, outside: Vector, dt: float, c: Craft
) -> tuple[Attitude, Attitude, Vector]:
    """Return the attitude in the middle and at the end of a tick, and the momentum of the wheels.

    wanted : torque that the wheels shall exert on the body [N m]; outside : other torque, beside
    that of the craft
    """
    mine = (
        _spun(wanted[0], wheels[0], dt, c),
        _spun(wanted[1], wheels[1], dt, c),
        _spun(wanted[2], wheels[2], dt, c),
    )
    spun = (-mine[0], -mine[1], -mine[2])
    torque = (
        mine[0] + outside[0] + c.x, mine[1] + outside[1] + c.y, mine[2] + outside[2] + c.z,
    )  # fmt: skip
    h = 0.5 * dt
    middle = chaser_step(a, wheels, torque, spun, h, c)
    half = _ahead(wheels, h, spun)
    end = chaser_step(middle, half, torque, spun, h, c)
    return middle, end, _ahead(half, h, spun)


@inlined
def turned_force(
    force: Vector, begin: Attitude, middle: Attitude, end: Attitude, dt: float, orbit: float
) -> tuple[Vector, State]:
    """Return the mean of a force that turns with the body [N], and what it shifts the chaser.

    By Simpson's rule; both in target LVLH. The second is position x mass [N s^2] and velocity x
    mass [N s], beyond what the mean gives: a force that comes early moves the chaser farther than
    one that comes late, and Coriolis' force turns that into speed.
    """
    ax, ay, az = turn(force, (begin[0], begin[1], begin[2], begin[3]))
    bx, by, bz = turn(force, (middle[0], middle[1], middle[2], middle[3]))
    cx, cy, cz = turn(force, (end[0], end[1], end[2], end[3]))
    k, twice = dt * dt / 12.0, orbit + orbit
    x, y, z = k * (ax - cx), k * (ay - cy), k * (az - cz)
    return (
        ((ax + 4.0 * bx + cx) / 6.0, (ay + 4.0 * by + cy) / 6.0, (az + 4.0 * bz + cz) / 6.0),
        (x, y, z, twice * y, -twice * x, 0.0),
    )
