# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The ticks of a log as rows of arrays, and the commands flown at them, block by block."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rpo_log import topics
from rpo_log.decode import Block


class Rows:
    """Ticks of a log beside what they should be; the last row of a block goes before the next."""

    def __init__(self, block: Block, before: Rows | None, disturbed: bool) -> None:
        here = np.ones(len(block.ticks), dtype=bool)
        self.ticks = block.ticks
        self.states = block.states
        self.forces = block.forces_n
        self.disturbances = block.disturbances_n if disturbed else np.zeros((len(here), 3))
        self.navigation = block.navigation
        self.has_state = block.present.get(topics.STATE, ~here)
        self.has_navigation = block.present.get(topics.NAVIGATION, ~here)
        self.has_force = block.present.get(topics.FORCE, ~here)
        self.has_disturbance = block.present.get(topics.DISTURBANCE, ~here) if disturbed else here
        if before is not None:
            for name, rows in vars(self).items():
                setattr(self, name, np.concatenate([getattr(before, name)[-1:], rows]))

    @property
    def whole(self) -> NDArray[np.bool_]:
        """Rows that have all their messages."""
        return self.has_state & self.has_force & self.has_disturbance


class DelayLine:
    """The commands flown: at each tick that of `delay_ticks` before, at first none."""

    def __init__(self, delay_ticks: int) -> None:
        self._delay = delay_ticks
        self._ticks = np.empty(0, dtype=np.int64)
        self._forces = np.empty((0, 3))

    def flown(self, ticks: NDArray[np.int64], forces_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the commands (n, 3) [N] flown at the ticks (n,) of a block, NaN where they lack.

        forces_n : (n, 3) commands of these ticks; a block may begin with the last tick of another
        """
        new = ticks > self._ticks[-1] if len(self._ticks) else np.ones(len(ticks), dtype=bool)
        known = np.concatenate([self._ticks, ticks[new]])
        commands = np.concatenate([self._forces, forces_n[new]])
        wanted = ticks - self._delay
        at = np.searchsorted(known, wanted).clip(max=len(known) - 1)
        flown = np.where((known[at] == wanted)[:, None], commands[at], np.nan)
        flown[wanted < 0] = 0.0
        kept = known >= wanted[-1]
        self._ticks, self._forces = known[kept], commands[kept]
        return flown
