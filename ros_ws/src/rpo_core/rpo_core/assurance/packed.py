# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The filter with its numbers in one array: a call of a compiled kernel looks at each argument.

Fifty numbers by themselves cost it 15 microseconds, an array one. Interpreted, there is no need.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rpo_core.assurance.filters import assure
from rpo_core.assurance.kernels import Guard
from rpo_core.assurance.turning import assure_turning
from rpo_core.attitude.attitude_kernels import FRAME, frame_at
from rpo_core.attitude.target import Motion
from rpo_core.kernels.arithmetic import State, Vector
from rpo_core.kernels.jit import COMPILED, inlined, kernel
from rpo_core.world.cw import CwStep, unpacked

Answer = tuple[float, float, float, int, int, float, float]


@inlined
def guard_at(t: Any, i: int) -> Guard:
    """Return the guard whose numbers lie in a table from place i on."""
    # fmt: off
    return Guard(
        t[i], t[i + 1], t[i + 2], t[i + 3], t[i + 4], t[i + 5], t[i + 6], t[i + 7], t[i + 8],
        t[i + 9], t[i + 10], t[i + 11], t[i + 12], t[i + 13], t[i + 14], t[i + 15], t[i + 16],
        t[i + 17], t[i + 18], t[i + 19], t[i + 20], int(t[i + 21]), t[i + 22], t[i + 23],
        t[i + 24], t[i + 25], t[i + 26], t[i + 27], t[i + 28], t[i + 29], t[i + 30], t[i + 31],
    )
    # fmt: on


@kernel
def assure_packed(v: Any, t: Any) -> Answer:
    """`assure` of state, command, last force and mode (13,), CW step and guard (58,)."""
    c, g = unpacked(t, 0, 1), guard_at(t, 26)
    state = (v[0], v[1], v[2], v[3], v[4], v[5])
    return assure(state, (v[6], v[7], v[8]), (v[9], v[10], v[11]), int(v[12]), c, g)


@kernel
def assure_turning_packed(v: Any, axes: Any, t: Any) -> Answer:
    """`assure_turning` of the same (13,), CW step and both guards (90,).

    axes : (30,) of the target in the tick in which the force acts, and one later
    """
    c, g, w = unpacked(t, 0, 1), guard_at(t, 26), guard_at(t, 58)
    now, following = frame_at(axes, 0), frame_at(axes, FRAME)
    state, last = (v[0], v[1], v[2], v[3], v[4], v[5]), (v[9], v[10], v[11])
    return assure_turning(state, (v[6], v[7], v[8]), last, int(v[12]), now, following, c, g, w)


class Filter:
    """The filter of one scenario, called tick by tick; the same bits either way.

    table : (58,) CW step and guard; (90,) with the walls that turn
    """

    def __init__(
        self,
        step: CwStep,
        guard: Guard,
        walls: Guard | None = None,
        motion: Motion | None = None,
    ) -> None:
        self._step, self._motion = step, motion
        self.table = np.array([*step, *guard, *(walls or ())], dtype=np.float64)
        self.use(guard, walls)

    def use(self, guard: Guard, walls: Guard | None) -> None:
        """Take these numbers from now on."""
        self._guard, self._walls = guard, walls
        self.table[len(self._step) :] = (*guard, *(walls or ()))

    def __call__(
        self, state: State, command: Vector, last: Vector, mode: int, tick: int = 0
    ) -> Answer:
        """Return what `assurance.filters.assure` returns; tick : in which the force acts."""
        numbers = (*state, *command, *last, mode)
        if self._walls is not None and self._motion is not None:
            if COMPILED:
                frames = self._motion.frames(tick + 2)[tick:].ravel()
                return assure_turning_packed(np.array(numbers), frames, self.table)
            axes = self._motion.frame(tick), self._motion.frame(tick + 1)
            return assure_turning(
                state, command, last, mode, *axes, self._step, self._guard, self._walls
            )
        if not COMPILED:
            return assure(state, command, last, mode, self._step, self._guard)
        return assure_packed(np.array(numbers), self.table)
