# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Laws that treat all axes alike, for many axes side by side: the bits of `baseline_force`.

A law of `baselines` branches for each axis. Here no loop over axes does, so that each
becomes SIMD: what a search of a force table flies takes a third of the time.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rpo_core.control.baselines import BaselineLaw, table_inputs
from rpo_core.kernels.jit import inlined

ROWS = 6
"""Rows of the room that a law needs."""


@inlined
def _locate(x: Any, knots: Any, index: Any, low: Any, high: Any) -> None:
    """Fill `index` as `baselines.interval` does, and put its share into x.

    low, high : room
    """
    for s in range(len(x)):
        index[s], low[s], high[s] = 0.0, knots[0], knots[1]
    for k in range(1, len(knots) - 1):
        first, second = knots[k], knots[k + 1]
        for s in range(len(x)):
            beyond = x[s] >= first
            index[s] = float(k) if beyond else index[s]
            low[s] = first if beyond else low[s]
            high[s] = second if beyond else high[s]
    for s in range(len(x)):
        share = (x[s] - low[s]) / (high[s] - low[s])
        share = 0.0 if share < 0.0 else share
        x[s] = 1.0 if share > 1.0 else share


@inlined
def axis_forces(r: Any, v: Any, forces: Any, work: Any, tick: int, law: BaselineLaw) -> None:
    """Fill forces (n,) [N] of axes at positions r (n,) [m] and velocities v (n,) [m/s].

    The law has a table of forces, or gains whose rows are (k, 0, 0, d, 0, 0) and so on.

    work : room of `ROWS` rows of at least n numbers
    """
    n, size, limit = len(r), len(work) // ROWS, law.limit
    if len(law.forces) == 0:
        last = len(law.gains) - 1
        row = law.gains[tick if tick < last else last]
        for s in range(n):
            pull = row[0] * r[s] + row[3] * v[s]
            pull = limit if pull > limit else pull
            forces[s] = -(-limit if pull < -limit else pull)
        return
    x, y = work[:n], work[size : size + n]
    i, j = work[2 * size : 2 * size + n], work[3 * size : 3 * size + n]
    low, high = work[4 * size : 4 * size + n], work[5 * size : 5 * size + n]
    for s in range(n):
        x[s], y[s] = table_inputs(r[s], v[s])
    _locate(x, law.distances, i, low, high)
    _locate(y, law.speeds, j, low, high)
    table, one, columns = law.forces, np.uint64(1), np.uint64(len(law.speeds))
    for s in range(n):
        at = np.uint64(len(law.speeds) * i[s] + j[s])
        beyond = at + columns
        near = (1.0 - y[s]) * table[at] + y[s] * table[at + one]
        far = (1.0 - y[s]) * table[beyond] + y[s] * table[beyond + one]
        pull = (1.0 - x[s]) * near + x[s] * far
        pull = limit if pull > limit else pull
        pull = -limit if pull < -limit else pull
        forces[s] = -pull if r[s] >= 0.0 else pull
