# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The least energy that physics allows: to rest in fixed time, and under training's conditions.

Forces are held for a tick, as in the plant, and a known disturbance acts. Without limits the
optimum is closed form, by the discrete Gramian; under limits of force, slew, arrival speed and
arrival distance it is a convex program (quadratic cost, linear and second-order cone constraints),
solved by Clarabel through cvxpy. Both return a `Flight` with the metrics of any other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from rpo_core.chain.flight import Flight, OpenLoop, fly
from rpo_core.files.validation import InputError, real
from rpo_core.judge import metrics
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.requirements import (
    ARRIVAL_WINDOW_S,
    MAX_ARRIVAL_DISTANCE_M,
    MAX_ARRIVAL_SPEED_M_S,
    MAX_SLEW_N_S,
)
from rpo_core.scenario.scenario import Scenario
from rpo_core.world import cw

COAST_S = ARRIVAL_WINDOW_S
"""Arriving at rest this long before the end and coasting meets every arrival condition."""

_UNITS = {'force': 'N', 'slew': 'N/s', 'arrival_speed': 'm/s', 'arrival_distance': 'm'}
_SCALE = np.array([100.0, 100.0, 100.0, 1.0, 1.0, 1.0])  # of the solver's states [m, m/s]
_FORCE_SCALE_N = 0.1


@dataclass(frozen=True)
class Conditions:
    """Limits of an optimum, as `rpo_core.judge.metrics` judges them.

    force : largest |f| of an axis [N]
    slew : largest |df/dt| of an axis [N/s], the step from rest not counted
    arrival_speed, arrival_distance : mean norms over the last 30 s [m/s], [m]
    """

    force: float
    slew: float = MAX_SLEW_N_S
    arrival_speed: float = MAX_ARRIVAL_SPEED_M_S
    arrival_distance: float = MAX_ARRIVAL_DISTANCE_M

    def __post_init__(self) -> None:
        for name, unit in _UNITS.items():
            real(f'conditions.{name}', getattr(self, name), unit, above=0.0)

    @classmethod
    def of(cls, scenario: Scenario) -> Conditions:
        """Return training's conditions with the thrusters of a scenario."""
        return cls(scenario.max_force_n)


def gramian(scenario: Scenario, ticks: int) -> tuple[Floats, Floats, Floats]:
    """Return reach (ticks, 6, 3), W (6, 6) and A^N (6, 6) of N = `ticks` held forces.

    Force k moves the final state by reach[k] f_k = A^(N-1-k) B f_k; W = sum of reach reach'.
    """
    _refuse_goal(scenario)
    a, b = cw.matrices(scenario.step)
    reach, power = np.empty((ticks, 6, 3)), np.eye(6)
    for k in range(ticks - 1, -1, -1):
        reach[k] = power @ b
        power = a @ power
    return reach, np.einsum('kij,klj->il', reach, reach), power


def _refuse_goal(scenario: Scenario) -> None:
    if scenario.goal is not None:
        raise InputError(
            f'an optimum ends at the target; scenario {scenario.name} has a `goal_position_m` '
            'of its own'
        )


def _ticks(scenario: Scenario, coast_s: float) -> int:
    ticks = scenario.ticks - round(coast_s / scenario.dt_s)
    if ticks < 2:  # two velocities and positions per axis need two forces
        raise InputError(
            f'`coast_s` must leave at least 2 ticks of the {scenario.duration_s:g} s; '
            f'got {coast_s:g}'
        )
    return ticks


def least_energy(scenario: Scenario, starts: Floats, coast_s: float = 0.0) -> Floats:
    """Return the least J [N²s] (n,) that brings starts (n, 6) to rest at the origin in time.

    Minimum of sum |f_k|^2 dt without limits: m' W^-1 m dt, m the miss of free drift. With
    `coast_s` rest is reached that much earlier.
    """
    reach, w, drift = gramian(scenario, _ticks(scenario, coast_s))
    pushed = np.einsum('kij,kj->i', reach, scenario.disturbances_n[: len(reach)])
    miss = starts @ drift.T + pushed
    return np.einsum('ij,ij->i', miss, np.linalg.solve(w, miss.T).T) * scenario.dt_s


def to_rest(scenario: Scenario, coast_s: float = 0.0) -> Flight:
    """Return the flight of least energy to rest at the origin, without limits.

    While coasting, the force cancels the disturbance, so that the chaser stays at rest; that costs
    no energy where there is no disturbance, and is not counted by `least_energy`.
    """
    reach, w, drift = gramian(scenario, _ticks(scenario, coast_s))
    disturbances = scenario.disturbances_n
    pushed = np.einsum('kij,kj->i', reach, disturbances[: len(reach)])
    forces = -disturbances[:-1]
    multiplier = np.linalg.solve(w, drift @ np.array(scenario.start) + pushed)
    forces[: len(reach)] = -np.einsum('kij,i->kj', reach, multiplier)
    return _fly_open_loop(scenario, forces)


def _fly_open_loop(scenario: Scenario, forces: Floats) -> Flight:
    """Return the flight of forces (N, 3) through the plant, with its limit raised to them."""
    limit = max(scenario.max_force_n, float(np.abs(forces).max()))
    lifted = replace(scenario, max_force_n=limit)
    return fly(lifted, OpenLoop(forces))


class Program:
    """The convex program of a scenario; compiled once, solved for any number of starts.

    relaxed : a condition whose limit is minimised instead of the energy, to explain infeasibility
    """

    def __init__(
        self, scenario: Scenario, conditions: Conditions | None = None, relaxed: str = ''
    ) -> None:
        try:
            import cvxpy as cp
        except ImportError:
            raise InputError(
                'the optimum needs cvxpy and clarabel (`make setup LAYERS=campaign`)'
            ) from None
        _refuse_goal(scenario)
        self.scenario, self.conditions = scenario, conditions or Conditions.of(scenario)
        self._start = cp.Parameter(6)
        self._states = cp.Variable((scenario.ticks + 1, 6))
        self._forces = cp.Variable((scenario.ticks, 3))
        limits: dict[str, Any] = asdict(self.conditions)
        cost: Any = cp.sum_squares(self._forces)
        if relaxed:
            cost = limits[relaxed] = cp.Variable(nonneg=True)
        a, b = cw.matrices(scenario.step)
        a, b = a * _SCALE / _SCALE[:, None], b / _SCALE[:, None]
        pushed = scenario.disturbances_n[:-1] @ b.T
        x, f = self._states, self._forces
        step = x[1:] == x[:-1] @ a.T + f @ (b.T * _FORCE_SCALE_N) + pushed
        motion = [x[0] == self._start, step]
        self._problem = cp.Problem(cp.Minimize(cost), [*motion, *self._within(limits)])

    def _within(self, limits: dict[str, Any]) -> list[Any]:
        import cvxpy as cp

        last = metrics.window_ticks(self.scenario, ARRIVAL_WINDOW_S)
        step = limits['slew'] * self.scenario.dt_s
        distance = cp.sum(cp.norm(self._states[-last:, :3], 2, axis=1)) / last * _SCALE[0]
        speed = cp.sum(cp.norm(self._states[-last:, 3:], 2, axis=1)) / last * _SCALE[3]
        slews = []
        if self.scenario.ticks > 1:
            slews.append(cp.abs(cp.diff(self._forces, axis=0)) <= step / _FORCE_SCALE_N)
        return [
            cp.abs(self._forces) <= limits['force'] / _FORCE_SCALE_N,
            *slews,
            speed <= limits['arrival_speed'],
            distance <= limits['arrival_distance'],
        ]

    def solve(self, start: Sequence[float] | Floats) -> float | None:
        """Return the optimum from a state (6,): J [N²s], or the relaxed limit; None if none."""
        import cvxpy as cp

        self._start.value = np.asarray(start, dtype=np.float64) / _SCALE
        try:
            self._problem.solve(solver=cp.CLARABEL)
        except cp.error.SolverError as error:
            raise InputError(f'the solver failed on the optimum: {error}') from None
        if self._problem.status in (cp.INFEASIBLE, cp.INFEASIBLE_INACCURATE):
            return None
        if self._problem.status != cp.OPTIMAL:
            raise InputError(f'the solver found no reliable optimum: {self._problem.status}')
        value = float(self._problem.value)
        if isinstance(self._problem.objective.args[0], cp.Variable):
            return value
        return value * _FORCE_SCALE_N**2 * self.scenario.dt_s

    @property
    def forces_n(self) -> Floats:
        """Forces (N, 3) of the last optimum."""
        return np.asarray(self._forces.value) * _FORCE_SCALE_N


def constrained(scenario: Scenario, conditions: Conditions | None = None) -> Flight:
    """Return the flight of least energy under conditions; by default those of training.

    Raises InputError if there is none; it names the limits that would allow one.
    """
    program = Program(scenario, conditions)
    if program.solve(scenario.start) is None:
        raise _infeasible(scenario, program.conditions)
    return _fly_open_loop(scenario, program.forces_n)


def _infeasible(scenario: Scenario, conditions: Conditions) -> InputError:
    ways = []
    for name, unit in _UNITS.items():
        limit = Program(scenario, conditions, relaxed=name).solve(scenario.start)
        if limit is not None:
            ways.append(f'{name} {limit:.4g} {unit} instead of {getattr(conditions, name):.4g}')
    position = ', '.join(f'{r:g}' for r in scenario.initial_position_m)
    return InputError(
        f'no flight of {scenario.duration_s:g} s from [{position}] m meets all conditions; '
        + (f'it would take {" or ".join(ways)}' if ways else 'lifting any single one is not enough')
    )


def least_constrained(
    scenario: Scenario,
    starts: Floats,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Floats:
    """Return the least J [N²s] (n,) from starts (n, 6) under training's conditions.

    Undisturbed, the optimum does not change with the sign of the planar (x, y) or of the vertical
    (z) start: of starts that differ only in such a sign, one is solved. Raises InputError if there
    is none from one of the starts.
    """
    keys = [_mirrored(start) if scenario.disturbance.is_zero else tuple(start) for start in starts]
    distinct = sorted(set(keys))
    program = Program(scenario, Conditions.of(scenario))
    energies = {}
    for done, key in enumerate(distinct):
        progress(done, len(distinct))
        value = program.solve(key)
        if value is None:
            raise _infeasible(scenario.starting_at(key), program.conditions)
        energies[key] = value
    progress(len(distinct), len(distinct))
    return np.array([energies[key] for key in keys])


def _mirrored(start: Floats) -> tuple[float, ...]:
    mirrored = start + 0.0
    for columns in ([0, 1, 3, 4], [2, 5]):
        if next((value for value in start[columns] if value != 0.0), 0.0) < 0.0:
            mirrored[columns] = -start[columns] + 0.0
    return tuple(mirrored.tolist())
