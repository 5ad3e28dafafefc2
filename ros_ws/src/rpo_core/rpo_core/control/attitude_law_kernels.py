# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""From an attitude that is seen and one that is wanted to a torque; and a force in body axes.

Kernels of + - * / and sqrt (`kernels.jit`), the same bits everywhere; conventions are those of
`kernels.attitude_kernels`. A law is a flat table of floats (`control.attitude.table_of`), so
that the stage and the lanes of the engine call the same kernels:

- `LIMITS`: largest torque of each axis [N m]; `WHEELS`: largest momentum of a wheel [N m s], 0.0
  without wheels; `ORBIT`: rate of LVLH [rad/s]; `DT`: the tick [s]; `AHEAD`: time from a state to
  the middle of the tick in which its force acts [s]; `ABOVE`, `UNLOAD`: momentum of a wheel above
  which thrusters empty it [N m s], and their torque [N m];
- `INERTIA`: xx, yy, zz, xy, xz, yz [kg m^2] that the feed-forward assumes; zeros: there is none;
- `KEPT`: what the torque must keep (`attitude_limits.TorqueLimits`); zeros: nothing;
- `FUZZY`: 0.0 for a linear law, whose gains of attitude (3, 3) [N m/rad] and of rate (3, 3)
  [N m s/rad] follow; 1.0 for a fuzzy one: scales of attitude [rad], of rate [rad/s], of the torque
  of each axis [N m], p1-p10, 25 rules, then the samples and their grades of Z, SP and LP.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

from rpo_core.attitude.attitude_kernels import Attitude, cross, symmetric
from rpo_core.attitude.chaser import relative_to, times, turn_back, unloaded, wheels_after
from rpo_core.attitude.target import Quaternion
from rpo_core.control.attitude_limits import NUMBERS, limits_at, within_limits
from rpo_core.control.inference import FisTables, infer
from rpo_core.kernels.arithmetic import Vector, saturate
from rpo_core.kernels.jit import inlined, kernel

LIMITS, WHEELS, ORBIT, DT, AHEAD, ABOVE, UNLOAD, INERTIA, KEPT = 0, 3, 4, 5, 6, 7, 8, 9, 15
FUZZY, LAW = KEPT + NUMBERS, KEPT + NUMBERS + 1
"""Places in a table."""

SCALES, FUNCTIONS, RULES, SAMPLES = LAW, LAW + 5, LAW + 15, LAW + 40
"""Places in the table of a fuzzy law."""


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
def linear_torque(e: Errors, t: Any) -> Vector:
    """Torque [N m] of a law with gains."""
    k, d = LAW, LAW + 9
    return (
        -(t[k] * e.ex + t[k + 1] * e.ey + t[k + 2] * e.ez)
        - (t[d] * e.wx + t[d + 1] * e.wy + t[d + 2] * e.wz),
        -(t[k + 3] * e.ex + t[k + 4] * e.ey + t[k + 5] * e.ez)
        - (t[d + 3] * e.wx + t[d + 4] * e.wy + t[d + 5] * e.wz),
        -(t[k + 6] * e.ex + t[k + 7] * e.ey + t[k + 8] * e.ez)
        - (t[d + 6] * e.wx + t[d + 7] * e.wy + t[d + 8] * e.wz),
    )


@inlined
def limited(torque: Vector, e: Errors, seen: Attitude, wheels: Vector, t: Any, i: int) -> Vector:
    """Add to a torque what the reference and the turning body need, and saturate it.

    wheels : their momentum [N m s]; the table begins at place i
    """
    p, q, r = seen[4], seen[5], seen[6]
    j = i + INERTIA
    jxx, jyy, jzz, jxy, jxz, jyz = t[j], t[j + 1], t[j + 2], t[j + 3], t[j + 4], t[j + 5]
    x, y, z = torque
    if jxx > 0.0:
        hx, hy, hz = symmetric((p, q, r), jxx, jyy, jzz, jxy, jxz, jyz)
        gx, gy, gz = cross((p, q, r), (hx + wheels[0], hy + wheels[1], hz + wheels[2]))
        ax, ay, az = symmetric((e.ax, e.ay, e.az), jxx, jyy, jzz, jxy, jxz, jyz)
        x, y, z = x + (gx + ax), y + (gy + ay), z + (gz + az)
    k, i = i + KEPT, i + LIMITS
    x, y, z = saturate(x, t[i]), saturate(y, t[i + 1]), saturate(z, t[i + 2])
    if t[k] > 0.0:
        angle, against, ahead = (e.ex, e.ey, e.ez), (e.wx, e.wy, e.wz), (e.ax, e.ay, e.az)
        lim = limits_at(t, k)
        x, y, z, _ = within_limits((x, y, z), (p, q, r), angle, against, ahead, wheels, lim)
    return x, y, z


@inlined
def unloaded_at(wheels: Vector, t: Any, i: int) -> tuple[Vector, Vector]:
    """Torque (3,) of thrusters that empty the wheels, and their momentum after a tick of it."""
    return unloaded(wheels, t[i + ABOVE], t[i + UNLOAD], t[i + DT])


@kernel
def axis_output(e: float, w: float, t: Any) -> float:
    """Output in [-1, 1] of a fuzzy law for the attitude [rad] and rate [rad/s] error of an axis."""
    f, k = FUNCTIONS, (len(t) - SAMPLES) // 4
    fis = FisTables(
        (t[f], t[f + 1], t[f + 2], t[f + 3], t[f + 4]),
        (t[f + 5], t[f + 6], t[f + 7], t[f + 8], t[f + 9]),
        t[RULES:SAMPLES],
        t[SAMPLES : SAMPLES + k],
        t[SAMPLES + k : SAMPLES + 2 * k],
        t[SAMPLES + 2 * k : SAMPLES + 3 * k],
        t[SAMPLES + 3 * k :],
    )
    return infer(saturate(-e / t[SCALES], 1.0), saturate(-w / t[SCALES + 1], 1.0), fis)


@kernel
def attitude_torque(
    seen: Attitude, wanted: Attitude, before: Vector, wheels: Vector, t: Any
) -> Vector:
    """Commanded torque (3,) [N m], body axes, of an attitude that is seen and one that is wanted.

    before : rate of the reference a tick earlier; wheels : their momentum [N m s]
    """
    e = errors(seen, wanted, before, t[DT])
    if t[FUZZY] == 0.0:
        return limited(linear_torque(e, t), e, seen, wheels, t, 0)
    torque = (
        t[SCALES + 2] * axis_output(e.ex, e.wx, t),
        t[SCALES + 3] * axis_output(e.ey, e.wy, t),
        t[SCALES + 4] * axis_output(e.ez, e.wz, t),
    )
    return limited(torque, e, seen, wheels, t, 0)


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


@inlined
def force_ahead(force: Vector, seen: Attitude, t: Any, i: int) -> Vector:
    """Force (3,) of target LVLH in the axes that the body has when it acts."""
    return turn_back(force, attitude_ahead(seen, t[i + ORBIT], t[i + AHEAD]))


@kernel
def steer(
    force: Vector, seen: Attitude, wanted: Attitude, before: Vector, wheels: Vector, t: Any
) -> tuple[Vector, Vector, Vector]:
    """Commanded force [N] and torque [N m] in body axes; the wheels a tick later [N m s]."""
    _, wheels = unloaded_at(wheels, t, 0)
    torque = attitude_torque(seen, wanted, before, wheels, t)
    after = wheels_after(wheels, torque, t[DT], t[WHEELS])
    return force_ahead(force, seen, t, 0), torque, after
