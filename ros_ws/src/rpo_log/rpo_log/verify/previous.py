# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Signals as they were one tick before, block after block."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class PreviousSignals:
    """Remembers the last tick of each block."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[int, Floats]] = {}

    def of(
        self, name: str, ticks: NDArray[np.int64], values: Floats, missing: Collection[int]
    ) -> Floats:
        """Return the values (n, width) of a signal one tick before each of these ticks.

        missing : ticks at which the reader went on without it: zero

        Zero at tick 0; NaN where the tick before is not in the log.
        """
        found = np.full_like(values, np.nan)
        follows = np.diff(ticks) == 1
        found[1:][follows] = values[:-1][follows]
        tick, last = self._last.get(name, (-1, np.zeros(values.shape[1])))
        if ticks[0] == tick + 1:
            found[0] = last
        found[np.isin(ticks, list(missing))] = 0.0
        self._last[name] = int(ticks[-1]), values[-1].copy()
        return found
