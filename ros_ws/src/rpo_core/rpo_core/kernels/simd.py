# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Sums over tables in `LANES` partial sums, which compiled kernels take at once (SIMD).

    numbers = lanes(table)
    for lane in range(passes()):
        partial = 0.0
        for i in range(lane, len(table), LANES):
            partial += numbers[i]
        total = added(total, partial)

Number i belongs to sum i mod `LANES`. Interpreted, one sum follows the other. Compiled, there is
one pass, and `partial` is a vector of all sums. Each adds the same numbers in the same order: the
bits are the same.
"""

from __future__ import annotations

from typing import Any

from rpo_core.kernels.jit import COMPILED

if COMPILED:
    from rpo_core.kernels import numba_simd

LANES = numba_simd.LANES if COMPILED else 8
"""Partial sums: a register of AVX-512, two of AVX2."""


def passes() -> int:
    """Return how many passes take all lanes."""
    return LANES


def lanes(table: Any) -> Any:
    """Return a table (n,); compiled, place i has the numbers of all lanes: 0.0 behind the end."""
    return table


def added(total: float, partial: float) -> float:
    """Return total + partial, one lane after the other."""
    return total + partial


def joined(grade: float, other: float, limit: float) -> float:
    """Return max(grade, min(other, limit))."""
    clipped = other if other < limit else limit
    return clipped if clipped > grade else grade


if COMPILED:
    numba_simd.teach(passes, lanes, added, joined)
