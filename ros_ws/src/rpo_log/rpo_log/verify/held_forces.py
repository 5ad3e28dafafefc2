# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Free running: whether a force that was applied is one that had been commanded not long before."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rpo_log.read.run_log import parameters_of
from rpo_log.read.stream import RunReader

MOST_HELD_TICKS = 1000
"""A force held longer than that is not looked for."""


def held_ticks(reader: RunReader) -> int:
    """Return for how many ticks the plant of a log held a force; -1 if that is not known."""
    plant = parameters_of(reader).get('plant')
    ticks = plant.get('stale_after_ticks') if isinstance(plant, Mapping) else None
    return ticks if type(ticks) is int and 0 <= ticks <= MOST_HELD_TICKS else -1


class HeldForces:
    """The answers of the last ticks, of which free running applies one.

    ticks : for how many a force is held; -1: not known, and nothing is
    limit_n : of the thrusters
    """

    def __init__(self, ticks: int, limit_n: float) -> None:
        self._most, self._limit_n = ticks, limit_n
        self._ticks = np.empty(0, dtype=np.int64)
        self._forces = np.empty((0, 3))

    def held(
        self,
        ticks: NDArray[np.int64],
        answers_n: NDArray[np.float64],
        applied_n: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the force (n, 3) [N] applied, as it was commanded, and where that is known.

        answers_n : (n, 3) of these ticks, NaN where they are missing
        """
        new = ticks > self._ticks[-1] if len(self._ticks) else np.ones(len(ticks), dtype=bool)
        known = np.concatenate([self._ticks, ticks[new]])
        commanded = np.clip(answers_n[new], -self._limit_n, self._limit_n)
        commanded = np.concatenate([self._forces, commanded])
        computed, found = np.zeros_like(applied_n), (applied_n == 0.0).all(axis=1)
        sure = np.full(len(ticks), self._most >= 0)
        for age in range(self._most, -1, -1):
            wanted = ticks - age
            at = np.searchsorted(known, wanted).clip(max=len(known) - 1)
            there = (known[at] == wanted) & np.isfinite(commanded[at]).all(axis=1)
            sure &= there | (wanted < 0)
            computed[there] = np.where(found[there, None], computed[there], commanded[at][there])
            found |= there & (commanded[at] == applied_n).all(axis=1)
        computed[found] = applied_n[found]
        kept = known >= ticks[-1] - max(self._most, 0)
        self._ticks, self._forces = known[kept], commanded[kept]
        return computed, sure | found
