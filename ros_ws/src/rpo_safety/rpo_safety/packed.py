# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The filter with its numbers in one array: a call of a compiled kernel looks at each argument.

Fifty numbers by themselves cost it 15 microseconds, an array one. Interpreted, there is no need.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rpo_kernels.jit import COMPILED, kernel
from rpo_kernels.kernels import CwStep, State, Vector, unpacked
from rpo_safety.filters import assure
from rpo_safety.kernels import Guard

Answer = tuple[float, float, float, int, int, float, float]


@kernel
def assure_packed(v: Any, t: Any) -> Answer:
    """`assure` of state, command, last force and mode (13,), CW step and guard (58,)."""
    c = unpacked(t, 0, 1)
    # fmt: off
    g = Guard(
        t[26], t[27], t[28], t[29], t[30], t[31], t[32], t[33], t[34], t[35], t[36], t[37], t[38],
        t[39], t[40], t[41], t[42], t[43], t[44], t[45], t[46], int(t[47]), t[48], t[49], t[50],
        t[51], t[52], t[53], t[54], t[55], t[56], t[57],
    )
    # fmt: on
    state = (v[0], v[1], v[2], v[3], v[4], v[5])
    return assure(state, (v[6], v[7], v[8]), (v[9], v[10], v[11]), int(v[12]), c, g)


class Filter:
    """The filter of one scenario, called tick by tick; the same bits either way.

    table : (58,) CW step and guard
    """

    def __init__(self, step: CwStep, guard: Guard) -> None:
        self._step, self._guard = step, guard
        self.table = np.array([*step, *guard], dtype=np.float64)

    def __call__(self, state: State, command: Vector, last: Vector, mode: int) -> Answer:
        """Return what `rpo_safety.filters.assure` returns."""
        if not COMPILED:
            return assure(state, command, last, mode, self._step, self._guard)
        return assure_packed(np.array((*state, *command, *last, mode)), self.table)
