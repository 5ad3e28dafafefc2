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

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.kernels.arithmetic import State, Vector, norm
from rpo_core.kernels.jit import COMPILED, as_table, kernel
from rpo_core.world.cw import CwStep, cw_step
from rpo_core.world.zones import along_and_across, beside_m

_left: ContextVar[list[float] | None] = ContextVar('left', default=None)


class TooMuch(Exception):
    """More work was asked for than is allowed."""


@contextmanager
def bounded(steps: float) -> Iterator[None]:
    """Let what is searched inside take so many steps; raises TooMuch when it takes more."""
    token = _left.set([steps])
    try:
        yield
    finally:
        _left.reset(token)


def spend(steps: float) -> None:
    """Count steps, before they are taken; outside of `bounded` there is no bound."""
    left = _left.get()
    if left is not None:
        left[0] -= steps
        if left[0] < 0.0:
            raise TooMuch


Floats = NDArray[np.float64]

SWEEPS = 2000
SETTLED = 1e-9
"""Hildreth's sweeps end when no multiplier changes by more than this share of the largest."""


@kernel
def reach_of(step: CwStep, reach: Floats) -> None:
    """Fill reach (n, 6, 3): what a unit force [N] moves the state, i segments after its own."""
    for axis in range(3):
        state = cw_step(
            (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            (1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0, 1.0 if axis == 2 else 0.0),
            step,
        )
        for i in range(len(reach)):
            for j in range(6):
                reach[i, j, axis] = state[j]
            state = cw_step(state, (0.0, 0.0, 0.0), step)


@kernel
def path_of(start: State, forces: Floats, step: CwStep, states: Floats) -> None:
    """Fill the states (n + 1, 6) of forces (n, 3), one a segment, from a start."""
    state = start
    for j in range(6):
        states[0, j] = state[j]
    for k in range(len(forces)):
        state = cw_step(state, (forces[k, 0], forces[k, 1], forces[k, 2]), step)
        for j in range(6):
            states[k + 1, j] = state[j]


@kernel
def sample(states: Any, forces: Any, hold: int, step: CwStep, first: int, rows: Floats) -> None:
    """Fill rows (n, 9), a tick each, with states and forces of a transfer, from a tick of it on.

    hold : ticks of a segment; step : of a tick
    """
    state = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for tick in range(first - first % hold, first + len(rows)):
        k = tick // hold
        f = forces[k]
        force = (f[0], f[1], f[2])
        if tick % hold == 0:
            s = states[k]
            state = (s[0], s[1], s[2], s[3], s[4], s[5])
        if tick >= first:
            row = rows[tick - first]
            for j in range(6):
                row[j] = state[j]
            row[6], row[7], row[8] = force
        state = cw_step(state, force, step)


@kernel
def rows_of(reach: Floats, burn: int, when: Any, normals: Floats, rows: Floats) -> None:
    """Fill rows (6 + p, n, 3): the final state, then n_j . r at the end of segment when[j].

    burn : segments with thrust at each end; none in between
    """
    count = len(reach)
    rows[:] = 0.0  # an array that is stored in a slice would take numba 3 s to compile; a sum not
    for k in range(count):
        for axis in range(3):
            for i in range(6):
                rows[i, k, axis] = reach[count - 1 - k, i, axis]
    for j in range(len(when)):
        moved, n, row = reach[: when[j]][::-1], normals[j], rows[6 + j, : when[j]]
        row += n[0] * moved[:, 0] + n[1] * moved[:, 1] + n[2] * moved[:, 2]
    if burn < count - burn:
        rows[:, burn : count - burn] = 0.0


@kernel
def _each_product(rows: Floats, products: Floats) -> None:
    for i in range(len(rows)):
        for j in range(i + 1):
            total = 0.0
            for k in range(rows.shape[1]):
                for axis in range(3):
                    total += rows[i, k, axis] * rows[j, k, axis]
            products[i, j] = total
            products[j, i] = total


def products_of(rows: Floats, products: Floats) -> None:
    """Fill products (m, m) = rows rows', summed in one order; interpreted, all of them at once."""
    if COMPILED:
        _each_product(rows, products)
        return
    products[:] = 0.0
    for column in rows.reshape(len(rows), -1).T:
        products += column[:, None] * column


@kernel
def eliminate(m: Floats) -> None:
    """Solve the first six equations of m (6 + p, 6 + p + 1) for their unknowns, in all rows.

    What is left below are the equations of the multipliers alone (Schur complement).
    """
    for i in range(6):
        for row in range(i + 1, len(m)):
            factor, rest = m[row, i] / m[i, i], m[row, i:]
            rest -= factor * m[i, i:]


@kernel
def hildreth(m: Any, multipliers: Any) -> None:
    """Find multipliers (p,) >= 0 of S mu >= h, S and h the columns of m (p, p + 1).

    Each is set by the others, sweep after sweep, until they have settled.
    """
    count = len(multipliers)
    positive = [k for k in range(count) if multipliers[k] > 0.0]
    for _ in range(SWEEPS):
        largest = change = 0.0
        for j in range(count):
            row, old = m[j], multipliers[j]
            total = row[count]
            for k in positive:
                total -= row[k] * multipliers[k]
            new = old + total / row[j]
            new = new if new > 0.0 else 0.0
            difference = abs(new - old)
            change = difference if difference > change else change
            largest = new if new > largest else largest
            multipliers[j] = new
            if (new > 0.0) != (old > 0.0):
                positive = [k for k in range(count) if multipliers[k] > 0.0]
        if change <= SETTLED * largest:
            return


@kernel
def scaled(m: Floats, wanted: Floats, scale: Floats) -> None:
    """Scale the equations m (p, p + 1) to a diagonal of 1, by factors (p,); fill their right sides.

    wanted : (p,) right sides before
    """
    size = len(m)
    for i in range(size):
        scale[i] = 1.0 / sqrt(m[i, i])
    for i in range(size):
        for j in range(size):
            m[i, j] *= scale[i] * scale[j]
        m[i, size] = wanted[i] * scale[i]


@kernel
def forces_of(rows: Floats, m: Floats, scale: Floats, solution: Floats, forces: Floats) -> None:
    """Solve the first six equations of m for their unknowns, and fill the forces (n, 3) of all.

    solution : (p,), of which the multipliers are there
    """
    size = len(m)
    for i in range(5, -1, -1):
        total = m[i, size]
        for j in range(i + 1, size):
            total -= m[i, j] * solution[j]
        solution[i] = total / m[i, i]
    forces[:] = 0.0
    for i in range(size):
        forces += solution[i] * scale[i] * rows[i]


def optimum(rows: Floats, wanted: Floats, forces: Floats) -> None:
    """Fill the forces (n, 3) of least energy: six equations, then inequalities, of rows (m, n, 3).

    wanted : (m,) right sides
    """
    size = len(rows)
    m, scale, solution = np.empty((size, size + 1)), np.empty(size), np.empty(size)
    products_of(rows, m[:, :size])
    scaled(m, wanted, scale)
    eliminate(m)
    multipliers = as_table(np.zeros(size - 6))
    hildreth(as_table(m[6:, 6:]), multipliers)
    solution[6:] = multipliers
    forces_of(rows, m, scale, solution, forces)


@kernel
def at_port(
    x: float, y: float, z: float, px: float, py: float, pz: float,
    ax: float, ay: float, az: float, past_m: float,
) -> bool:  # fmt: skip
    """Whether a position [m] has come to the port p: beyond its plane, no farther than `past_m`.

    a : unit axis, outward
    """
    dx, dy, dz = x - px, y - py, z - pz
    if dx * ax + dy * ay + dz * az > 0.0:
        return False
    return dx * dx + dy * dy + dz * dz <= past_m * past_m


@kernel
def energy(forces: Floats) -> float:
    """Sum of the squares of forces (n, 3)."""
    total = 0.0
    for k in range(len(forces)):
        for axis in range(3):
            total += forces[k, axis] * forces[k, axis]
    return total


ROUNDS = 16
"""How often the half-spaces are set anew; a path has settled after three or four."""

SLACK_M = 0.01
"""A path may lie so far outside its zones; plans have a margin for it."""

DEAR, CHEAPER = 1.5, 0.95
"""A path that costs so many times what it would without zones is planned on other sides too, and
gives way to one that costs at most such a share of it."""

PER_SEGMENT = 50
"""Steps of work (`rpo_core.guidance.transfers`) for each segment of a path, about."""

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
