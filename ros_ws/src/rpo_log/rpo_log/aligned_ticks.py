# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The ticks of a log as rows of arrays, and the commands flown at them, block by block."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import yaml
from numpy.typing import NDArray

from rpo_log import run, topics
from rpo_log.decode import Block
from rpo_log.stream import RunReader

MOST_HELD_TICKS = 1000
"""A force held longer than that is not looked for."""


class AlignedTicks:
    """Ticks of a log beside what they should be; the last row of a block goes before the next.

    forces, disturbances : the answers to the states
    flown, pushes : the forces that acted; in free running others than the answers
    """

    def __init__(
        self, block: Block, before: AlignedTicks | None, disturbed: bool, free: bool = False
    ) -> None:
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
        self.flown, self.pushes = self.forces, self.disturbances
        self.has_flown, self.has_push = self.has_force, self.has_disturbance
        if free:
            self.flown = block.applied_n
            self.has_flown = block.present.get(topics.APPLIED, ~here)
            if disturbed:
                self.pushes = block.applied_disturbances_n
                self.has_push = block.present.get(topics.APPLIED_DISTURBANCE, ~here)
        if before is not None:
            for name, rows in vars(self).items():
                setattr(self, name, np.concatenate([getattr(before, name)[-1:], rows]))

    @property
    def whole(self) -> NDArray[np.bool_]:
        """AlignedTicks that have all their messages."""
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


def held_ticks(reader: RunReader) -> int:
    """Return for how many ticks the plant of a log held a force; -1 if that is not known."""
    try:
        parameters = yaml.safe_load(reader.attachments.get(run.PARAMETERS, b''))
    except yaml.YAMLError:
        return -1
    plant = parameters.get('plant') if isinstance(parameters, Mapping) else None
    ticks = plant.get('stale_after_ticks') if isinstance(plant, Mapping) else None
    return ticks if isinstance(ticks, int) and 0 <= ticks <= MOST_HELD_TICKS else -1


class HeldForces:
    """The answers of the last ticks, of which free running flies one.

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
        flown_n: NDArray[np.float64],
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Return the force (n, 3) [N] that was flown as it was commanded, and where that is known.

        answers_n : (n, 3) of these ticks, NaN where they lack
        """
        new = ticks > self._ticks[-1] if len(self._ticks) else np.ones(len(ticks), dtype=bool)
        known = np.concatenate([self._ticks, ticks[new]])
        given = np.clip(answers_n[new], -self._limit_n, self._limit_n)
        given = np.concatenate([self._forces, given])
        computed, found = np.zeros_like(flown_n), (flown_n == 0.0).all(axis=1)
        sure = np.full(len(ticks), self._most >= 0)
        for age in range(self._most, -1, -1):
            wanted = ticks - age
            at = np.searchsorted(known, wanted).clip(max=len(known) - 1)
            there = (known[at] == wanted) & np.isfinite(given[at]).all(axis=1)
            sure &= there | (wanted < 0)
            computed[there] = np.where(found[there, None], computed[there], given[at][there])
            found |= there & (given[at] == flown_n).all(axis=1)
        computed[found] = flown_n[found]
        kept = known >= ticks[-1] - max(self._most, 0)
        self._ticks, self._forces = known[kept], given[kept]
        return computed, sure | found
