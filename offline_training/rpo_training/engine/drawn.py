# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flights that were drawn: each has a start, mass, disturbance, thrusters and navigation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpo_core.metrics import Windows
from rpo_core.scenario import Scenario
from rpo_training.engine.judged import JudgedTogether
from rpo_training.engine.parts import Plant, Runs

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class DrawnCase(JudgedTogether):
    """Flights that run 40 at a time.

    base : the scenario of which they are variations
    starts : (n, 6) states; masses_kg : (n,)
    batches : their parts, 40 runs each; lanes beyond the last run rest at the target
    windows : in ticks
    together : whether rows have the columns of `judged.VALUES` too
    """

    name: str
    base: Scenario
    starts: Floats
    masses_kg: Floats
    batches: tuple[Runs, ...]
    windows: Windows
    together: bool = False

    @property
    def plant(self) -> Plant:
        """What all flights share; each has a step of its own."""
        return Plant(self.base.max_force_n, self.base.dt_s)


def with_own_queue(runs: Runs) -> Runs:
    """Return runs whose queue, which a flight writes, belongs to the caller."""
    if runs.thrusters is not None:
        queue = np.empty_like(runs.thrusters.queue)
        runs = runs._replace(thrusters=runs.thrusters._replace(queue=queue))
    if runs.link is not None:
        link = runs.link
        names = ('past', 'lateness', 'latest', 'held')
        fresh = {name: np.empty_like(getattr(link, name)) for name in names}
        runs = runs._replace(link=link._replace(**fresh))
    return runs
