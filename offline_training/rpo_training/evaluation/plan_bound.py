# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The least energy that a plan could need: the same begin, end and time, by convex programs.

Free: without zones, closed form; no flight of that time needs less. With the zones: the keep-out
sphere is not convex. Successive convex programs replace it by half-spaces, tangent where the path
before came closest, and hold the cone of the corridor while the plan is in it. They end at a local
optimum near the plan (cvxpy, Clarabel).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core import cw
from rpo_core.scenario import Scenario
from rpo_core.validation import InputError
from rpo_guidance.plan import Guidance
from rpo_guidance.rehearsal import Checked, nominal

Floats = NDArray[np.float64]

SEGMENT_S = 2.0
ROUNDS = 8
_METRE, _SPEED, _NEWTON = 100.0, 1.0, 0.1  # units of the solver


class Bound(NamedTuple):
    """Energies [N^2 s] from the start to the end of the last leg.

    plan : of the reference
    free : least, without zones; least : with the zones, a local optimum
    positions_m : (n, 3) path of that
    duration_s : of all
    """

    plan: float
    free: float
    least: float
    positions_m: Floats
    duration_s: float


def bound(settings: Guidance, scenario: Scenario) -> tuple[Checked, Bound]:
    """Return the plan, flown without errors, and its bounds; raises InputError without solver."""
    found = nominal(settings, scenario)
    over = len(found.changes) > len(settings.legs)
    last = found.changes[len(settings.legs)].tick if over else scenario.ticks
    hold = max(1, round(SEGMENT_S / scenario.dt_s))
    segments = last // hold
    states = np.array(found.references)[: segments * hold + 1 : hold]
    states[-1] = found.references[last - 1]
    if last < scenario.ticks:  # its last leg ends with a speed; the phase after it rests
        states[-1, 3:] = _arrival(settings)
    forces = np.array(found.forces)[:last]
    energy = float((forces * forces).sum()) * scenario.dt_s
    step = cw.discretise(scenario.mean_motion_rad_s, scenario.mass_kg, hold * scenario.dt_s)
    problem = _Problem(settings, scenario, cw.matrices(step), states, hold * scenario.dt_s)
    free, path = problem.solve(states, zones=False)
    least, path = problem.solve(states, zones=True)
    for _ in range(ROUNDS):
        before = least
        least, path = problem.solve(path, zones=True)
        if abs(least - before) <= 1e-4 * before:
            break
    return found, Bound(energy, free, least, path[:, :3], last * scenario.dt_s)


def _arrival(settings: Guidance) -> tuple[float, float, float]:
    leg = settings.legs[-1]
    if leg.kind != 'straight' or leg.to_m is None:
        return leg.arrive_m_s
    axis = np.array(settings.corridor.axis)
    x, y, z = (-leg.end_speed_m_s * axis / np.linalg.norm(axis)).tolist()
    return x, y, z


class _Problem:
    def __init__(
        self,
        settings: Guidance,
        scenario: Scenario,
        matrices: tuple[Floats, Floats],
        plan: Floats,
        seconds: float,
    ) -> None:
        self._settings, self._limit_n = settings, scenario.max_force_n
        unit = np.array([_METRE] * 3 + [_SPEED] * 3)
        self._unit, (a, b) = unit, matrices
        self._a, self._b = a * unit / unit[:, None], b * _NEWTON / unit[:, None]
        self._ends, self._count, self._seconds = (plan[0], plan[-1]), len(plan) - 1, seconds
        distance = np.linalg.norm(plan[:, :3], axis=1)
        inside = distance < settings.corridor.from_m
        # from where the plan stays within the range of the corridor, the cone holds
        outside = np.flatnonzero(~inside)
        self._entered = int(outside[-1]) + 1 if len(outside) else 0

    def solve(self, path: Floats, zones: bool) -> tuple[float, Floats]:
        """Return the least energy [N^2 s] and its states, linearised about a path."""
        try:
            import cvxpy as cp
        except ImportError:
            raise InputError(
                'a bound under zones needs cvxpy and clarabel: `make setup LAYERS=campaign`'
            ) from None
        x, f = cp.Variable((self._count + 1, 6)), cp.Variable((self._count, 3))
        within: list[Any] = [
            x[0] == self._ends[0] / self._unit,
            x[-1] == self._ends[1] / self._unit,
            x[1:] == x[:-1] @ self._a.T + f @ self._b.T,
            cp.abs(f) <= self._limit_n / _NEWTON,
        ]
        if zones:
            within += self._zones(cp, x, path)
        problem = cp.Problem(cp.Minimize(cp.sum_squares(f)), within)
        problem.solve(solver=cp.CLARABEL)
        if problem.status not in (cp.OPTIMAL, cp.OPTIMAL_INACCURATE):
            raise InputError(f'the solver found no bound of the plan: {problem.status}')
        energy = float(problem.value) * _NEWTON**2 * self._seconds
        return energy, np.asarray(x.value) * self._unit

    def _zones(self, cp: Any, x: Any, path: Floats) -> list[Any]:
        settings = self._settings
        position = path[:, :3]
        radius = settings.keep_out_m / _METRE
        normals = position / np.maximum(np.linalg.norm(position, axis=1), 1e-9)[:, None]
        before = slice(1, self._entered if settings.corridor.from_m else self._count)
        found: list[Any] = []
        if radius > 0.0 and before.stop > 1:
            found.append(cp.sum(cp.multiply(normals[before], x[before, :3]), axis=1) >= radius)
        if settings.corridor.from_m:
            axis = np.array(settings.corridor.axis)
            axis = axis / np.linalg.norm(axis)
            offset = x[self._entered :, :3] - np.array(settings.port_m)[None, :] / _METRE
            along = offset @ axis
            across = offset - along[:, None] @ axis[None, :]
            slope = np.tan(np.radians(settings.corridor.half_angle_deg))
            found.append(cp.norm(across, 2, axis=1) <= along * slope + 1e-6)
            gate = settings.corridor.from_m - float(np.linalg.norm(settings.port_m))
            found.append(along[0] >= gate / _METRE)  # it enters at the mouth
        return found


def rows(found: Checked, scenario: Scenario) -> list[tuple[str, ...]]:
    """Return a row of text for each phase: name, times, energy, least range, largest force, why."""
    ends = [*(change.tick for change in found.changes[1:]), scenario.ticks + 1]
    table: list[tuple[str, ...]] = []
    for change, end in zip(found.changes, ends, strict=True):
        states = np.array(found.references[change.tick : end])
        forces = np.array(found.forces[change.tick : end])
        numbers = (
            f'{change.tick * scenario.dt_s:.1f}',
            f'{(end - 1) * scenario.dt_s:.1f}',
            f'{float((forces * forces).sum()) * scenario.dt_s:.4f}',
            f'{float(np.linalg.norm(states[:, :3], axis=1).min()):.2f}',
            f'{float(np.abs(forces).max()):.3f}',
        )
        table.append((change.phase, *numbers, change.reason))
    return table
