# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Lanes: the rows of the scratch, and fuzzy inference over them with the bits of the kernel.

The scratch is one flat array of rows of `STRIDE` lanes. Every inner loop runs over lanes, which the
compiler turns into SIMD.

In the inference each lane does the arithmetic of `rpo_core.control.inference.infer` in its order:
the centroid's eight partial sums one after the other, padded with zero grades where the samples end
(adding +0 changes no bit).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rpo_core.control.inference import memberships
from rpo_core.kernels import jit
from rpo_core.kernels.jit import Kernel, unlocked
from rpo_core.kernels.simd import LANES

STRIDE = 136
"""Lanes at most. 17 cache lines, an odd number, so that the rows do not contend for the same lines
of the first-level cache."""

TERMS = 7
"""Samples in one partial sum of the unrolled centroid: ceil(50 / 8) at 101 samples."""

# Rows of the scratch. Position and velocity errors in, force out; the rest is in between.
E_R, E_V, OUTPUT, MOMENT, AREA = (row * STRIDE for row in range(5))
GRADES = 5 * STRIDE  # 5 rows of position, 5 of velocity grades
STRENGTHS = 15 * STRIDE  # 5 rows

# Position and velocity; position from the goal; command; that of the tick before; disturbance; then
# what is counted.
R, V, FROM_GOAL, FORCE, BEFORE, DISTURBANCE = ((20 + row) * STRIDE for row in range(6))
ENERGY, EFFORT, SLEW, LATE_R, LATE_V, LATE_F, OUTSIDE = ((26 + row) * STRIDE for row in range(7))
ROWS = 33

STORED = 0.0
"""Added to a maximum that goes back to the row it came from, a number >= 0: it changes no bit. With
AVX2, LLVM would otherwise store under a mask (`vmaskmovpd`), in microcode on AMD processors."""


def by_constant(function: Kernel) -> Kernel:
    """Compile so for each row or count that it is called with: its loops over lanes become SIMD."""
    return jit.compiled(function, by_constant=True, nogil=True)


class Law(NamedTuple):
    """A fuzzy controller as the kernels read it.

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


def make_law(samples: int, scales: Any, functions: Any, rules: Any) -> Law:
    """Return a law with an odd number of output samples."""
    half = (samples - 1) // 2
    of_samples = np.zeros((4, -(-half // LANES) * LANES))
    of_samples[0, :half] = np.arange(1, half + 1) / half
    numbers = (np.array(values, np.float64) for values in (scales, functions, rules))
    law = Law(*numbers, *of_samples)
    _grade(law)
    return law


def make_scratch() -> Any:
    """Return the scratch of one worker; it begins with a line of the cache."""
    room = np.zeros(ROWS * STRIDE + LANES)
    return room[-(room.ctypes.data // room.itemsize) % LANES :][: ROWS * STRIDE]


@unlocked
def _grade(law):  # type: ignore[no-untyped-def]
    feet = law.functions
    force = (feet[10], feet[11], feet[12], feet[13], feet[14])
    for i in range(len(law.samples)):
        if law.samples[i] > 0.0:
            _, _, law.z[i], law.sp[i], law.lp[i] = memberships(law.samples[i], force)


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


@unlocked
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


@unlocked
def _joined(grade, other, limit):  # type: ignore[no-untyped-def]
    clipped = other if other < limit else limit
    return clipped if clipped > grade else grade


@by_constant
def _add_partial_sums(w, n, lane, terms, law, strengths):  # type: ignore[no-untyped-def]
    for s in range(n):
        ln, sn, zero = strengths[s], strengths[STRIDE + s], strengths[2 * STRIDE + s]
        sp, lp = strengths[3 * STRIDE + s], strengths[4 * STRIDE + s]
        moment = area = 0.0
        for k in range(terms):
            i = LANES * k + lane
            grade = law.z[i]
            right = left = grade if grade < zero else zero
            right = _joined(_joined(right, law.sp[i], sp), law.lp[i], lp)
            left = _joined(_joined(left, law.sp[i], sn), law.lp[i], ln)
            moment += law.samples[i] * (right - left)
            area += right + left
        w[MOMENT + s] += moment
        w[AREA + s] += area


@unlocked
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


@unlocked
def infer_lanes(w, n, law):  # type: ignore[no-untyped-def]
    """Row OUTPUT of n lanes from their normalised errors, rows E_R and E_V."""
    fuzzify(w, n, E_R, GRADES, law.functions[:5])
    fuzzify(w, n, E_V, GRADES + 5 * STRIDE, law.functions[5:10])
    fire(w, n, law.rules)
    defuzzify(w, n, law)


@unlocked
def infer_many(errors, law, w, outputs):  # type: ignore[no-untyped-def]
    """Fill outputs (n,) for normalised errors (2, n), position and velocity, in [-1, 1]."""
    for first in range(0, len(outputs), STRIDE):
        n = min(STRIDE, len(outputs) - first)
        for s in range(n):
            w[E_R + s], w[E_V + s] = errors[0, first + s], errors[1, first + s]
        infer_lanes(w, n, law)
        for s in range(n):
            outputs[first + s] = w[OUTPUT + s]
