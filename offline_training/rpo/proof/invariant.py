# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A set about the target that the closed loop maps into itself in one tick: there it stays.

On each axis |r| <= R and |v + a r| <= S. At S <= a R the velocity on the side r = R points inward,
so r never leaves; S is fixed by the damping of the control, which `tube.step` checks with the
enclosures of the proof itself. All axes of a group are in it together.
"""

from __future__ import annotations

import itertools

import numpy as np

from rpo.proof.problem import Problem
from rpo.proof.tube import MOST, InvariantSet, Motion, Trace, Zonotope, box_of, is_inside, step

RATES = (0.06, 0.045, 0.08, 0.03, 0.1, 0.15, 0.2)
"""Rates a [1/s] that are tried: of how an axis creeps in."""

SHARES = (0.9, 0.7, 0.5)
"""Sizes S that are tried, as shares of a R."""


def invariant_set_of(
    problem: Problem, radius_m: float, speed_m_s: float | None
) -> InvariantSet | None:
    """Return an invariant set within a radius and, if given, a speed; None if none was found.

    The largest is sought first: tubes enter it sooner. None in a proof per axis.
    """
    if problem.settings.axes_apart:
        return None
    for shrink, rate, share in itertools.product((1.0, 0.7, 0.5, 0.3, 0.2), RATES, SHARES):
        radius = 0.95 * shrink * radius_m
        omega = InvariantSet(radius, rate, share * rate * radius)
        fast = (1.0 + share) * rate * radius
        if speed_m_s is not None and fast > 0.98 * speed_m_s:
            continue
        if all(stays(problem, group, omega) for group in ('planar', 'vertical')):
            return omega
    return None


def stays(problem: Problem, group: str, omega: InvariantSet) -> bool:
    """Whether a tick maps the invariant set into itself."""
    motion = motion_inside(problem, group)
    z, m = as_set(motion, omega)
    trace = Trace.empty(1, len(z.c), 0)
    box_of(z, m, trace.low[0], trace.high[0])
    m = step(problem.table, motion, 0, z, m, trace, 0)
    if m < 0:
        return False
    box_of(z, m, trace.low[1], trace.high[1])
    return bool(is_inside(omega, z, m, trace.low[1], trace.high[1]))


def motion_inside(problem: Problem, group: str) -> Motion:
    """Return a tick in which every disturbance of the problem may be whatever it ever is."""
    motion = problem.motion(group, 1)
    return motion._replace(
        constant=np.zeros_like(motion.constant),
        carried=np.zeros_like(motion.carried),
        any_n=motion.any_n + problem.strongest_n,
    )


def as_set(motion: Motion, omega: InvariantSet) -> tuple[Zonotope, int]:
    """Return the invariant set as a zonotope, and the number of its generators."""
    n = len(motion.a)
    p = n // 2
    first = motion.carried.shape[1]
    g = np.zeros((n, MOST + 4 * n))
    for axis in range(p):
        g[axis, first + 2 * axis] = omega.radius_m
        g[p + axis, first + 2 * axis] = -omega.rate * omega.radius_m
        g[p + axis, first + 2 * axis + 1] = omega.speed_m_s
    return Zonotope(np.zeros(n), g, np.zeros(n)), first + 2 * p
