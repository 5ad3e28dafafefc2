# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Mamdani inference, written once: membership, rules, centroid, the force of an axis.

Plain functions of floats (`rpo_core.kernels.jit`), interpreted or compiled with the same bits: only
+ - * / and comparisons, in the order written. Tables come from `rpo_core.control.fuzzy`.

The output of an odd rule table is odd bit for bit: memberships are evaluated on |x| and mirrored,
and the centroid is summed in mirrored pairs of samples.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

from rpo_core.kernels.arithmetic import Vector, saturate
from rpo_core.kernels.jit import kernel, step_kernel
from rpo_core.kernels.simd import LANES, added, joined, lanes, passes

LN, SN, Z, SP, LP = range(5)
"""Words: large negative, small negative, zero, small positive, large positive."""

Five = tuple[float, float, float, float, float]
"""One float for each word, LN..LP; or the five numbers of a variable's membership functions."""


class FisTables(NamedTuple):
    """A fuzzy inference system as the kernels read it.

    position, velocity : 5 floats, Z half-width; SP left foot, centre, right foot; LP left foot
    rules : 25 ints, consequent word of each rule, row = velocity word, column = position word
    samples : (H,) float, positive half of the output samples, H = (N - 1) / 2
    z, sp, lp : (H,) float, output membership of those samples
    """

    position: Five
    velocity: Five
    rules: Annotated[list[int], 25]
    samples: list[float]
    z: list[float]
    sp: list[float]
    lp: list[float]


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


@step_kernel
def centroid(strengths: Five, fis: FisTables) -> float:
    """Centroid of max over words of min(strength, output membership); 0 if that is empty.

    Sample y_i and its mirror -y_i are taken together: their moments are y_i (mu(y_i) - mu(-y_i)).
    """
    ln, sn, zero, sp, lp = strengths
    samples, z = lanes(fis.samples), lanes(fis.z)
    small, large = lanes(fis.sp), lanes(fis.lp)
    moment = 0.0
    area = zero  # the middle sample, y = 0: only Z has membership there
    for lane in range(passes()):
        lane_moment = lane_area = 0.0
        for i in range(lane, len(fis.samples), LANES):
            right = left = joined(0.0, z[i], zero)
            if sp > 0.0:
                right = joined(right, small[i], sp)
            if sn > 0.0:
                left = joined(left, small[i], sn)
            if lp > 0.0:
                right = joined(right, large[i], lp)
            if ln > 0.0:
                left = joined(left, large[i], ln)
            lane_moment += samples[i] * (right - left)
            lane_area += right + left
        moment = added(moment, lane_moment)
        area = added(area, lane_area)
    return moment / area if area > 0.0 else 0.0


@step_kernel
def infer(position_error: float, velocity_error: float, fis: FisTables) -> float:
    """Mamdani inference: two normalised errors in [-1, 1] to an output in [-1, 1]."""
    position_grades = memberships(position_error, fis.position)
    velocity_grades = memberships(velocity_error, fis.velocity)
    return centroid(fire_rules(position_grades, velocity_grades, fis.rules), fis)


@step_kernel
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


@dataclass(slots=True)
class FuzzyLaw:
    """Settings of the kernel `command`: scales r [m], v [m/s], f [N], and the inference system."""

    scales: Vector
    fis: FisTables


@step_kernel
def command(tick: int, u: Any, p: Any, m: Any, y: Any) -> None:
    """F = s_f FIS(-r / s_r, -v / s_v) of each axis: from a state u (6,) to a force y (3,) [N]."""
    for i in range(3):
        y[i] = axis_force(u[i], u[3 + i], p.scales[0], p.scales[1], p.scales[2], p.fis)
