# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Navigation noise as a function of (key of the run, tick): no state, the same bits anywhere.

Random words are Philox4x32-10 (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", SC11),
normals are by Box and Muller. Everything is + - * / sqrt and comparisons on floats, and integers
below 2^63, so that it runs interpreted, compiled and in SIMD lanes with the same bits.
"""

from __future__ import annotations

from math import sqrt

from rpo_core.kernels.jit import inlined

Words = tuple[int, int, int, int]

_MASK = 0xFFFFFFFF
_ROUND_A, _ROUND_B = 0xD2511F53, 0xCD9E8D57
_KEY_A, _KEY_B = 0x9E3779B9, 0xBB67AE85
_LN_2 = 0.6931471805599453
_HALF_PI = 1.5707963267948966


@inlined
def philox(c0: int, c1: int, c2: int, c3: int, k0: int, k1: int) -> Words:
    """Return 4 random words of 32 bits, of a counter (4 words) and a key (2 words)."""
    for _ in range(10):
        a, b = _ROUND_A * c0, _ROUND_B * c2
        c0, c1, c2, c3 = (
            ((b >> 32) & _MASK) ^ c1 ^ k0,
            b & _MASK,
            ((a >> 32) & _MASK) ^ c3 ^ k1,
            a & _MASK,
        )
        k0, k1 = (k0 + _KEY_A) & _MASK, (k1 + _KEY_B) & _MASK
    return c0, c1, c2, c3


@inlined
def log_unit(word: int) -> float:
    """Natural logarithm of (word + 1/2) / 2^32, of a word of 32 bits; right to 1e-15."""
    x = (word + 0.5) * 2.3283064365386963e-10
    e = 0.0
    small = x < 1.52587890625e-05
    x, e = (x * 65536.0 if small else x), (e - 16.0 if small else e)
    small = x < 0.00390625
    x, e = (x * 256.0 if small else x), (e - 8.0 if small else e)
    for _ in range(2):
        small = x < 0.0625
        x, e = (x * 16.0 if small else x), (e - 4.0 if small else e)
    for _ in range(4):
        small = x < 0.7071067811865476
        x, e = (x * 2.0 if small else x), (e - 1.0 if small else e)
    s = (x - 1.0) / (x + 1.0)
    q = s * s
    # fmt: off
    series = 1.0 + q * (1 / 3 + q * (1 / 5 + q * (1 / 7 + q * (1 / 9 + q * (1 / 11 + q * (
        1 / 13 + q * (1 / 15 + q * (1 / 17 + q * (1 / 19)))))))))
    # fmt: on
    return 2.0 * s * series + e * _LN_2


@inlined
def normal_pair(a: int, b: int) -> tuple[float, float]:
    """Return two independent standard normals of two words of 32 bits, by Box and Muller.

    The angle is 2 pi (b + 1/2) / 2^32: its first two bits choose the quadrant.
    """
    radius = sqrt(-2.0 * log_unit(a))
    quarter = b >> 30
    r = (((b & 0x3FFFFFFF) + 0.5) * 9.313225746154785e-10 - 0.5) * _HALF_PI
    q = r * r
    # fmt: off
    sine = r - r * q * (1 / 6 - q * (1 / 120 - q * (1 / 5040 - q * (1 / 362880 - q * (
        1 / 39916800 - q * (1 / 6227020800 - q / 1307674368000))))))
    cosine = 1.0 - q * (1 / 2 - q * (1 / 24 - q * (1 / 720 - q * (1 / 40320 - q * (
        1 / 3628800 - q * (1 / 479001600 - q / 87178291200))))))
    # fmt: on
    odd = (quarter & 1) == 1
    first, second = (cosine, sine) if odd else (sine, cosine)
    first = -first if quarter >= 2 else first
    second = -second if quarter == 1 or quarter == 2 else second
    return radius * first, radius * second


@inlined
def six_normals(tick: int, k0: int, k1: int) -> tuple[float, float, float, float, float, float]:
    """Return six independent standard normals of a tick of the run with key (k0, k1)."""
    a0, a1, a2, a3 = philox(tick, 0, 0, 0, k0, k1)
    b0, b1, _, _ = philox(tick, 1, 0, 0, k0, k1)
    n0, n1 = normal_pair(a0, a1)
    n2, n3 = normal_pair(a2, a3)
    n4, n5 = normal_pair(b0, b1)
    return n0, n1, n2, n3, n4, n5
