# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The algebra of the Kalman filter: a step of the motion, and the update by one measured number.

An update is in Joseph's form: P - K h' P, then the same from the other side, plus K r K'. Source:
Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, 5.2
and 10.4.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

from rpo_core.kernels import CwStep, Vector, cw_step
from rpo_core.kernels.jit import inlined, kernel


@kernel
def step_state(x: Any, n: int, force: Vector, step: CwStep) -> None:
    """Move the state by one tick under a force (3,) [N]."""
    fx, fy, fz = force
    if n == 9:
        fx, fy, fz = fx + x[6], fy + x[7], fz + x[8]
    moved = cw_step((x[0], x[1], x[2], x[3], x[4], x[5]), (fx, fy, fz), step)
    for i in range(6):
        x[i] = moved[i]


@kernel
def _step_line(p: Any, first: int, stride: int, n: int, step: CwStep) -> None:
    """Move a row (stride 1) or a column (stride n) of a table as `step_state` moves a state."""
    force = (0.0, 0.0, 0.0)
    if n == 9:
        force = (p[first + 6 * stride], p[first + 7 * stride], p[first + 8 * stride])
    line = (
        p[first],
        p[first + stride],
        p[first + 2 * stride],
        p[first + 3 * stride],
        p[first + 4 * stride],
        p[first + 5 * stride],
    )
    moved = cw_step(line, force, step)
    for i in range(6):
        p[first + i * stride] = moved[i]


@kernel
def step_covariance(p: Any, n: int, step: CwStep, noise: Any) -> None:
    """Replace P by F P F' + Q."""
    for column in range(n):
        _step_line(p, column, n, n, step)
    for row in range(6):  # a disturbance stays: so do the rows of it
        _step_line(p, n * row, 1, n, step)
    for row in range(n):
        for column in range(row, n):
            value = p[n * row + column] + noise[n * row + column]
            p[n * row + column] = value
            p[n * column + row] = value


@inlined
def shown(h: Vector, a: float, b: float, c: float) -> float:
    """Return what a measurement shows of three numbers."""
    return h[0] * a + h[1] * b + h[2] * c


@inlined
def variance_of(noise: float, h: Vector, a: float, b: float, c: float) -> float:
    """Return the variance of an innovation: that of the noise, and h' (P h)."""
    return noise + h[0] * a + h[1] * b + h[2] * c


@inlined
def joseph(
    value: float, gain: float, shared: float, rest: float, other: float, noise: float
) -> float:
    """Return an element (a, b) of the covariance after an update.

    gain, rest, noise : K, (I - K h') P h and K r of a; shared, other : P h and K of b
    """
    return value - gain * shared - rest * other + noise * other


@kernel
def update(
    x: Any, p: Any, n: int, first: int, h: Vector, measured: float, variance: float, work: Any
) -> float:
    """Take one measured number, h . x[first : first + 3] plus noise; return innovation / sigma.

    work : (2 n) scratch
    """
    for i in range(n):
        work[i] = shown(h, p[n * i + first], p[n * i + first + 1], p[n * i + first + 2])
    spread = variance_of(variance, h, work[first], work[first + 1], work[first + 2])
    innovation = measured - shown(h, x[first], x[first + 1], x[first + 2])
    for i in range(n):
        work[n + i] = work[i] / spread
        x[i] += work[n + i] * innovation
    share = spread - variance  # h' P h
    for a in range(n):
        gain = work[n + a]
        rest = work[a] - gain * share  # of (I - K h') P h
        for b in range(a, n):
            value = joseph(p[n * a + b], gain, work[b], rest, work[n + b], gain * variance)
            p[n * a + b] = value
            p[n * b + a] = value
    return innovation / sqrt(spread)
