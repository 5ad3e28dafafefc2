# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of transfers: forces and paths, the quadratic program of a round, samples of the path.

+ - * / and square roots in a fixed order, interpreted or compiled with the same bits.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.kernels.arithmetic import State
from rpo_core.kernels.jit import COMPILED, as_table, kernel
from rpo_core.world.cw import CwStep, cw_step

Floats = NDArray[np.float64]

SWEEPS = 2000
SETTLED = 1e-9
"""Hildreth's sweeps end when no multiplier changes by more than this share of the largest."""

AHEAD = 64
"""Sweeps at a time, interpreted."""


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
def _sweep(m: Any, multipliers: Any, positive: Any) -> tuple[bool, Any]:
    """Set each multiplier by the others; return whether they have settled, and what is positive."""
    count, largest, change = len(multipliers), 0.0, 0.0
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
    return change <= SETTLED * largest, positive


@kernel
def _each_sweep(m: Any, multipliers: Any) -> None:
    positive = [k for k in range(len(multipliers)) if multipliers[k] > 0.0]
    for _ in range(SWEEPS):
        settled, positive = _sweep(m, multipliers, positive)
        if settled:
            return


def hildreth(m: Floats, multipliers: Any) -> None:
    """Find multipliers (p,) >= 0 of S mu >= h, S and h the columns of m (p, p + 1)."""
    if COMPILED:
        _each_sweep(m, multipliers)
        return
    rows, left, settled = m.tolist(), SWEEPS, False
    positive: list[int] = []
    while left > 0 and not settled:
        before = positive
        settled, positive = _sweep(rows, multipliers, before)
        left -= 1
        sweeps = AHEAD
        while sweeps == AHEAD and positive == before and left >= AHEAD and not settled:
            settled, sweeps = _ahead(m, rows, multipliers, positive)
            left -= sweeps


def _ahead(
    m: Floats, rows: list[list[float]], multipliers: list[float], positive: list[int]
) -> tuple[bool, int]:
    """Do `_sweep` as long as the same multipliers are positive, `AHEAD` times at most.

    Only these change. That the others stay zero is seen afterwards, in all sweeps at once. Return
    whether they have settled, and the number of sweeps.
    """
    part = [[rows[j][k] for k in (*positive, -1)] for j in positive]
    values, every = [multipliers[k] for k in positive], list(range(len(positive)))
    history, settled = [values[:]], False
    while len(history) <= AHEAD and not settled:
        settled, still = _sweep(part, values, every)
        if still != every:
            settled = False
            break
        history.append(values[:])
    found, zero = np.array(history), np.setdiff1d(np.arange(len(m)), positive)
    totals = np.tile(m[zero, -1], (len(found) - 1, 1))
    for i, k in enumerate(positive):
        totals -= m[zero, k] * np.where(k < zero, found[1:, i : i + 1], found[:-1, i : i + 1])
    moved = np.flatnonzero((totals / m[zero, zero] > 0.0).any(axis=1))
    sweeps = int(moved[0]) if moved.size else len(found) - 1
    for k, value in zip(positive, history[sweeps], strict=True):
        multipliers[k] = value
    return settled and not moved.size, sweeps


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
    hildreth(np.ascontiguousarray(m[6:, 6:]), multipliers)
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
