# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""From an attitude that is seen and one that is wanted to a torque; and a force in body axes.

Kernels of + - * / and sqrt (`kernels.jit`), the same bits everywhere; conventions are those of
`attitude.attitude_kernels`.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from rpo_core.attitude.attitude_kernels import Attitude, Six, cross, symmetric
from rpo_core.attitude.chaser import relative_to, times, turn_back
from rpo_core.attitude.target import Quaternion
from rpo_core.control.attitude_limits import TorqueLimits, within_limits
from rpo_core.control.inference import FisTables, infer
from rpo_core.kernels.arithmetic import Vector, saturate
from rpo_core.kernels.jit import inlined, step_kernel

Nine = tuple[float, float, float, float, float, float, float, float, float]
"""A matrix (3, 3), row by row."""


class Steering(NamedTuple):
    """What a torque and a force in body axes depend on beside the law.

    limits : largest torque of each axis [N m]
    wheels : largest momentum of a wheel [N m s]; 0.0 without wheels
    orbit : rate of LVLH [rad/s]
    dt : the tick [s]; ahead : time from a state to the middle of the tick in which its force acts
    above, unload : momentum of a wheel above which thrusters empty it [N m s], their torque [N m]
    inertia : xx, yy, zz, xy, xz, yz [kg m^2] that the feed-forward assumes; zeros: there is none
    kept : what the torque must keep; zeros: nothing
    """

    limits: Vector
    wheels: float
    orbit: float
    dt: float
    ahead: float
    above: float
    unload: float
    inertia: Six
    kept: TorqueLimits


class TorqueLaw(NamedTuple):
    """A law of the torque.

    fuzzy : 0 for a linear law, of which the gains count; 1 for a fuzzy one
    attitude, rate : gains (3, 3) [N m/rad], [N m s/rad]
    angle, speed, torques : scales of attitude [rad], of rate [rad/s], of the torque of each axis
        [N m]
    """

    fuzzy: int
    attitude: Nine
    rate: Nine
    angle: float
    speed: float
    torques: Vector
    fis: FisTables


class Errors(NamedTuple):
    """How far an attitude is from the one that is wanted, in the body's axes.

    ex, ey, ez : twice the vector part of the error quaternion [rad for small angles]
    wx, wy, wz : rate error [rad/s]
    ax, ay, az : acceleration of the reference, as the body sees it [rad/s^2]
    """

    ex: float
    ey: float
    ez: float
    wx: float
    wy: float
    wz: float
    ax: float
    ay: float
    az: float


@inlined
def errors(seen: Attitude, wanted: Attitude, before: Vector, dt: float) -> Errors:
    """Return the errors of an attitude, the shorter way round.

    before : rate of the reference a tick `dt` [s] earlier, in its own axes; the same: it is steady
    """
    axes = (wanted[0], wanted[1], wanted[2], wanted[3])
    x, y, z, w = relative_to(axes, (seen[0], seen[1], seen[2], seen[3]))
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    p, q, r = wanted[4], wanted[5], wanted[6]
    change = ((p - before[0]) / dt, (q - before[1]) / dt, (r - before[2]) / dt)
    rate = turn_back((p, q, r), (x, y, z, w))
    wx, wy, wz = seen[4] - rate[0], seen[5] - rate[1], seen[6] - rate[2]
    ax, ay, az = turn_back(change, (x, y, z, w))
    tx, ty, tz = cross((wx, wy, wz), rate)  # the body turns against the reference
    return Errors(x + x, y + y, z + z, wx, wy, wz, ax - tx, ay - ty, az - tz)


@inlined
def linear_torque(e: Errors, k: Nine, d: Nine) -> Vector:
    """Torque -k e - d w [N m] of a law with gains of attitude and of rate."""
    return (
        -(k[0] * e.ex + k[1] * e.ey + k[2] * e.ez) - (d[0] * e.wx + d[1] * e.wy + d[2] * e.wz),
        -(k[3] * e.ex + k[4] * e.ey + k[5] * e.ez) - (d[3] * e.wx + d[4] * e.wy + d[5] * e.wz),
        -(k[6] * e.ex + k[7] * e.ey + k[8] * e.ez) - (d[6] * e.wx + d[7] * e.wy + d[8] * e.wz),
    )


@inlined
def limited(torque: Vector, e: Errors, seen: Attitude, wheels: Vector, s: Steering) -> Vector:
    """Add to a torque what the reference and the turning body need, and saturate it.

    wheels : their momentum [N m s]
    """
    p, q, r = seen[4], seen[5], seen[6]
    x, y, z = torque
    if s.inertia[0] > 0.0:
        hx, hy, hz = symmetric((p, q, r), s.inertia)
        gx, gy, gz = cross((p, q, r), (hx + wheels[0], hy + wheels[1], hz + wheels[2]))
        ax, ay, az = symmetric((e.ax, e.ay, e.az), s.inertia)
        x, y, z = x + (gx + ax), y + (gy + ay), z + (gz + az)
    x, y, z = saturate(x, s.limits[0]), saturate(y, s.limits[1]), saturate(z, s.limits[2])
    if s.kept.dt > 0.0:
        angle, against, ahead = (e.ex, e.ey, e.ez), (e.wx, e.wy, e.wz), (e.ax, e.ay, e.az)
        x, y, z, _ = within_limits((x, y, z), (p, q, r), angle, against, ahead, wheels, s.kept)
    return x, y, z


@step_kernel
def axis_output(e: float, w: float, law: TorqueLaw) -> float:
    """Output in [-1, 1] of a fuzzy law for the attitude [rad] and rate [rad/s] error of an axis."""
    return infer(saturate(-e / law.angle, 1.0), saturate(-w / law.speed, 1.0), law.fis)


@step_kernel
def attitude_torque(
    seen: Attitude, wanted: Attitude, before: Vector, wheels: Vector, s: Steering, law: TorqueLaw
) -> Vector:
    """Commanded torque (3,) [N m], body axes, of an attitude that is seen and one that is wanted.

    before : rate of the reference a tick earlier; wheels : their momentum [N m s]
    """
    e = errors(seen, wanted, before, s.dt)
    if law.fuzzy == 0:
        return limited(linear_torque(e, law.attitude, law.rate), e, seen, wheels, s)
    torque = (
        law.torques[0] * axis_output(e.ex, e.wx, law),
        law.torques[1] * axis_output(e.ey, e.wy, law),
        law.torques[2] * axis_output(e.ez, e.wz, law),
    )
    return limited(torque, e, seen, wheels, s)


@inlined
def attitude_ahead(seen: Attitude, orbit_rad_s: float, ahead_s: float) -> Quaternion:
    """Quaternion of the axes that the body has a time later, by its rate."""
    quaternion = (seen[0], seen[1], seen[2], seen[3])
    orbit = turn_back((0.0, 0.0, orbit_rad_s), quaternion)
    h = 0.5 * ahead_s
    a, b, c = h * (seen[4] - orbit[0]), h * (seen[5] - orbit[1]), h * (seen[6] - orbit[2])
    x, y, z, w = times(quaternion, (a, b, c, 1.0))
    size = sqrt(x * x + y * y + z * z + w * w)
    return x / size, y / size, z / size, w / size
