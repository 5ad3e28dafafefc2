# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Transfers of least energy around a keep-out sphere, and in by a corridor.

The forces of a transfer are held for segments of equal length. The final state is linear in them,
so without a sphere the optimum is closed form: the least-norm solution of six equations, by the
Gramian. A path near the sphere gets half-spaces, n_j . r(t_j) >= R, tangent to it where the path
before came closest: a quadratic program with one multiplier for each. Its dual is solved by
Hildreth's method (Hildreth 1957, A quadratic programming procedure). This is repeated with the
normals of the new path, until it stays outside. In the corridor, a cone, the half-spaces are the
planes that touch the cone beside the path. Each optimum is found in a fixed order of
+ - * / and square roots: the same bits on every machine.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

import numpy as np

from rpo_core.guidance.transfer_kernels import Floats, energy, optimum, path_of, reach_of, rows_of
from rpo_core.guidance.work import spend
from rpo_core.kernels.arithmetic import State, Vector, norm
from rpo_core.world.cw import CwStep
from rpo_core.world.zones import along_and_across, beside_m

ROUNDS = 16
"""How often the half-spaces are set anew; a path has settled after three or four."""

SLACK_M = 0.01
"""A path may lie so far outside its zones; plans have a margin for it."""

DEAR, CHEAPER = 1.5, 0.95
"""A path that costs so many times what it would without zones is planned on other sides too, and
gives way to one that costs at most such a share of it."""

PER_SEGMENT = 50
"""Steps of work (`rpo_core.guidance.work`) for each segment of a path, about."""

MOST_PLANNED = 64
"""Transfers that are remembered."""

NEAR = 1.6
"""A point of the path gets a half-space if it is nearer than this many radii."""


class Transfer(NamedTuple):
    """A transfer as it was planned.

    states : (n + 1, 6) [m, m/s] at the ends of the segments
    forces : (n, 3) [N] held for each
    violated_m : largest distance by which it lies outside its zones at the ends of the segments
    """

    states: Floats
    forces: Floats
    violated_m: float


def _side(states: Floats, distances: list[float]) -> Vector:
    """Return the unit vector to the side on which a straight path shall pass the target.

    Across the path at its nearest point, on the side where that point lies; for a path through
    the centre, downward (-x) or, for one along R-bar, out of plane.
    """
    nearest = distances.index(min(distances))
    x, y, z, vx, vy, vz = states[nearest].tolist()
    speed = norm(vx, vy, vz) or 1.0
    ahead = (vx / speed, vy / speed, vz / speed)
    for candidate in ((x, y, z), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)):
        along = sum(c * a for c, a in zip(candidate, ahead, strict=True))
        across = [c - along * a for c, a in zip(candidate, ahead, strict=True)]
        size = norm(*across)
        if size > 0.1:  # of the last, where those before are not
            break
    return across[0] / size, across[1] / size, across[2] / size


class Limits(NamedTuple):
    """Where the path may be.

    radius_m : of the sphere about the target that it keeps out of; 0: none
    corridor : number of segments after which it must be inside the cone; None: no cone
    ports : tip of the cone and unit vector outward, at the end of each segment where they turn
    slope : tangent of its half angle
    gate_m : distance from the port where it enters, at least
    """

    radius_m: float = 0.0
    corridor: int | None = None
    ports: tuple[tuple[float, ...], ...] = ((0.0, 0.0, 0.0, 0.0, 1.0, 0.0),)
    slope: float = 0.0
    gate_m: float = 0.0

    def port(self, segment: int) -> tuple[Vector, Vector]:
        """Return tip and axis of the cone at the end of a segment."""
        px, py, pz, ax, ay, az = self.ports[min(segment, len(self.ports) - 1)]
        return (px, py, pz), (ax, ay, az)

    def in_cone(self, segment: int) -> bool:
        """Return whether the end of a segment must lie inside the cone."""
        return self.corridor is not None and segment >= self.corridor

    def violated_m(self, states: Floats, distances: list[float]) -> float:
        """Return the largest distance [m] by which a path lies outside its zones, within SLACK."""
        worst = 0.0
        for j in range(1, len(states) - 1):
            if not self.in_cone(j):
                worst = max(worst, self.radius_m - distances[j])
                continue
            along, across = along_and_across(tuple(states[j, :3].tolist()), *self.port(j))
            worst = max(worst, beside_m(along, norm(*across), 0.0, self.slope))
            if j == self.corridor:
                worst = max(worst, self.gate_m - along)
        return worst


ANYWHERE = Limits()


_planned: dict[str, tuple[Transfer, float]] = {}
"""Transfers found in this process, and the steps that each took: a plan is checked, then flown."""


class _HalfSpace(NamedTuple):
    """A half-space normal . r >= least about a path, at the end of segment `when`."""

    when: int
    normal: Vector
    least: float


def _outside_sphere(
    states: Floats, distances: list[float], zones: Limits, side: Vector | None
) -> list[_HalfSpace]:
    """Return the half-spaces that keep a path out of the sphere.

    side : of the first round: straight through the sphere, the path is lifted to this side
    """
    found, radius = [], zones.radius_m
    for j in range(1, len(states) - 1):
        x, y, z = states[j, :3].tolist()
        if zones.in_cone(j):
            break
        if side is None:
            if distances[j] < NEAR * radius:
                away = x / distances[j], y / distances[j], z / distances[j]
                found.append(_HalfSpace(j, away, radius))
        else:
            up = x * side[0] + y * side[1] + z * side[2]
            ahead = distances[j] * distances[j] - up * up
            if ahead < radius * radius:
                found.append(_HalfSpace(j, side, sqrt(radius * radius - ahead)))
    return found


def _touch_cone(planes: list[_HalfSpace], states: Floats, zones: Limits) -> None:
    """Add the planes that touch the cone beside the points of a path outside it.

    The cone is convex: a plane that touches it is right for every path.
    """
    for j in range(1, len(states) - 1):
        if not zones.in_cone(j):
            continue
        port, axis = zones.port(j)
        (px, py, pz), (ax, ay, az) = port, axis
        if j == zones.corridor and not planes:
            least = ax * px + ay * py + az * pz + zones.gate_m
            planes.append(_HalfSpace(j, axis, least))
        along, (cx, cy, cz) = along_and_across(tuple(states[j, :3].tolist()), port, axis)
        size, t = norm(cx, cy, cz), zones.slope
        if size > t * along:
            normal = (t * ax - cx / size, t * ay - cy / size, t * az - cz / size)
            least = normal[0] * px + normal[1] * py + normal[2] * pz
            planes.append(_HalfSpace(j, normal, least))


class _Problem:
    """A transfer to be planned: what each round of it shares.

    free : the transfer of least energy without zones
    """

    def __init__(
        self,
        start: State,
        end: State,
        step: CwStep,
        segments: int,
        zones: Limits,
        burn: int | None,
        ease: int,
    ) -> None:
        self.steps = 0.0
        self._spend(PER_SEGMENT * segments)
        self._start, self._step, self._zones = start, step, zones
        self._root = _eased(segments, ease) if ease else None
        self._reach, self._drift = np.empty((segments, 6, 3)), np.empty((segments + 1, 6))
        self._burn = segments if burn is None else burn
        reach_of(step, self._reach)
        path_of(start, np.zeros((segments, 3)), step, self._drift)
        self._missing = [e - d for e, d in zip(end, self._drift[-1].tolist(), strict=True)]
        self.free = self._optimum([])

    def _spend(self, steps: float) -> None:
        """Count steps, before they are taken; raises TooMuch."""
        spend(steps)
        self.steps += steps

    def _optimum(self, bounds: list[_HalfSpace]) -> Transfer:
        """Return the transfer of least energy within half-spaces."""
        segments = len(self._reach)
        self._spend((6 + len(bounds)) ** 2 * (3 * segments + PER_SEGMENT))
        when = np.array([bound.when for bound in bounds], dtype=np.int64)
        normals = np.array([bound.normal for bound in bounds]).reshape(-1, 3)
        rows = np.empty((6 + len(when), segments, 3))
        rows_of(self._reach, self._burn, when, normals, rows)
        if self._root is not None:
            rows *= self._root
        room = [
            least - (n[0] * x + n[1] * y + n[2] * z)
            for (_, n, least), (x, y, z) in zip(bounds, self._drift[when, :3].tolist(), strict=True)
        ]
        forces, states = np.empty((segments, 3)), np.empty((segments + 1, 6))
        optimum(rows, np.array([*self._missing, *room]), forces)
        if self._root is not None:
            forces *= self._root
        path_of(self._start, forces, self._step, states)
        return Transfer(states, forces, self._zones.violated_m(states, _distances(states)))

    def around(self, side: Vector | None) -> Transfer:
        """Return the transfer that passes the sphere on a side; None: where the free one does."""
        planes: list[_HalfSpace] = []
        best = found = self.free
        for attempt in range(1, ROUNDS):
            if found.violated_m <= SLACK_M:
                break
            distances = _distances(found.states)
            lifted = None
            if attempt == 1:
                lifted = _side(found.states, distances) if side is None else side
            _touch_cone(planes, found.states, self._zones)
            sphere = _outside_sphere(found.states, distances, self._zones, lifted)
            found = self._optimum([*sphere, *planes])
            best = found if found.violated_m < best.violated_m else best
        return best


def _eased(segments: int, ease: int) -> Floats:
    """Return the roots (n, 1) of shares that fall evenly to zero over the last segments.

    The least sum of |f_k|^2 / share_k is that of |g_k|^2 with f_k = root_k g_k.
    """
    left = segments - 0.5 - np.arange(segments)
    return np.sqrt(np.minimum(1.0, left / ease))[:, None]


def _distances(states: Floats) -> list[float]:
    """Return the range [m] of each state."""
    return [norm(x, y, z) for x, y, z in states[:, :3].tolist()]


def least_energy(
    start: State,
    end: State,
    step: CwStep,
    segments: int,
    zones: Limits = ANYWHERE,
    burn: int | None = None,
    ease: int = 0,
) -> Transfer:
    """Return the transfer of least energy from a state to a state (6,) [m, m/s].

    step : of one segment
    zones : that the path keeps to, as far as it can: `violated_m` says how far it does not
    burn : segments with thrust at each end, none in between; None: thrust throughout
    ease : segments over which the force falls to zero at the end: force is dearer there

    Half-spaces end at a local optimum. If that is dear, the path is planned again over both sides
    of the orbital plane, and the cheapest is taken.
    """
    key = repr((start, end, step, segments, zones, burn, ease))  # 0.0 is not -0.0
    known = _planned.get(key)
    if known is not None:
        spend(known[1])
        return known[0]
    problem = _Problem(start, end, step, segments, zones, burn, ease)
    best = _best_side(problem)
    if len(_planned) >= MOST_PLANNED:
        _planned.clear()
    _planned[key] = best, problem.steps
    return best


def _best_side(problem: _Problem) -> Transfer:
    best = problem.around(None)
    if energy(best.forces) <= DEAR * energy(problem.free.forces):
        return best
    for side in ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0)):
        found = problem.around(side)
        cheaper = energy(found.forces) < CHEAPER * energy(best.forces)
        if cheaper and found.violated_m <= max(best.violated_m, SLACK_M):
            best = found
    return best
