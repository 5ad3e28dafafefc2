# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Lanes: the rows of the scratch, and fuzzy inference over them with the bits of the kernel.

Under Clohessy-Wiltshire z is decoupled from x and y, and a fuzzy controller acts axis by axis. So
runs are planar (x, y) and vertical (z) loops; their axes are lanes x..., y..., z... of the scratch,
one flat array of rows of `STRIDE` lanes. Every inner loop runs over lanes, which the compiler turns
into SIMD. Either every planar loop is crossed with every vertical one (a set of starts has few
distinct ones), or loop i of both kinds is run i: then there are `RUNS` of each, and a run may have
parts that couple axes or differ from run to run.

In the inference each lane does the arithmetic of `rpo_core.control.inference.infer` in its order:
the centroid's eight partial sums one after the other, padded with zero grades where the samples end
(adding +0 changes no bit).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.control.inference import memberships
from rpo_core.kernels import jit
from rpo_core.kernels.jit import Kernel
from rpo_core.kernels.simd import LANES

STRIDE = 136
"""Lanes at most. 17 cache lines, an odd number, so that the rows do not contend for the same lines
of the first-level cache."""

LONGEST = 128
"""Lanes that `infer_many` takes at a time: whole SIMD registers."""

TERMS = 7
"""Samples in one partial sum of the unrolled centroid: ceil(50 / 8) at 101 samples."""

# Rows of the scratch. Position and velocity errors in, force out; the rest is in between.
E_R, E_V, OUTPUT, MOMENT, AREA = (row * STRIDE for row in range(5))
GRADES = 5 * STRIDE  # 5 rows of position, 5 of velocity grades
STRENGTHS = 15 * STRIDE  # 5 rows

# True state; what the controller sees; what navigation found; the command on its way to a force;
# the saturated command of the tick before; the disturbance; the mass.
R, V, SEEN_R, SEEN_V, KNOWN_R, KNOWN_V, FORCE, BEFORE, PUSH, MASS = (
    (20 + row) * STRIDE for row in range(10)
)
# What `counters` counts.
SUM_R, SUM_V, ENERGY, EFFORT, SLEW, LATE_R, LATE_V, LATE_F, OUTSIDE = (
    (30 + row) * STRIDE for row in range(9)
)
# The state as the target sees it, where that turns.
BODY_R, BODY_V = 39 * STRIDE, 40 * STRIDE
# Where the chaser has an attitude, paired runs: the true one, what navigation found, the reference,
# each as x, y, z of the quaternion, its w, the rate; torque commanded and that of thrusters; the
# shift of position x mass and velocity x mass by turning.
(
    QUAT, QUAT_W, RATE, SEEN_QUAT, SEEN_QUAT_W, SEEN_RATE, REF_QUAT, REF_QUAT_W, REF_RATE, TORQUE,
    EXERTED_TORQUE, SHIFT_R, SHIFT_V,
) = ((41 + row) * STRIDE for row in range(13))  # fmt: skip
# The true attitude of the target, where it has one.
BODY_QUAT, BODY_QUAT_W, BODY_RATE = ((54 + row) * STRIDE for row in range(3))
# Covariance of the attitude that navigation found: row by row.
SPREAD_X, SPREAD_Y, SPREAD_Z = ((57 + row) * STRIDE for row in range(3))
# Roots of the traces of the covariances of position and velocity, where they are estimated (2, 40);
# the torque that empties the wheels; the disturbance that is estimated.
KNOWN_SPREAD, UNLOADING, FOUND_PUSH = ((60 + row) * STRIDE for row in range(3))
ROWS = 63

RUNS = 40
"""Paired runs side by side: whole SIMD registers, and three axes fit into a row."""

PAIRED_LANES = 3 * RUNS

STORED = 0.0
"""Added to a maximum that goes back to the row it came from, a number >= 0: it changes no bit. With
AVX2, LLVM would otherwise store under a mask (`vmaskmovpd`), in microcode on AMD processors."""


def paired_lanes(count: int) -> NDArray[np.int64]:
    """Return the lanes (count, 3) x, y, z of the first paired runs."""
    return np.arange(count)[:, None] + RUNS * np.arange(3)


def compiled(function: Kernel) -> Kernel:
    """Compile where the core's kernels are; free of the interpreter's lock."""
    return jit.compiled(function, nogil=True)


def by_constant(function: Kernel) -> Kernel:
    """Compile so for each row or count that it is called with: its loops over lanes become SIMD."""
    return jit.compiled(function, by_constant=True, nogil=True)


class Law(NamedTuple):
    """A fuzzy controller as the kernels read it; filled by `set_law`.

    scales : (3,) position [m], velocity [m/s], force [N]
    functions : (15,) p1-p15
    rules : (25,) codes 0..4, row = velocity word, column = position word
    samples, z, sp, lp : (8 * terms,) positive output samples and their grades, padded with zeros
    """

    scales: Any
    functions: Any
    rules: Any
    samples: Any
    z: Any
    sp: Any
    lp: Any


def make_law(samples: int) -> Law:
    """Return an empty law with room for an odd number of output samples."""
    terms = -(-((samples - 1) // 2) // LANES)
    half = (samples - 1) // 2
    padded = np.zeros(LANES * terms)
    padded[:half] = np.arange(1, half + 1) / half
    grades = np.zeros((3, LANES * terms))
    return Law(np.zeros(3), np.zeros(15), np.zeros(25), padded, *grades)


def make_scratch() -> Any:
    """Return the scratch of one worker; it begins with a line of the cache."""
    room = np.zeros(ROWS * STRIDE + LANES)
    return room[-(room.ctypes.data // room.itemsize) % LANES :][: ROWS * STRIDE]


@compiled
def set_law(law, scales, functions, rules):  # type: ignore[no-untyped-def]
    """Fill a law: scales (3,), functions (15,) = p1-p15, rules (25,) codes 0..4."""
    law.scales[:] = scales
    law.functions[:] = functions
    law.rules[:] = rules
    force = (functions[10], functions[11], functions[12], functions[13], functions[14])
    for i in range(len(law.samples)):
        sample = law.samples[i]
        law.z[i] = law.sp[i] = law.lp[i] = 0.0
        if sample > 0.0:
            _, _, law.z[i], law.sp[i], law.lp[i] = memberships(sample, force)


@by_constant
def fuzzify(w, n, source, target, functions):  # type: ignore[no-untyped-def]
    """Write the five grades of row `source` to the five rows from `target`."""
    feet = (functions[0], functions[1], functions[2], functions[3], functions[4])
    for s in range(n):
        ln, sn, zero, sp, lp = memberships(w[source + s], feet)
        w[target + s] = ln
        w[target + STRIDE + s] = sn
        w[target + 2 * STRIDE + s] = zero
        w[target + 3 * STRIDE + s] = sp
        w[target + 4 * STRIDE + s] = lp


@compiled
def fire(w, n, rules):  # type: ignore[no-untyped-def]
    """Strength of each word per lane: max over its rules of min(position, velocity) grade."""
    w[STRENGTHS : STRENGTHS + 5 * STRIDE] = 0.0
    for row in range(5):
        velocity = w[GRADES + (5 + row) * STRIDE :][:STRIDE]
        for column in range(5):
            position = w[GRADES + column * STRIDE :][:STRIDE]
            strengths = w[STRENGTHS + int(rules[5 * row + column]) * STRIDE :][:STRIDE]
            for s in range(n):
                grade = position[s]
                strength = velocity[s]
                strength = strength if strength < grade else grade
                best = strengths[s]
                strengths[s] = (strength if strength > best else best) + STORED


@compiled
def clip_pair(i, law, ln, sn, zero, sp, lp):  # type: ignore[no-untyped-def]
    """Aggregate the grades of sample y_i and of its mirror -y_i."""
    grade = law.z[i]
    right = left = grade if grade < zero else zero
    grade = law.sp[i]
    clipped = grade if grade < sp else sp
    right = clipped if clipped > right else right
    clipped = grade if grade < sn else sn
    left = clipped if clipped > left else left
    grade = law.lp[i]
    clipped = grade if grade < lp else lp
    right = clipped if clipped > right else right
    clipped = grade if grade < ln else ln
    left = clipped if clipped > left else left
    return right, left


@by_constant
def _add_partial_sums(w, n, lane, terms, law, strengths):  # type: ignore[no-untyped-def]
    for s in range(n):
        moment = area = 0.0
        for k in range(terms):
            i = LANES * k + lane
            right, left = clip_pair(
                i,
                law,
                strengths[s],
                strengths[STRIDE + s],
                strengths[2 * STRIDE + s],
                strengths[3 * STRIDE + s],
                strengths[4 * STRIDE + s],
            )
            moment += law.samples[i] * (right - left)
            area += right + left
        w[MOMENT + s] += moment
        w[AREA + s] += area


@compiled
def defuzzify(w, n, law):  # type: ignore[no-untyped-def]
    """Centroid per lane into row OUTPUT, in the order of `rpo_core.control.inference.centroid`.

    At 101 samples the count of terms is a constant: their loop is unrolled, and the loop over lanes
    becomes SIMD.
    """
    terms = len(law.samples) // LANES
    strengths = w[STRENGTHS : STRENGTHS + 5 * STRIDE]
    for s in range(n):
        w[MOMENT + s] = 0.0
        w[AREA + s] = strengths[2 * STRIDE + s]
    for lane in range(LANES):
        if terms == TERMS:
            _add_partial_sums(w, n, lane, TERMS, law, strengths)
        else:
            _add_partial_sums(w, n, lane, terms, law, strengths)
    for s in range(n):
        area = w[AREA + s]
        w[OUTPUT + s] = w[MOMENT + s] / area if area > 0.0 else 0.0


@compiled
def infer_lanes(w, n, law):  # type: ignore[no-untyped-def]
    """Row OUTPUT of n lanes from their normalised errors, rows E_R and E_V."""
    fuzzify(w, n, E_R, GRADES, law.functions[:5])
    fuzzify(w, n, E_V, GRADES + 5 * STRIDE, law.functions[5:10])
    fire(w, n, law.rules)
    defuzzify(w, n, law)


@compiled
def infer_many(errors, law, w, outputs):  # type: ignore[no-untyped-def]
    """Fill outputs (n,) for normalised errors (2, n), position and velocity, in [-1, 1]."""
    for first in range(0, len(outputs), LONGEST):
        n = min(LONGEST, len(outputs) - first)
        for s in range(n):
            w[E_R + s], w[E_V + s] = errors[0, first + s], errors[1, first + s]
        infer_lanes(w, n, law)
        for s in range(n):
            outputs[first + s] = w[OUTPUT + s]
