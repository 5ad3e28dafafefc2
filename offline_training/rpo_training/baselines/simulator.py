# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Many flights of one baseline, start after start: the bits of `rpo_core.flight.fly`.

Some baselines couple all three axes, so each start is flown by itself; their laws are short enough
for that. The figures are those of `rpo_training.batch.combine`.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from rpo_core.baseline_kernels import baseline_force
from rpo_core.baselines import Baseline
from rpo_core.kernels import plant_step, saturate
from rpo_core.metrics import MAX_ARRIVAL_DISTANCE_M
from rpo_training.engine import tick as batch
from rpo_training.engine.lanes import compiled
from rpo_training.engine.simulator import Case

Floats = NDArray[np.float64]


@compiled
def assess(starts, disturbances, which, law, limit, c, times, dt, figures):  # type: ignore[no-untyped-def]
    """Fly from starts (n, 6) and fill figures (n, 8).

    disturbances : (k, horizon, 3) [N], or (k, 1, 3), the same all the time; which : (n,) of them
    """
    for i in range(len(starts)):
        s = starts[i]
        _assess_one(
            (s[0], s[1], s[2], s[3], s[4], s[5]),
            disturbances[which[i]],
            law,
            limit,
            c,
            times,
            dt,
            figures[i],
        )


@compiled
def _assess_one(state, disturbance, law, limit, c, times, dt, row):  # type: ignore[no-untyped-def]
    energy_x = energy_y = energy_z = slew = distance = speed = 0.0
    late_r = late_f = late_vx = late_vy = late_vz = 0.0
    flown, outside = (0.0, 0.0, 0.0), 0
    for tick in range(times.horizon):
        d = disturbance[tick if len(disturbance) > 1 else 0]
        told = baseline_force(state, tick, law)
        force = (saturate(told[0], limit), saturate(told[1], limit), saturate(told[2], limit))
        late = tick >= times.horizon - times.late
        if tick < times.ticks:
            energy_x += force[0] * force[0]
            energy_y += force[1] * force[1]
            energy_z += force[2] * force[2]
            if tick > 0:
                for axis in range(3):
                    slew = max(slew, abs(force[axis] - flown[axis]))
            flown = force
        if late:
            late_f = max(late_f, abs(force[0]), abs(force[1]), abs(force[2]))
        state = plant_step(state, force, (d[0], d[1], d[2]), limit, c)
        x, y, z, vx, vy, vz = state
        furthest = max(abs(x), abs(y), abs(z))
        if tick < times.ticks:
            outside = tick + 1 if furthest > MAX_ARRIVAL_DISTANCE_M else outside
            if tick >= times.ticks - times.tail:
                distance += sqrt(x * x + y * y + z * z)
                speed += sqrt(vx * vx + vy * vy + vz * vz)
        if late:
            late_r = max(late_r, furthest)
            late_vx = max(late_vx, abs(vx))
            late_vy = max(late_vy, abs(vy))
            late_vz = max(late_vz, abs(vz))
    row[0] = (energy_x + energy_y + energy_z) * dt
    row[1] = speed / times.tail
    row[2] = slew / dt
    row[3] = distance / times.tail
    row[4] = late_r
    row[5] = sqrt(late_vx * late_vx + late_vy * late_vy + late_vz * late_vz)
    row[6] = late_f
    row[7] = outside * dt


class BaselineSimulator:
    """Flies baselines through cases, on `workers` threads (0: one per core)."""

    def __init__(self, cases: Sequence[Case], workers: int = 0) -> None:
        self.cases = tuple(cases)
        self._pool = ThreadPoolExecutor(workers or len(os.sched_getaffinity(0)), 'rpo-baselines')

    def __enter__(self) -> BaselineSimulator:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(cancel_futures=True)

    def fly(self, baselines: Sequence[Baseline]) -> list[Floats]:
        """Return the figures (baselines, starts, 8) of each case."""
        outcomes = [np.empty((len(baselines), len(c.starts), batch.FIGURES)) for c in self.cases]

        def one(index: int) -> None:
            for case, outcome in zip(self.cases, outcomes, strict=True):
                base, baseline = case.base, baselines[index]
                baseline.refuse_other_ticks(base.dt_s)
                assess(
                    case.starts,
                    case.disturbances,
                    case.disturbance,
                    baseline.law,
                    base.max_force_n,
                    base.step,
                    case.times,
                    base.dt_s,
                    outcome[index],
                )

        for _ in self._pool.map(one, range(len(baselines))):
            pass
        return outcomes
