# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Vectors, saturation, sine and cosine: arithmetic with the same bits everywhere.

Plain functions of floats, interpreted or compiled (`rpo_core.kernels.jit`): only + - * / and
comparisons, in the order written.
"""

from __future__ import annotations

from math import sqrt

from rpo_core.kernels.jit import inlined, kernel

MAX_ANGLE_RAD = 1e6
"""Largest angle that `sin_cos` reduces to full precision."""

Vector = tuple[float, float, float]
State = tuple[float, float, float, float, float, float]
"""x, y, z [m], vx, vy, vz [m/s], target LVLH."""


@inlined
def pick(test: bool, a: float, b: float) -> float:
    """Return a where a test holds, else b."""
    return a if test else b


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


_HALF_PI_A = 1.5707963267341256  # pi/2 in three parts; the first two have 33 bits, so that
_HALF_PI_B = 6.077100506303966e-11  # k times a part is exact for |k| < 2**20
_HALF_PI_C = 2.0222662487959506e-21


@inlined
def sin_cos(angle: float) -> tuple[float, float]:
    """Sine and cosine of an angle [rad] below `MAX_ANGLE_RAD`, from + - * only.

    The C library's differ in the last bit between versions and processors; these do not.
    Taylor series on [-pi/4, pi/4], truncated below 5e-18; right to 2.5 units in the last place.
    """
    turns = angle * 0.6366197723675814
    quarter = int(turns + (0.5 if turns >= 0.0 else -0.5))
    r = ((angle - quarter * _HALF_PI_A) - quarter * _HALF_PI_B) - quarter * _HALF_PI_C
    q = r * r
    # fmt: off
    sine = r - r * q * (1 / 6 - q * (1 / 120 - q * (1 / 5040 - q * (1 / 362880 - q * (
        1 / 39916800 - q * (1 / 6227020800 - q * (1 / 1307674368000 - q / 355687428096000)))))))
    cosine = 1.0 - q * (1 / 2 - q * (1 / 24 - q * (1 / 720 - q * (1 / 40320 - q * (
        1 / 3628800 - q * (1 / 479001600 - q * (1 / 87178291200 - q / 20922789888000)))))))
    # fmt: on
    side = quarter & 3
    first, second = (cosine, sine) if side & 1 else (sine, cosine)
    return (-first if side >= 2 else first), (-second if side == 1 or side == 2 else second)
