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
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.jit import kernel
from rpo_core.kernels import CwStep, State, Vector, cw_step
from rpo_core.metrics import norm

Floats = NDArray[np.float64]

ROUNDS = 16
"""How often the half-spaces are set anew; a path has settled after three or four."""

SWEEPS = 2000
SETTLED = 1e-9
"""Hildreth's sweeps end when no multiplier changes by more than this share of the largest."""

SLACK_M = 0.01
"""A path may lie so far outside its zones; plans have a margin for it."""

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
def sample(states: Floats, forces: Floats, hold: int, step: CwStep, rows: Floats) -> None:
    """Fill rows (n, 9), a tick each, with the states and forces of a transfer from its begin on.

    hold : ticks of a segment; step : of a tick
    """
    state = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for tick in range(len(rows)):
        k, row = tick // hold, rows[tick]
        force = (forces[k, 0], forces[k, 1], forces[k, 2])
        if tick % hold == 0:
            s = states[k]
            state = (s[0], s[1], s[2], s[3], s[4], s[5])
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
    rows[:] = 0.0
    for k in range(count):
        if burn <= k < count - burn:
            continue
        for axis in range(3):
            for i in range(6):
                rows[i, k, axis] = reach[count - 1 - k, i, axis]
            for j in range(len(when)):
                total = 0.0
                if k < when[j]:
                    for i in range(3):
                        total += normals[j, i] * reach[when[j] - 1 - k, i, axis]
                rows[6 + j, k, axis] = total


@kernel
def products_of(rows: Floats, products: Floats) -> None:
    """Fill products (m, m) = rows rows', summed in one order."""
    for i in range(len(rows)):
        for j in range(i + 1):
            total = 0.0
            for k in range(rows.shape[1]):
                for axis in range(3):
                    total += rows[i, k, axis] * rows[j, k, axis]
            products[i, j] = total
            products[j, i] = total


@kernel
def eliminate(m: Floats) -> None:
    """Solve the first six equations of m (6 + p, 6 + p + 1) for their unknowns, in all rows.

    What is left below are the equations of the multipliers alone (Schur complement).
    """
    for i in range(6):
        for row in range(i + 1, len(m)):
            factor = m[row, i] / m[i, i]
            for column in range(i, m.shape[1]):
                m[row, column] -= factor * m[i, column]


@kernel
def hildreth(m: Floats, multipliers: Floats) -> None:
    """Find multipliers (p,) >= 0 of S mu >= h, S and h the lower right of m (6 + p, 6 + p + 1)."""
    count = len(multipliers)
    for _ in range(SWEEPS):
        largest, change = 0.0, 0.0
        for j in range(count):
            total = m[6 + j, 6 + count]
            for k in range(count):
                total -= m[6 + j, 6 + k] * multipliers[k]
            new = multipliers[j] + total / m[6 + j, 6 + j]
            new = new if new > 0.0 else 0.0
            difference = abs(new - multipliers[j])
            change = difference if difference > change else change
            largest = new if new > largest else largest
            multipliers[j] = new
        if change <= SETTLED * largest:
            return


@kernel
def optimum(rows: Floats, wanted: Floats, forces: Floats) -> None:
    """Fill the forces (n, 3) of least energy: six equations, then inequalities, of rows (m, n, 3).

    wanted : (m,) right sides
    """
    size = len(rows)
    count = size - 6
    m = np.empty((size, size + 1))
    products_of(rows, m[:, :size])
    scale = np.empty(size)
    for i in range(size):
        scale[i] = 1.0 / sqrt(m[i, i])
    for i in range(size):
        for j in range(size):
            m[i, j] *= scale[i] * scale[j]
        m[i, size] = wanted[i] * scale[i]
    eliminate(m)
    multipliers = np.zeros(count)
    hildreth(m, multipliers)
    solution = np.empty(size)
    for j in range(count):
        solution[6 + j] = multipliers[j]
    for i in range(5, -1, -1):
        total = m[i, size]
        for j in range(i + 1, size):
            total -= m[i, j] * solution[j]
        solution[i] = total / m[i, i]
    for k in range(len(forces)):
        for axis in range(3):
            total = 0.0
            for i in range(size):
                total += solution[i] * scale[i] * rows[i, k, axis]
            forces[k, axis] = total


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
        if size > 0.1:
            return across[0] / size, across[1] / size, across[2] / size
    return 0.0, 0.0, 1.0


def along_and_across(position: Vector, port_m: Vector, axis: Vector) -> tuple[float, Vector]:
    """Return how far [m] a point lies along an axis from a port, and its vector (3,) [m] across."""
    offset = [r - p for r, p in zip(position, port_m, strict=True)]
    along = offset[0] * axis[0] + offset[1] * axis[1] + offset[2] * axis[2]
    x, y, z = (o - along * a for o, a in zip(offset, axis, strict=True))
    return along, (x, y, z)


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


class Zones(NamedTuple):
    """Where the path may be.

    radius_m : of the sphere about the target that it keeps out of; 0: none
    corridor : number of segments after which it must be inside the cone; None: no cone
    port_m, axis : tip of the cone, unit vector outward
    slope : tangent of its half angle
    gate_m : distance from the port where it enters, at least
    """

    radius_m: float = 0.0
    corridor: int | None = None
    port_m: Vector = (0.0, 0.0, 0.0)
    axis: Vector = (0.0, 1.0, 0.0)
    slope: float = 0.0
    gate_m: float = 0.0

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
            along, across = along_and_across(tuple(states[j, :3].tolist()), self.port_m, self.axis)
            worst = max(worst, norm(*across) - self.slope * along)
            if j == self.corridor:
                worst = max(worst, self.gate_m - along)
        return worst


ANYWHERE = Zones()


class _HalfSpaces:
    """Half-spaces n_j . r(t_j) >= b_j about a path."""

    def __init__(self) -> None:
        self.when: list[int] = []
        self.normals: list[Vector] = []
        self.least: list[float] = []

    def add(self, when: int, normal: Vector, least: float) -> None:
        """Take one, at the end of a segment."""
        self.when.append(when)
        self.normals.append(normal)
        self.least.append(least)


def _outside_sphere(
    states: Floats, distances: list[float], zones: Zones, side: Vector | None
) -> _HalfSpaces:
    """Return the half-spaces that keep a path out of the sphere.

    side : of the first round: straight through the sphere, the path is lifted to this side
    """
    found, radius = _HalfSpaces(), zones.radius_m
    for j in range(1, len(states) - 1):
        x, y, z = states[j, :3].tolist()
        if zones.in_cone(j):
            break
        if side is None:
            if distances[j] < NEAR * radius:
                found.add(j, (x / distances[j], y / distances[j], z / distances[j]), radius)
        else:
            up = x * side[0] + y * side[1] + z * side[2]
            ahead = distances[j] * distances[j] - up * up
            if ahead < radius * radius:
                found.add(j, side, sqrt(radius * radius - ahead))
    return found


def _touch_cone(planes: _HalfSpaces, states: Floats, zones: Zones) -> None:
    """Add the planes that touch the cone beside the points of a path outside it.

    The cone is convex: a plane that touches it is right for every path.
    """
    ax, ay, az = zones.axis
    px, py, pz = zones.port_m
    for j in range(1, len(states) - 1):
        if not zones.in_cone(j):
            continue
        if j == zones.corridor and not planes.when:
            planes.add(j, zones.axis, ax * px + ay * py + az * pz + zones.gate_m)
        along, (cx, cy, cz) = along_and_across(
            tuple(states[j, :3].tolist()), zones.port_m, zones.axis
        )
        size, t = norm(cx, cy, cz), zones.slope
        if size > t * along:
            normal = (t * ax - cx / size, t * ay - cy / size, t * az - cz / size)
            planes.add(j, normal, normal[0] * px + normal[1] * py + normal[2] * pz)


def least_energy(
    start: State,
    end: State,
    step: CwStep,
    segments: int,
    zones: Zones = ANYWHERE,
    burn: int | None = None,
) -> Transfer:
    """Return the transfer of least energy from a state to a state (6,) [m, m/s].

    step : of one segment
    zones : that the path keeps to, as far as it can: `violated_m` says how far it does not
    burn : segments with thrust at each end, none in between; None: thrust throughout
    """
    reach, drift = np.empty((segments, 6, 3)), np.empty((segments + 1, 6))
    reach_of(step, reach)
    path_of(start, np.zeros((segments, 3)), step, drift)
    forces, states = np.empty((segments, 3)), np.empty((segments + 1, 6))
    missing = [e - d for e, d in zip(end, drift[-1].tolist(), strict=True)]
    bounds, planes, best = _HalfSpaces(), _HalfSpaces(), None
    for attempt in range(ROUNDS):
        when = np.array(bounds.when, dtype=np.int64)
        normals = np.array(bounds.normals).reshape(-1, 3)
        rows = np.empty((6 + len(when), segments, 3))
        rows_of(reach, segments if burn is None else burn, when, normals, rows)
        room = [
            b - (n[0] * x + n[1] * y + n[2] * z)
            for b, n, (x, y, z) in zip(
                bounds.least, bounds.normals, drift[when, :3].tolist(), strict=True
            )
        ]
        optimum(rows, np.array([*missing, *room]), forces)
        path_of(start, forces, step, states)
        distances = [norm(x, y, z) for x, y, z in states[:, :3].tolist()]
        violated = zones.violated_m(states, distances)
        if best is None or violated < best.violated_m:
            best = Transfer(states.copy(), forces.copy(), violated)
        if violated <= SLACK_M:
            break
        side = _side(states, distances) if attempt == 0 else None
        _touch_cone(planes, states, zones)
        bounds = _outside_sphere(states, distances, zones, side)
        for when_j, normal, least in zip(planes.when, planes.normals, planes.least, strict=True):
            bounds.add(when_j, normal, least)
    return best  # type: ignore[return-value]  # ROUNDS > 0
