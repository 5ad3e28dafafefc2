# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The inner loop of true dynamics: the target's orbit, and the chaser's motion relative to it.

Kernels of + - * / sqrt and comparisons (`rpo_core.kernels.jit`), the same bits everywhere. Both
motions are integrated by the Runge-Kutta method of fourth order, at a fixed step. Half-way through
a step the target is where Hermite's cubic between both ends puts it.

The chaser's state is (x, y, z, ux, uy, uz): relative position and inertial relative velocity, both
in axes of `target_lvlh`. So its equations need the rate w of the frame, not the derivative of w:

    r' = u - w x r,    u' = a - w x u

Only differences of gravity are computed, by Encke's method, so that nothing cancels.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.kernels.arithmetic import State, Vector
from rpo_core.kernels.jit import inlined, kernel

_LN_2_A = (
    0.6931471803691238  # ln 2 in two parts; the first has 32 bits, so that k times it is exact
)
_LN_2_B = 1.9082149292705877e-10


class Environment(NamedTuple):
    """What pulls at both spacecraft.

    mu : [m^3/s^2]; j2 : 3/2 J2 mu Re^2 [m^5/s^2], 0 without
    density : at the distance `reference` [m] from the centre of the body [kg/m^3], 0 without drag
    thinning : 1 / scale height [1/m], 0 where the density is constant
    spin : of the atmosphere with the body [rad/s]
    target, chaser : C_D A / m, the inverse of the ballistic coefficient [m^2/kg]
    linear : 1 where gravity is linear in the relative position, else 0
    """

    mu: float
    j2: float
    density: float
    reference: float
    thinning: float
    spin: float
    target: float
    chaser: float
    linear: int


COLUMNS = 11
"""Numbers of a row of the target's orbit: distance R [m] from the body's centre; rate of LVLH about
its x and its z axis [rad/s] (that about y is zero); inertial velocity along x and y [m/s]; the
body's pole, unit vector in LVLH; what accelerates the target beside point-mass gravity, in LVLH
[m/s^2]."""


@inlined
def exponential(x: float) -> float:
    """e^x, from + - * / only, right to 2e-15 of itself; 0 below -700, e^700 above 700."""
    if x < -700.0:
        return 0.0
    x = 700.0 if x > 700.0 else x
    turns = x * 1.4426950408889634
    k = int(turns + 0.5) if turns >= 0.0 else int(turns - 0.5)
    r = (x - k * _LN_2_A) - k * _LN_2_B
    # fmt: off
    tail = 1 / 40320 + r * (1 / 362880 + r * (1 / 3628800 + r * (1 / 39916800 + r * (
        1 / 479001600 + r * (1 / 6227020800)))))
    total = 1.0 + r * (1.0 + r * (1 / 2 + r * (1 / 6 + r * (1 / 24 + r * (1 / 120 + r * (
        1 / 720 + r * (1 / 5040 + r * tail)))))))
    # fmt: on
    # By 2^k, exactly: bit by bit of k, so that it becomes SIMD.
    size, factor = abs(k), 2.0 if k > 0 else 0.5
    for bit in range(10):
        total *= factor if size >> bit & 1 else 1.0
        factor *= factor
    return total


@inlined
def pull(
    position: Vector, velocity: Vector, pole: Vector, inverse: float, w: Environment
) -> Vector:
    """Acceleration (3,) [m/s^2] beside point-mass gravity: the body's J2, and drag.

    J2 as in Vallado, Fundamentals of Astrodynamics and Applications, equation 8-30, for any axes.

    position : from the centre of the body; velocity : inertial; pole : unit vector; all in the
        same axes
    inverse : of the ballistic coefficient [m^2/kg]
    """
    x, y, z = position
    px, py, pz = pole
    square = x * x + y * y + z * z
    radius = sqrt(square)
    ax = ay = az = 0.0
    if w.j2 != 0.0:
        height = x * px + y * py + z * pz
        factor = -w.j2 / (square * square * radius)
        along = 1.0 - 5.0 * height * height / square
        ax = factor * (along * x + 2.0 * height * px)
        ay = factor * (along * y + 2.0 * height * py)
        az = factor * (along * z + 2.0 * height * pz)
    if w.density != 0.0:
        vx = velocity[0] - w.spin * (py * z - pz * y)
        vy = velocity[1] - w.spin * (pz * x - px * z)
        vz = velocity[2] - w.spin * (px * y - py * x)
        density = w.density
        if w.thinning != 0.0:
            density *= exponential((w.reference - radius) * w.thinning)
        factor = -0.5 * density * inverse * sqrt(vx * vx + vy * vy + vz * vz)
        ax += factor * vx
        ay += factor * vy
        az += factor * vz
    return ax, ay, az


@inlined
def moved(s: State, rate: State, h: float) -> State:
    """Return s + h * rate."""
    return (
        s[0] + h * rate[0],
        s[1] + h * rate[1],
        s[2] + h * rate[2],
        s[3] + h * rate[3],
        s[4] + h * rate[4],
        s[5] + h * rate[5],
    )


@inlined
def gathered(a: State, b: State, c: State, d: State) -> State:
    """Return the mean rate of a step of Runge and Kutta from those at its four points."""
    return (
        (a[0] + 2.0 * (b[0] + c[0]) + d[0]) / 6.0,
        (a[1] + 2.0 * (b[1] + c[1]) + d[1]) / 6.0,
        (a[2] + 2.0 * (b[2] + c[2]) + d[2]) / 6.0,
        (a[3] + 2.0 * (b[3] + c[3]) + d[3]) / 6.0,
        (a[4] + 2.0 * (b[4] + c[4]) + d[4]) / 6.0,
        (a[5] + 2.0 * (b[5] + c[5]) + d[5]) / 6.0,
    )


@inlined
def target_rate(s: State, w: Environment) -> State:
    """Return the derivative of the target's inertial state (6,); the body's pole is the z axis."""
    x, y, z, vx, vy, vz = s
    square = x * x + y * y + z * z
    k = -w.mu / (square * sqrt(square))
    ax, ay, az = pull((x, y, z), (vx, vy, vz), (0.0, 0.0, 1.0), w.target, w)
    return vx, vy, vz, k * x + ax, k * y + ay, k * z + az


@inlined
def target_step(s: State, a: State, h: float, w: Environment) -> State:
    """Target's inertial state (6,) [m, m/s] a time h [s] later; a is its derivative now."""
    b = target_rate(moved(s, a, 0.5 * h), w)
    c = target_rate(moved(s, b, 0.5 * h), w)
    d = target_rate(moved(s, c, h), w)
    return moved(s, gathered(a, b, c, d), h)


@inlined
def orbit_row(s: State, w: Environment) -> tuple[float, ...]:
    """Row of `COLUMNS` numbers of a target's inertial state (6,).

    LVLH turns about z by h / R^2, and about x by R a_z / h, where the acceleration a_z leaves the
    plane of the orbit; h is the angular momentum.
    """
    x, y, z, vx, vy, vz = s
    radius = sqrt(x * x + y * y + z * z)
    hx, hy, hz = y * vz - z * vy, z * vx - x * vz, x * vy - y * vx
    momentum = sqrt(hx * hx + hy * hy + hz * hz)
    across = momentum / radius
    outward = (x * vx + y * vy + z * vz) / radius
    pole = (z / radius, (hx * y - hy * x) / (momentum * radius), hz / momentum)
    a = pull((radius, 0.0, 0.0), (outward, across, 0.0), pole, w.target, w)
    about_x, about_z = a[2] / across, across / radius
    return (
        radius, about_x, about_z, outward, across, pole[0], pole[1], pole[2], a[0], a[1], a[2]
    )  # fmt: skip


@inlined
def middle(s: State, rate: State, after: State, rate_after: State, h: float) -> State:
    """State half-way through a step: Hermite's cubic, wrong by h^4 / 384 of the 4th derivative."""
    e = 0.125 * h
    return (
        0.5 * (s[0] + after[0]) + e * (rate[0] - rate_after[0]),
        0.5 * (s[1] + after[1]) + e * (rate[1] - rate_after[1]),
        0.5 * (s[2] + after[2]) + e * (rate[2] - rate_after[2]),
        0.5 * (s[3] + after[3]) + e * (rate[3] - rate_after[3]),
        0.5 * (s[4] + after[4]) + e * (rate[4] - rate_after[4]),
        0.5 * (s[5] + after[5]) + e * (rate[5] - rate_after[5]),
    )


@kernel
def fill_row(s: State, w: Environment, row: Any) -> None:
    """Fill a row of the orbit (COLUMNS,)."""
    found = orbit_row(s, w)
    for j in range(COLUMNS):
        row[j] = found[j]


@kernel
def fill_orbit(s: State, h: float, w: Environment, rows: NDArray[np.float64]) -> State:
    """Fill rows (2 n + 1, COLUMNS) of n steps of h [s], two for each; return the last state."""
    fill_row(s, w, rows[0])
    rate = target_rate(s, w)
    for i in range(1, len(rows), 2):
        after = target_step(s, rate, h, w)
        rate_after = target_rate(after, w)
        fill_row(middle(s, rate, after, rate_after, h), w, rows[i])
        fill_row(after, w, rows[i + 1])
        s, rate = after, rate_after
    return s


@inlined
def relative_rate(s: State, push: Vector, lightness: float, o: Any, w: Environment) -> State:
    """Return the derivative of the chaser's state (x, y, z, ux, uy, uz).

    push : force over mass (3,) [m/s^2]
    lightness : mass at the start over mass now
    o : row of the target's orbit
    """
    x, y, z, ux, uy, uz = s
    radius, about_x, about_z = o[0], o[1], o[2]
    k = w.mu / (radius * radius * radius)
    ax, ay, az = push
    if w.linear == 1:
        ax += 2.0 * k * x
        ay -= k * y
        az -= k * z
    else:
        # Battin, Mathematics and Methods of Astrodynamics (1999), section 8.7: -k (d + F(q) r).
        away = radius + x
        q = -(x * (away + radius) + y * y + z * z) / (away * away + y * y + z * z)
        f = q * (3.0 + q * (3.0 + q)) / (1.0 + (1.0 + q) * sqrt(1.0 + q))
        ax -= k * (x + f * away)
        ay -= k * (y + f * y)
        az -= k * (z + f * z)
    if w.j2 != 0.0 or w.density != 0.0:
        velocity, pole = (o[3] + ux, o[4] + uy, uz), (o[5], o[6], o[7])
        own = pull((radius + x, y, z), velocity, pole, w.chaser * lightness, w)
        ax += own[0] - o[8]
        ay += own[1] - o[9]
        az += own[2] - o[10]
    return (
        ux + about_z * y,
        uy - about_z * x + about_x * z,
        uz - about_x * y,
        ax + about_z * uy,
        ay - about_z * ux + about_x * uz,
        az - about_x * uy,
    )


@inlined
def relative_after(
    s: State,
    push: Vector,
    lightness: float,
    begin: Any,
    middle: Any,
    end: Any,
    h: float,
    w: Environment,
) -> State:
    """Return the chaser's state (x, y, z, ux, uy, uz) a step of h [s] later.

    begin, middle, end : rows of the target's orbit
    """
    a = relative_rate(s, push, lightness, begin, w)
    b = relative_rate(moved(s, a, 0.5 * h), push, lightness, middle, w)
    c = relative_rate(moved(s, b, 0.5 * h), push, lightness, middle, w)
    d = relative_rate(moved(s, c, h), push, lightness, end, w)
    return moved(s, gathered(a, b, c, d), h)


@inlined
def inertial(state: State, about_x: float, about_z: float) -> State:
    """Return (x, y, z, ux, uy, uz) of a state in LVLH, which turns about x and z [rad/s]."""
    x, y, z, vx, vy, vz = state
    return x, y, z, vx - about_z * y, vy + about_z * x - about_x * z, vz + about_x * y


@inlined
def turning(s: State, about_x: float, about_z: float) -> State:
    """Return the state in LVLH of (x, y, z, ux, uy, uz): the inverse of `inertial`."""
    x, y, z, ux, uy, uz = s
    return x, y, z, ux + about_z * y, uy - about_z * x + about_x * z, uz - about_x * y


@kernel
def relative_step(
    state: State,
    push: Vector,
    lightness: float,
    rows: Any,
    first: int,
    steps: int,
    h: float,
    w: Environment,
) -> State:
    """Chaser's state (6,) [m, m/s], target LVLH, a tick of `steps` steps of h [s] later.

    push : force over mass (3,) [m/s^2], constant in the axes of LVLH during the tick
    rows : of the target's orbit, two for each step; `first` is that of the beginning of the tick
    """
    o = rows[first]
    s = inertial(state, o[1], o[2])
    for i in range(first, first + 2 * steps, 2):
        begin, middle, end = rows[i], rows[i + 1], rows[i + 2]
        s = relative_after(s, push, lightness, begin, middle, end, h, w)
    o = rows[first + 2 * steps]
    return turning(s, o[1], o[2])
