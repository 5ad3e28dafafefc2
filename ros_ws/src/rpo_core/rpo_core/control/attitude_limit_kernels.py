# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A torque that keeps limits of rate, pointing and wheels: + - * / and sqrt, the same bits.

docs/safety.md, lemma 7. Each axis has an interval of angular accelerations. The rate limit gives
one that ends with the tick. Each side of the pointing cone is a wall, which one may approach as
fast as the chaser still stops before it (lemma 1). The torque becomes that of the nearest
acceleration in all intervals.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

from rpo_core.attitude.attitude_kernels import cross, symmetric
from rpo_core.kernels.arithmetic import Vector
from rpo_core.kernels.jit import inlined, kernel

PASSED, LIMITED = 0, 1
"""What became of a torque."""

FAR = 1e30


class TorqueLimits(NamedTuple):
    """Limits as the kernel reads them, with what errors and a tick take of them.

    dt : tick [s]; 0.0: there are no limits
    jxx .. iyz : inertia [kg m^2], and its inverse
    torque, momentum : largest of each axis [N m], of a wheel [N m s]; FAR without wheels
    sure : angular acceleration that all axes have at once [rad/s^2]
    rate : largest, of each axis [rad/s]
    angle, within : half of the cone on each axis, and up to where it is kept [rad]; 0.0: no cone
    doubt : error of the rate towards a wall [rad/s]
    brake, off : authority before a wall, and what an acceleration may be off there [rad/s^2]
    """

    dt: float
    jxx: float
    jyy: float
    jzz: float
    jxy: float
    jxz: float
    jyz: float
    ixx: float
    iyy: float
    izz: float
    ixy: float
    ixz: float
    iyz: float
    torque: float
    momentum: float
    sure: float
    rate: float
    angle: float
    within: float
    doubt: float
    brake: float
    off: float


NUMBERS = 22
"""Numbers of limits."""

NONE = TorqueLimits(*(0.0,) * NUMBERS)
"""No limits."""


@inlined
def limits_at(t: Any, i: int) -> TorqueLimits:
    """Return the limits whose numbers lie in a flat table from place i on."""
    # fmt: off
    return TorqueLimits(
        t[i], t[i + 1], t[i + 2], t[i + 3], t[i + 4], t[i + 5], t[i + 6], t[i + 7], t[i + 8],
        t[i + 9], t[i + 10], t[i + 11], t[i + 12], t[i + 13], t[i + 14], t[i + 15], t[i + 16],
        t[i + 17], t[i + 18], t[i + 19], t[i + 20], t[i + 21],
    )
    # fmt: on


@inlined
def _towards(s: float, c: float, lim: TorqueLimits) -> float:
    """Largest acceleration [rad/s^2] towards a wall at a gap [rad] and closing rate [rad/s]."""
    dt, a = lim.dt, lim.brake
    left = s - 0.5 * c * dt
    if left >= 0.0:
        return (a * (sqrt(0.25 * dt * dt + 2.0 / a * left) - 0.5 * dt) - c) / dt
    if c <= 0.0:  # outside by an error, and on its way back
        return -c / dt
    return -0.5 * c * c / s if s > 0.0 else -FAR


@inlined
def _clip(value: float, least: float, most: float) -> float:
    """Nearest number in an interval."""
    return least if value < least else most if value > most else value


@inlined
def _within(wanted: float, least: float, most: float, sure: float) -> float:
    """Nearest to what is wanted in an interval, of which no end asks for more than is sure."""
    return _clip(wanted, least if least < sure else sure, most if most > -sure else -sure)


@inlined
def _interval(wheel: float, lim: TorqueLimits) -> tuple[float, float]:
    """Torques [N m] that an axis has, and whose wheel stays within its momentum."""
    most = lim.torque
    return (
        _clip((wheel - lim.momentum) / lim.dt, -most, most),
        _clip((wheel + lim.momentum) / lim.dt, -most, most),
    )


@inlined
def _allowed(
    wanted: float, rate: float, e: float, c: float, ahead: float, cone: bool, lim: TorqueLimits
) -> float:
    """Angular acceleration [rad/s^2] of an axis that keeps its limits, nearest to the wanted one.

    rate : [rad/s]; e, c : angle off the reference, and its change; ahead : acceleration of that
    """
    found = wanted
    if cone:
        most = _towards(lim.angle - e, c + lim.doubt, lim) - lim.off
        least = _towards(lim.angle + e, lim.doubt - c, lim) - lim.off
        found = _within(found, ahead - least, ahead + most, lim.sure)
    most = (lim.rate - rate) / lim.dt
    least = (-lim.rate - rate) / lim.dt
    return _within(found, least, most, lim.sure)


@inlined
def _share(start: float, end: float, least: float, most: float) -> float:
    """Largest share of the way from a torque in an interval to another that stays in it."""
    if end > most:
        return (most - start) / (end - start) if start < most else 0.0
    if end < least:
        return (least - start) / (end - start) if start > least else 0.0
    return 1.0


@kernel
def within_limits(
    torque: Vector,
    rate: Vector,
    angle: Vector,
    against: Vector,
    ahead: Vector,
    wheels: Vector,
    lim: TorqueLimits,
) -> tuple[float, float, float, int]:
    """Return a torque (3,) [N m] that keeps the limits, and PASSED or LIMITED.

    rate : (3,) of the chaser, as it is known [rad/s]
    angle, against, ahead : (3,) error of the attitude, of the rate, acceleration of the reference,
        as of `attitude_law_kernels.Errors`
    wheels : (3,) their momentum [N m s]
    """
    if lim.dt == 0.0:
        return torque[0], torque[1], torque[2], PASSED
    (lx, mx), (ly, my), (lz, mz) = (
        _interval(wheels[0], lim), _interval(wheels[1], lim), _interval(wheels[2], lim),
    )  # fmt: skip
    tx, ty, tz = _clip(torque[0], lx, mx), _clip(torque[1], ly, my), _clip(torque[2], lz, mz)
    j = (lim.jxx, lim.jyy, lim.jzz, lim.jxy, lim.jxz, lim.jyz)
    hx, hy, hz = symmetric(rate, j[0], j[1], j[2], j[3], j[4], j[5])
    gx, gy, gz = cross(rate, (hx + wheels[0], hy + wheels[1], hz + wheels[2]))
    ax, ay, az = symmetric(
        (tx - gx, ty - gy, tz - gz), lim.ixx, lim.iyy, lim.izz, lim.ixy, lim.ixz, lim.iyz
    )
    # the change of the errors: of twice the vector part of a quaternion whose real part is w
    ex, ey, ez = angle
    square = 0.25 * (ex * ex + ey * ey + ez * ez)
    w = sqrt(1.0 - square) if square < 1.0 else 0.0
    ux, uy, uz = cross(angle, against)
    cx, cy, cz = w * against[0] + 0.5 * ux, w * against[1] + 0.5 * uy, w * against[2] + 0.5 * uz
    cone = abs(ex) <= lim.within and abs(ey) <= lim.within and abs(ez) <= lim.within
    bx = _allowed(ax, rate[0], ex, cx, ahead[0], cone, lim)
    by = _allowed(ay, rate[1], ey, cy, ahead[1], cone, lim)
    bz = _allowed(az, rate[2], ez, cz, ahead[2], cone, lim)
    if bx == ax and by == ay and bz == az:
        return tx, ty, tz, PASSED if (tx, ty, tz) == torque else LIMITED
    # from the mildest acceleration that is allowed towards that one, as far as there is torque
    sx = _allowed(0.0, rate[0], ex, cx, ahead[0], cone, lim)
    sy = _allowed(0.0, rate[1], ey, cy, ahead[1], cone, lim)
    sz = _allowed(0.0, rate[2], ez, cz, ahead[2], cone, lim)
    px, py, pz = symmetric((sx, sy, sz), j[0], j[1], j[2], j[3], j[4], j[5])
    qx, qy, qz = symmetric((bx, by, bz), j[0], j[1], j[2], j[3], j[4], j[5])
    px, py, pz, qx, qy, qz = px + gx, py + gy, pz + gz, qx + gx, qy + gy, qz + gz
    u, v, w = _share(px, qx, lx, mx), _share(py, qy, ly, my), _share(pz, qz, lz, mz)
    u = v if v < u else u
    u = w if w < u else u
    return (
        _clip(px + u * (qx - px), lx, mx),
        _clip(py + u * (qy - py), ly, my),
        _clip(pz + u * (qz - pz), lz, mz),
        LIMITED,
    )
