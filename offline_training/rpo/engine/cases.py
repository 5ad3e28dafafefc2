# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Cases: flights that share all but start and disturbance, as loops that fly side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rpo.engine.lanes import STRIDE
from rpo.engine.loops import Loops
from rpo_core.judge.metrics import UNITS, VALUES, Windows, window_ticks, windows_of
from rpo_core.kernels.arrays import Floats, Ints
from rpo_core.scenario.requirements import MAX_ARRIVAL_DISTANCE_M
from rpo_core.scenario.scenario import Scenario, ScenarioSet
from rpo_core.world.disturbance import Disturbance

SOME = 40
"""Flights side by side whose loops are not shared: whole SIMD registers, three axes in a row."""

PLANAR, VERTICAL = [0, 1, 3, 4], [2, 5]
"""Columns of a state that are x, y and those that are z."""


class Group(NamedTuple):
    """Flights that fly side by side.

    some : their places in the case
    lanes : (3, k) x, y, z of those that are distinct
    which : (n,) of these, the one that each flight is
    """

    some: slice
    loops: Loops
    lanes: Ints
    which: Ints


@dataclass(frozen=True)
class Case:
    """Flights that run together.

    starts : (n, 6) states
    disturbances : all that occur; disturbance : (n,) index of the one of each start
    late_s : extremes are taken over the last `late_s` of `horizon_s`
    arrival_m : error of an axis that counts as arrived
    together : whether rows have all columns of `VALUES`, not the metrics alone; the horizon is then
        the duration
    """

    base: Scenario
    starts: Floats
    disturbances: tuple[Disturbance, ...]
    disturbance: Ints
    horizon_s: float
    late_s: float
    arrival_m: float = MAX_ARRIVAL_DISTANCE_M
    together: bool = False

    @property
    def columns(self) -> int:
        """Columns of a row."""
        return len(VALUES) if self.together else len(UNITS)

    @cached_property
    def longer(self) -> Scenario:
        """The base, with the duration of the horizon."""
        return replace(self.base, duration_s=self.horizon_s)

    @cached_property
    def windows(self) -> Windows:
        """Windows in ticks."""
        judged = windows_of(self.base)
        late = window_ticks(self.longer, self.late_s)
        return Windows(judged.ticks, judged.tail, self.longer.ticks, late, self.arrival_m)

    @cached_property
    def forces(self) -> Floats:
        """Disturbances (k, horizon, 3) [N]; (k, 1, 3) where there are none."""
        ticks = 1 if all(d.is_zero for d in self.disturbances) else self.longer.ticks
        return np.array([d.over(range(ticks), self.longer.dt_ns) for d in self.disturbances])

    @cached_property
    def crossed(self) -> list[Group]:
        """For laws of each axis: every distinct planar loop with every vertical one."""
        return self._crossed(odd=False)

    @cached_property
    def halved(self) -> list[Group]:
        """For odd laws of each axis: a flight from -start is the negative, bit for bit."""
        return self._crossed(odd=self.base.goal is None and not self.forces.any())

    @cached_property
    def paired(self) -> list[Group]:
        """For any law, some flights at a time."""
        groups = []
        for first in range(0, len(self.starts), SOME):
            some = slice(first, first + SOME)
            starts, disturbance = self.starts[some], self.disturbance[some]
            each = disturbance, np.arange(len(starts))
            xy, z = ((starts[:, columns], *each) for columns in (PLANAR, VERTICAL))
            groups.append(self._group(some, xy, z))
        return groups

    def _crossed(self, odd: bool) -> list[Group]:
        """Return the loops; paired if they are more than the lanes, as of 46 random starts."""
        planar, vertical = (self._distinct(columns, odd) for columns in (PLANAR, VERTICAL))
        if 2 * len(planar[0]) + len(vertical[0]) > STRIDE:
            return self.paired
        return [self._group(slice(0, len(self.starts)), planar, vertical)]

    def _distinct(self, columns: list[int], odd: bool) -> tuple[Floats, Ints, Ints]:
        """Return distinct starts of loops, their disturbances, and which one each flight has.

        odd : starts that differ in sign share one
        """
        starts = self.starts[:, columns]
        if odd:
            first = np.array([next((x for x in row if x != 0.0), 0.0) for row in starts])
            starts = np.where((first < 0.0)[:, None], -starts, starts) + 0.0
        keyed = np.column_stack([starts, self.disturbance])
        rows, which = np.unique(keyed, axis=0, return_inverse=True)
        return rows[:, :-1], rows[:, -1].astype(np.int64), which.ravel()

    def _group(
        self, some: slice, planar: tuple[Floats, Ints, Ints], vertical: tuple[Floats, Ints, Ints]
    ) -> Group:
        """Return a group of loops as `_distinct` returns them."""
        (xy, pushed, which_xy), (z, lifted, which_z) = planar, vertical
        counts, forces, goal = [len(xy), len(xy), len(z)], self.forces, self.base.goal
        position_m, force_n = (np.repeat(v, counts) for v in goal) if goal else np.zeros((2, 0))
        starts = [(xy[:, 0], xy[:, 1], z[:, 0]), (xy[:, 2], xy[:, 3], z[:, 1])]
        loops = Loops(
            len(xy),
            len(z),
            np.array([np.concatenate(axes) for axes in starts]),
            np.hstack([forces[pushed, :, 0].T, forces[pushed, :, 1].T, forces[lifted, :, 2].T]),
            position_m,
            force_n,
            self.base.max_force_n,
            self.base.step,
        )
        pairs, which = np.unique(which_xy + len(xy) * which_z, return_inverse=True)
        z_of, x = np.divmod(pairs, len(xy))
        lanes = np.array([x, len(xy) + x, 2 * len(xy) + z_of])
        return Group(some, loops, lanes, which)

    def scenarios(self) -> Iterator[Scenario]:
        """Yield every start as a scenario with the duration of the horizon."""
        for start, index in zip(self.starts.tolist(), self.disturbance.tolist(), strict=True):
            yield replace(self.longer.starting_at(start), disturbance=self.disturbances[index])


def case_of_set(
    scenarios: ScenarioSet,
    *,
    mass_kg: float | None = None,
    horizon_s: float = 0.0,
    late_s: float = 100.0,
    arrival_m: float = MAX_ARRIVAL_DISTANCE_M,
    together: bool = False,
) -> Case:
    """Return the case of a scenario set; it ends at `horizon_s` if that is later."""
    base = scenarios.base if mass_kg is None else replace(scenarios.base, mass_kg=mass_kg)
    velocity = base.initial_velocity_m_s
    starts = np.array([(*position, *velocity) for position in scenarios.initial_positions_m])
    return Case(
        base,
        starts,
        (base.disturbance,),
        np.zeros(len(starts), np.int64),
        max(horizon_s, base.duration_s),
        late_s,
        arrival_m,
        together,
    )


def case_of_flights(scenarios: Sequence[Scenario], late_s: float) -> Case:
    """Return the case of flights that differ in start and disturbance only."""
    base = scenarios[0]
    disturbances = tuple(dict.fromkeys(s.disturbance for s in scenarios))
    return Case(
        base,
        np.array([s.start for s in scenarios]),
        disturbances,
        np.array([disturbances.index(s.disturbance) for s in scenarios]),
        base.duration_s,
        late_s,
    )
