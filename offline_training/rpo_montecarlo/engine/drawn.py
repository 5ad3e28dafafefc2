# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flights that were drawn: each has a start, mass, disturbance, thrusters and navigation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpo_core.files.scenario import Scenario
from rpo_core.judge.metrics import Windows
from rpo_montecarlo.engine.judged import JudgedTogether
from rpo_montecarlo.engine.parts import Plant, Runs
from rpo_montecarlo.engine.worlds import THRUST

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class DrawnCase(JudgedTogether):
    """Flights that run 40 at a time.

    base : the scenario of which they are variations
    starts : (n, 6) states; masses_kg : (n,)
    batches : their parts, 40 runs each; lanes beyond the last run rest at the target
    windows : in ticks
    together : whether rows have the columns of `judged.VALUES` too; those of `worlds.THRUST` are
        the last ones where thrusters fire in pulses or spend propellant
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

    @property
    def spends(self) -> bool:
        """Whether it is counted what thrusters spend: pulses, or propellant."""
        thrusters = self.base.thrusters
        return thrusters is not None and bool(thrusters.pulses or thrusters.propellant)

    @property
    def columns(self) -> int:
        """Columns of a row."""
        return super().columns + (len(THRUST) if self.spends else 0)


_ESTIMATORS = ('walk', 'queue', 'force', 'rows', 'commands', 'rejected')
"""Fields of `parts.Estimators` that a flight writes."""


def with_own_memory(runs: Runs) -> Runs:
    """Return runs whose memory, which a flight writes, belongs to the caller."""
    if runs.thrusters is not None:
        queue = np.empty_like(runs.thrusters.queue)
        runs = runs._replace(thrusters=runs.thrusters._replace(queue=queue))
    if runs.link is not None:
        link = runs.link
        names = ('past', 'lateness', 'latest', 'held')
        fresh = {name: np.empty_like(getattr(link, name)) for name in names}
        runs = runs._replace(link=link._replace(**fresh))
    if runs.valves is not None:
        valves = runs.valves
        own = {name: np.zeros_like(getattr(valves, name)) for name in ('memory', 'on')}
        runs = runs._replace(valves=valves._replace(**own))
    if runs.orbits is not None:
        runs = runs._replace(orbits=runs.orbits._replace(table=runs.orbits.table.copy()))
    if runs.estimators is not None:
        known = runs.estimators
        own = {name: getattr(known, name).copy() for name in _ESTIMATORS}
        runs = runs._replace(estimators=known._replace(**own))
    return runs
