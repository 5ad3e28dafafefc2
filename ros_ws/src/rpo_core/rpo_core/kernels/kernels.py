# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The inner loop, written once: membership, inference, centroid, CW step, closed loop.

Plain functions of floats, interpreted or compiled (`rpo_core.kernels.jit`) with the same bits: only
+ - * / and comparisons, in the order written. Tables come from `rpo_core.control.fuzzy` and
`rpo_core.world.cw`.

The output of an odd rule table is odd bit for bit: memberships are evaluated on |x| and mirrored,
and the centroid is summed in mirrored pairs of samples.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.kernels.jit import inlined, kernel

LN, SN, Z, SP, LP = range(5)
"""Words: large negative, small negative, zero, small positive, large positive."""

LANES = 8
"""Partial sums of the centroid: pair i goes to sum i mod 8, which is the shape of SIMD hardware."""

MAX_ANGLE_RAD = 1e6
"""Largest angle that `sin_cos` reduces to full precision."""

Five = tuple[float, float, float, float, float]
"""One float for each word, LN..LP; or the five numbers of a variable's membership functions."""

Vector = tuple[float, float, float]
State = tuple[float, float, float, float, float, float]
"""x, y, z [m], vx, vy, vz [m/s], target LVLH."""


class FisTables(NamedTuple):
    """A fuzzy inference system as the kernels read it.

    position, velocity : 5 floats, Z half-width; SP left foot, centre, right foot; LP left foot
    rules : 25 ints, consequent word of each rule, row = velocity word, column = position word
    samples : (H,) float, positive half of the output samples, H = (N - 1) / 2
    z, sp, lp : (H,) float, output membership of those samples
    """

    position: Any
    velocity: Any
    rules: Any
    samples: Any
    z: Any
    sp: Any
    lp: Any


class CwStep(NamedTuple):
    """Coefficients of one exact CW step under a constant force (`rpo_core.world.cw.discretise`).

    `yvx` is what a velocity vx [m/s] adds to y [m], `vyfx` what a force fx [N] adds to vy [m/s];
    SI units. Coefficients that are 0, and yy, which is 1, are left out.
    """

    xx: float
    xvx: float
    xvy: float
    yx: float
    yvx: float
    yvy: float
    vxx: float
    vxvx: float
    vxvy: float
    vyx: float
    vyvx: float
    vyvy: float
    zz: float
    zvz: float
    vzz: float
    vzvz: float
    xfx: float
    xfy: float
    yfx: float
    yfy: float
    vxfx: float
    vxfy: float
    vyfx: float
    vyfy: float
    zfz: float
    vzfz: float


@inlined
def unpacked(t: Any, i: int, n: int) -> CwStep:
    """Return a step whose coefficients lie in a table from place i on, n places apart."""
    # fmt: off
    return CwStep(
        t[i], t[i + n], t[i + 2 * n], t[i + 3 * n], t[i + 4 * n], t[i + 5 * n], t[i + 6 * n],
        t[i + 7 * n], t[i + 8 * n], t[i + 9 * n], t[i + 10 * n], t[i + 11 * n], t[i + 12 * n],
        t[i + 13 * n], t[i + 14 * n], t[i + 15 * n], t[i + 16 * n], t[i + 17 * n], t[i + 18 * n],
        t[i + 19 * n], t[i + 20 * n], t[i + 21 * n], t[i + 22 * n], t[i + 23 * n], t[i + 24 * n],
        t[i + 25 * n],
    )
    # fmt: on


@kernel
def norm(x: float, y: float, z: float) -> float:
    """Length of a vector."""
    return sqrt(x * x + y * y + z * z)


@kernel
def saturate(value: float, limit: float) -> float:
    """Clamp to [-limit, limit]."""
    if value > limit:
        return limit
    if value < -limit:
        return -limit
    return value


@kernel
def triangle(x: float, left: float, centre: float, right: float) -> float:
    """Triangular membership; a vertical edge (left = centre) is allowed."""
    if x < centre:
        return (x - left) / (centre - left) if x > left else 0.0
    if x > centre:
        return (right - x) / (right - centre) if x < right else 0.0
    return 1.0


@kernel
def memberships(x: float, functions: Five) -> Five:
    """Grades (LN, SN, Z, SP, LP) of x in [-1, 1]; the negative side mirrors the positive."""
    size = abs(x)
    zero = triangle(size, -functions[0], 0.0, functions[0])
    small = triangle(size, functions[1], functions[2], functions[3])
    large = triangle(size, functions[4], 1.0, 2.0)
    if x >= 0.0:
        return 0.0, 0.0, zero, small, large
    return large, small, zero, 0.0, 0.0


@kernel
def fire_rules(position_grades: Five, velocity_grades: Five, rules: Any) -> Five:
    """Strength of each consequent word: max over its rules of min(position, velocity) grade."""
    ln = sn = zero = sp = lp = 0.0
    for row in range(5):
        velocity_grade = velocity_grades[row]
        if velocity_grade == 0.0:
            continue
        for column in range(5):
            grade = position_grades[column]
            strength = velocity_grade if velocity_grade < grade else grade
            if strength == 0.0:
                continue
            word = rules[5 * row + column]
            if word == LN:
                ln = strength if strength > ln else ln
            elif word == SN:
                sn = strength if strength > sn else sn
            elif word == Z:
                zero = strength if strength > zero else zero
            elif word == SP:
                sp = strength if strength > sp else sp
            else:
                lp = strength if strength > lp else lp
    return ln, sn, zero, sp, lp


@kernel
def centroid(strengths: Five, fis: FisTables) -> float:
    """Centroid of max over words of min(strength, output membership); 0 if that is empty.

    Sample y_i and its mirror -y_i are taken together: their moments are y_i (mu(y_i) - mu(-y_i)).
    """
    ln, sn, zero, sp, lp = strengths
    moment = 0.0
    area = zero  # the middle sample, y = 0: only Z has membership there
    for lane in range(LANES):
        lane_moment = 0.0
        lane_area = 0.0
        for i in range(lane, len(fis.samples), LANES):
            grade = fis.z[i]
            right = left = grade if grade < zero else zero
            grade = fis.sp[i]
            clipped = grade if grade < sp else sp
            right = clipped if clipped > right else right
            clipped = grade if grade < sn else sn
            left = clipped if clipped > left else left
            grade = fis.lp[i]
            clipped = grade if grade < lp else lp
            right = clipped if clipped > right else right
            clipped = grade if grade < ln else ln
            left = clipped if clipped > left else left
            lane_moment += fis.samples[i] * (right - left)
            lane_area += right + left
        moment += lane_moment
        area += lane_area
    return moment / area if area > 0.0 else 0.0


@kernel
def infer(position_error: float, velocity_error: float, fis: FisTables) -> float:
    """Mamdani inference: two normalised errors in [-1, 1] to an output in [-1, 1]."""
    position_grades = memberships(position_error, fis.position)
    velocity_grades = memberships(velocity_error, fis.velocity)
    return centroid(fire_rules(position_grades, velocity_grades, fis.rules), fis)


@kernel
def axis_force(
    r: float,
    v: float,
    position_scale: float,
    velocity_scale: float,
    force_scale: float,
    fis: FisTables,
) -> float:
    """Commanded force [N] of one axis from its position [m] and velocity [m/s]."""
    position_error = saturate(-r / position_scale, 1.0)
    velocity_error = saturate(-v / velocity_scale, 1.0)
    return force_scale * infer(position_error, velocity_error, fis)


@inlined
def cw_step(state: State, force: Vector, c: CwStep) -> State:
    """State (x, y, z, vx, vy, vz) one step later under a constant force (fx, fy, fz) [N]."""
    x, y, z, vx, vy, vz = state
    fx, fy, fz = force
    return (
        c.xx * x + c.xvx * vx + c.xvy * vy + c.xfx * fx + c.xfy * fy,
        c.yx * x + y + c.yvx * vx + c.yvy * vy + c.yfx * fx + c.yfy * fy,
        c.zz * z + c.zvz * vz + c.zfz * fz,
        c.vxx * x + c.vxvx * vx + c.vxvy * vy + c.vxfx * fx + c.vxfy * fy,
        c.vyx * x + c.vyvx * vx + c.vyvy * vy + c.vyfx * fx + c.vyfy * fy,
        c.vzz * z + c.vzvz * vz + c.vzfz * fz,
    )


@kernel
def plant_step(
    state: State,
    command: Vector,
    disturbance: Vector,
    limit: float,
    c: CwStep,
) -> State:
    """One step of the plant: the thrusters saturate the command at `limit` [N] per axis."""
    total = (
        saturate(command[0], limit) + disturbance[0],
        saturate(command[1], limit) + disturbance[1],
        saturate(command[2], limit) + disturbance[2],
    )
    return cw_step(state, total, c)


@kernel
def exerted_force(
    t00: float,
    t01: float,
    t02: float,
    t10: float,
    t11: float,
    t12: float,
    t20: float,
    t21: float,
    t22: float,
    fx: float,
    fy: float,
    fz: float,
) -> Vector:
    """Force [N] of thrusters with matrix t for the saturated command (fx, fy, fz)."""
    return (
        t00 * fx + t01 * fy + t02 * fz,
        t10 * fx + t11 * fy + t12 * fz,
        t20 * fx + t21 * fy + t22 * fz,
    )


@kernel
def measured(truth: float, bias: float, sigma: float, normal: float) -> float:
    """Component of the navigation solution: truth plus bias plus white noise."""
    return truth + bias + sigma * normal


@kernel
def fuzzy_force(state: State, scales: Vector, fis: FisTables) -> Vector:
    """Commanded force [N] of all three axes."""
    r, v, f = scales
    return (
        axis_force(state[0], state[3], r, v, f, fis),
        axis_force(state[1], state[4], r, v, f, fis),
        axis_force(state[2], state[5], r, v, f, fis),
    )


@kernel
def fuzzy_forces(states: Any, scales: Vector, fis: FisTables, forces: NDArray[np.float64]) -> None:
    """Fill the force (n, 3) [N] that answers each state (n, 6)."""
    for i in range(len(states)):
        s = states[i]
        force = fuzzy_force((s[0], s[1], s[2], s[3], s[4], s[5]), scales, fis)
        for axis in range(3):
            forces[i, axis] = force[axis]


@kernel
def cw_steps(states: Any, forces: Any, c: CwStep, following: NDArray[np.float64]) -> None:
    """Fill the state (n, 6) that follows each state (n, 6) under a force (n, 3) [N]."""
    for i in range(len(states)):
        s = states[i]
        f = forces[i]
        new = cw_step((s[0], s[1], s[2], s[3], s[4], s[5]), (f[0], f[1], f[2]), c)
        for j in range(6):
            following[i, j] = new[j]


_HALF_PI_A = 1.5707963267341256  # pi/2 in three parts; the first two have 33 bits, so that
_HALF_PI_B = 6.077100506303966e-11  # k times a part is exact for |k| < 2**20
_HALF_PI_C = 2.0222662487959506e-21


@kernel
def sin_cos(angle: float) -> tuple[float, float]:
    """Sine and cosine of an angle [rad] below `MAX_ANGLE_RAD`, from + - * only.

    The C library's differ in the last bit between versions and processors; these do not.
    Taylor series on [-pi/4, pi/4], truncated below 5e-18; right to 2.5 units in the last place.
    """
    turns = angle * 0.6366197723675814
    quarter = int(turns + 0.5) if turns >= 0.0 else int(turns - 0.5)
    r = ((angle - quarter * _HALF_PI_A) - quarter * _HALF_PI_B) - quarter * _HALF_PI_C
    q = r * r
    # fmt: off
    sine = r - r * q * (1 / 6 - q * (1 / 120 - q * (1 / 5040 - q * (1 / 362880 - q * (
        1 / 39916800 - q * (1 / 6227020800 - q * (1 / 1307674368000 - q / 355687428096000)))))))
    cosine = 1.0 - q * (1 / 2 - q * (1 / 24 - q * (1 / 720 - q * (1 / 40320 - q * (
        1 / 3628800 - q * (1 / 479001600 - q * (1 / 87178291200 - q / 20922789888000)))))))
    # fmt: on
    side = quarter % 4
    if side == 0:
        return sine, cosine
    if side == 1:
        return cosine, -sine
    if side == 2:
        return -sine, -cosine
    return -cosine, sine
