# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Cases: flights that share everything but start and disturbance."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rpo.engine import lanes
from rpo.engine.judged import VALUES, JudgedTogether
from rpo.engine.lanes import RUNS
from rpo.engine.parts import disturbance, dynamics, goal, thrusters
from rpo.engine.tick import Part, Runs
from rpo_core.judge.metrics import UNITS, Windows, window_ticks, windows_of
from rpo_core.kernels.arrays import Floats, Ints
from rpo_core.scenario.requirements import MAX_ARRIVAL_DISTANCE_M, THRUST
from rpo_core.scenario.scenario import Scenario, ScenarioSet
from rpo_core.world.disturbance import Disturbance


class Crossed(NamedTuple):
    """The distinct planar and vertical loops of a set of starts; pairs : (starts,) of each."""

    runs: Runs
    pairs: Ints

    @property
    def lanes(self) -> Ints:
        """Lanes (starts, 3) x, y, z of each start."""
        p, q = len(self.runs.planar), len(self.runs.vertical)
        planar, vertical = np.divmod(self.pairs, q)
        return np.column_stack([planar, p + planar, 2 * p + vertical])


@dataclass(frozen=True)
class Case(JudgedTogether):
    """Flights that run together.

    starts : (n, 6) states
    disturbances : all that occur; disturbance : (n,) index of the one of each start
    late_s : extremes are taken over the last `late_s` of `horizon_s`
    arrival_m : error of an axis that counts as arrived
    together : whether rows have the columns of `judged.VALUES` too; the horizon is the duration
    """

    base: Scenario
    starts: Floats
    disturbances: tuple[Disturbance, ...]
    disturbance: Ints
    horizon_s: float
    late_s: float
    arrival_m: float = MAX_ARRIVAL_DISTANCE_M
    together: bool = False

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

    @property
    def masses_kg(self) -> Floats:
        """Masses (n,)."""
        return np.full(len(self.starts), self.base.mass_kg)

    @cached_property
    def forces(self) -> Floats:
        """Disturbances (k, horizon, 3) [N]; (k, 1, 3) where there are none."""
        times = self.longer.times_s[:-1]
        if all(d.is_zero for d in self.disturbances):
            times = times[:1]
        return np.array([d.over(times) for d in self.disturbances])

    @cached_property
    def full(self) -> Crossed | None:
        """Loops for any fuzzy controller; None if they are more than the lanes."""
        return _crossed(self, odd=False)

    @cached_property
    def half(self) -> Crossed | None:
        """Loops for an odd controller: its flight from -start is the negative, bit for bit."""
        return _crossed(self, odd=self.base.goal is None and not self.forces.any())

    def paired(self) -> Iterator[Runs]:
        """Yield all starts, `RUNS` at a time; runs beyond the last start rest at the target."""
        pushed, shared = None, len(self.disturbances) == 1
        for first in range(0, len(self.starts), RUNS):
            starts = self.starts[first : first + RUNS]
            states = np.zeros((RUNS, 6))
            states[: len(starts)] = starts
            if pushed is None or not shared:
                d = np.zeros((RUNS, *self.forces.shape[1:]))
                d[: len(starts)] = self.forces[self.disturbance[first : first + RUNS]]
                pushed = disturbance.table_part(np.hstack([d[:, :, axis].T for axis in range(3)]))
            planar, vertical = states[:, [0, 1, 3, 4]], states[:, [2, 5]]
            yield Runs(planar, vertical, (pushed, *_parts(self.base, RUNS, RUNS)))

    def scenarios(self) -> Iterator[Scenario]:
        """Yield every start as a scenario with the duration of the horizon."""
        for start, index in zip(self.starts.tolist(), self.disturbance.tolist(), strict=True):
            yield replace(
                self.longer,
                initial_position_m=tuple(start[:3]),
                initial_velocity_m_s=tuple(start[3:]),
                disturbance=self.disturbances[index],
            )


def _parts(base: Scenario, planar: int, vertical: int) -> list[Part]:
    """Return goal, limit and motion of a scenario, for so many planar and vertical loops."""
    made = [
        thrusters.limit_part(2 * planar + vertical, base.max_force_n),
        dynamics.alike_part(planar, vertical, base.step),
    ]
    if base.goal is not None:
        loops = [planar, planar, vertical]
        made.append(goal.part_of(*(np.repeat(v, loops) for v in base.goal), from_truth=True))
    return made


def _crossed(case: Case, *, odd: bool) -> Crossed | None:
    """Return the loops of a case; with `odd`, starts that differ in sign share one.

    None if there are more than the lanes: of nine positions per axis, or of 46 random starts.
    """

    def distinct(columns: list[int]) -> tuple[Floats, Ints, Ints]:
        starts = case.starts[:, columns]
        if odd:
            first = np.array([next((x for x in row if x != 0.0), 0.0) for row in starts])
            starts = np.where((first < 0.0)[:, None], -starts, starts) + 0.0
        keyed = np.column_stack([starts, case.disturbance])
        rows, which = np.unique(keyed, axis=0, return_inverse=True)
        return rows[:, :-1], rows[:, -1].astype(np.int64), which.ravel()

    planar, pushed, which_planar = distinct([0, 1, 3, 4])
    vertical, lifted, which_vertical = distinct([2, 5])
    if 2 * len(planar) + len(vertical) > lanes.STRIDE:
        return None
    d = case.forces
    table = np.hstack([d[pushed, :, 0].T, d[pushed, :, 1].T, d[lifted, :, 2].T])
    parts = _parts(case.base, len(planar), len(vertical))
    runs = Runs(planar, vertical, (disturbance.table_part(table), *parts))
    return Crossed(runs, which_planar * len(vertical) + which_vertical)


@dataclass(frozen=True)
class DrawnCase(JudgedTogether):
    """Flights that were drawn: each has a start, mass, disturbance, thrusters and navigation.

    base : the scenario of which they are variations
    starts : (n, 6) states; masses_kg : (n,)
    batches : they, 40 runs each; lanes beyond the last run rest at the target
    windows : in ticks
    together : whether rows have the columns of `judged.VALUES` too; those of `requirements.THRUST`
        are the last ones where thrusters fire in pulses or spend propellant
    """

    base: Scenario
    starts: Floats
    masses_kg: Floats
    batches: tuple[Runs, ...]
    windows: Windows
    together: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns of a row."""
        together, own = VALUES if self.together else (), self.base.thrusters
        spends = own is not None and bool(own.fires or own.propellant)
        return (*UNITS, *together, *(THRUST if spends else ()))

    @property
    def columns(self) -> int:
        """Columns of a row."""
        return len(self.names)


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
