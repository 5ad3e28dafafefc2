# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Control laws as scalar kernels: gain tables, a potential field with sliding mode, a force table.

Plain functions of floats like `rpo_core.kernels`: the same bits interpreted and compiled. Every law
is odd bit for bit: the force of the mirrored state is the mirrored force.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.kernels.arithmetic import State, Vector, saturate
from rpo_core.kernels.jit import as_table, inlined, kernel

GAINS = 18
"""Numbers in a row of a gain table: K (3, 6) row by row, forces from (x, y, z, vx, vy, vz)."""


class BaselineLaw(NamedTuple):
    """A law as the kernels read it; tables by `rpo_core.kernels.jit.as_table`, empty if not used.

    gains : (rows, 18) f = -K x [N/m, N s/m]; row k is that of tick k, the last one stays
    field : the 6 numbers of `sliding_force`
    limit : largest |f| of an axis [N]
    distances, speeds, forces : of `table_force`
    """

    gains: Any
    field: Any
    limit: float
    distances: Any
    speeds: Any
    forces: Any


def law_of(
    limit: float,
    *,
    gains: Any = (),
    field: Any = (),
    table: tuple[Any, Any, Any] = ((), (), ()),
) -> BaselineLaw:
    """Return a law of one kind: gains, or a field, or the table of `table_force`."""
    rows = np.asarray(gains, dtype=np.float64).reshape(-1, GAINS)
    distances, speeds, forces = (as_table(np.ravel(part)) for part in table)
    return BaselineLaw(as_table(rows), as_table(field), limit, distances, speeds, forces)


@kernel
def gain_force(state: State, g: Any) -> Vector:
    """Force [N] of linear state feedback, f = -K x, g = K (3, 6) row by row."""
    x, y, z, vx, vy, vz = state
    return (
        -(g[0] * x + g[1] * y + g[2] * z + g[3] * vx + g[4] * vy + g[5] * vz),
        -(g[6] * x + g[7] * y + g[8] * z + g[9] * vx + g[10] * vy + g[11] * vz),
        -(g[12] * x + g[13] * y + g[14] * z + g[15] * vx + g[16] * vy + g[17] * vz),
    )


@kernel
def sliding_surface(state: State, speed: float, radius: float) -> Vector:
    """Sliding variable s = v + grad phi [m/s], phi = speed * sqrt(|r|^2 + radius^2).

    The potential is a cone of slope `speed` [m/s] with its tip rounded within `radius` [m]. On the
    surface s = 0 the chaser flies down its gradient.
    """
    x, y, z, vx, vy, vz = state
    slope = speed / sqrt(x * x + y * y + z * z + radius * radius)
    return vx + slope * x, vy + slope * y, vz + slope * z


@kernel
def sliding_force(state: State, field: Any) -> Vector:
    """Force [N] that brings the state to the sliding surface and keeps it there.

    f = m (-d/dt grad phi - a_cw) - gain * sat(s / layer): the equivalent control of the nominal
    relative dynamics a_cw, and a switching term with a boundary layer.

    field : approach speed [m/s], rounding radius [m], switching gain [N], boundary layer [m/s],
        mass [kg], mean motion [rad/s]
    """
    speed, radius, gain, layer, mass, n = field[0], field[1], field[2], field[3], field[4], field[5]
    x, y, z, vx, vy, vz = state
    sx, sy, sz = sliding_surface(state, speed, radius)
    square = x * x + y * y + z * z + radius * radius
    slope = speed / sqrt(square)
    closing = (x * vx + y * vy + z * vz) / square
    ax, ay, az = 3.0 * n * n * x + 2.0 * n * vy, -(2.0 * n * vx), -(n * n * z)
    return (
        -(mass * (slope * (vx - closing * x) + ax)) - gain * saturate(sx / layer, 1.0),
        -(mass * (slope * (vy - closing * y) + ay)) - gain * saturate(sy / layer, 1.0),
        -(mass * (slope * (vz - closing * z) + az)) - gain * saturate(sz / layer, 1.0),
    )


@kernel
def interval(x: float, knots: Any) -> tuple[int, float]:
    """Return the interval of ascending knots that x lies in, and its share of it, in [0, 1].

    Beyond the first or the last knot, x counts as the knot.
    """
    last = len(knots) - 1
    if x <= knots[0]:
        return 0, 0.0
    if x >= knots[last]:
        return last - 1, 1.0
    i = 0
    while x >= knots[i + 1]:
        i += 1
    return i, (x - knots[i]) / (knots[i + 1] - knots[i])


@inlined
def table_inputs(r: float, v: float) -> tuple[float, float]:
    """Distance [m] and closing speed [m/s] of an axis at position r [m] and velocity v [m/s]."""
    return abs(r), -v if r >= 0.0 else v


@kernel
def table_force(r: float, v: float, distances: Any, speeds: Any, forces: Any) -> float:
    """Force [N] of an axis by a zero-order Takagi-Sugeno system of its distance and closing speed.

    Triangles with peaks at `distances` [m] and `speeds` [m/s] partition both inputs; AND is the
    product, the consequents are forces towards the target. So the force is bilinear between the
    peaks. The table begins with a distance of 0.

    forces : (distances * speeds,) [N], row by row; the first row is odd in the speed, which makes
        the force of the mirrored state the mirrored force, also where r = 0
    """
    distance, speed = table_inputs(r, v)
    i, far = interval(distance, distances)
    j, fast = interval(speed, speeds)
    n = len(speeds)
    near = (1.0 - fast) * forces[n * i + j] + fast * forces[n * i + j + 1]
    beyond = (1.0 - fast) * forces[n * (i + 1) + j] + fast * forces[n * (i + 1) + j + 1]
    pull = (1.0 - far) * near + far * beyond
    return -pull if r >= 0.0 else pull


@kernel
def baseline_force(state: State, tick: int, law: BaselineLaw) -> Vector:
    """Force [N] of a law at a tick, saturated."""
    if len(law.field) > 0:
        fx, fy, fz = sliding_force(state, law.field)
    elif len(law.forces) > 0:
        d, u, f = law.distances, law.speeds, law.forces
        fx = table_force(state[0], state[3], d, u, f)
        fy = table_force(state[1], state[4], d, u, f)
        fz = table_force(state[2], state[5], d, u, f)
    else:
        last = len(law.gains) - 1
        fx, fy, fz = gain_force(state, law.gains[tick if tick < last else last])
    return saturate(fx, law.limit), saturate(fy, law.limit), saturate(fz, law.limit)


@kernel
def solve_in_place(m: NDArray[np.float64]) -> None:
    """Solve m[:, :6] X = m[:, 6:] for a positive definite matrix; X is left in m[:, 6:].

    Gauss-Jordan without pivoting, in a fixed order: no BLAS, so the same bits on every machine.
    """
    columns = m.shape[1]
    for i in range(6):
        inverse = 1.0 / m[i, i]
        for column in range(i, columns):
            m[i, column] *= inverse
        for row in range(6):
            if row != i:
                factor = m[row, i]
                if factor != 0.0:
                    for column in range(i, columns):
                        m[row, column] -= factor * m[i, column]


@kernel
def multiply(a: NDArray[np.float64], b: NDArray[np.float64], product: NDArray[np.float64]) -> None:
    """Fill product = a b, each entry summed in one order."""
    for i in range(a.shape[0]):
        for k in range(b.shape[1]):
            total = 0.0
            for j in range(a.shape[1]):
                total += a[i, j] * b[j, k]
            product[i, k] = total


@kernel
def least_energy_gains(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    scale: NDArray[np.float64],
    least: int,
    gains: NDArray[np.float64],
) -> None:
    """Fill gains (rows, 3, 6) of the least-energy transfer to rest in `rows - 1 + least` ticks.

    With T ticks to go, P = A^(T-1) and the Gramian W = sum over j < T of A^j B B' A'^j, the first
    force of the least-energy plan from x to rest is -B' P' W^-1 P A x. Row k is for T = rows - 1 -
    k + least; the states are scaled by `scale` (6,) for the solution.

    a, b : (6, 6), (6, 3), of x+ = A x + B f
    """
    rows = len(gains)
    power, reach, product = np.zeros((6, 6)), np.empty((6, 3)), np.empty((6, 6))
    gramian, m = np.zeros((6, 6)), np.empty((6, 12))
    for i in range(6):
        power[i, i] = 1.0
    for to_go in range(1, rows - 1 + least + 1):
        multiply(power, b, reach)
        multiply(power, a, product)
        for i in range(6):
            for j in range(3):
                reach[i, j] /= scale[i]
        for i in range(6):
            for k in range(6):
                for j in range(3):
                    gramian[i, k] += reach[i, j] * reach[k, j]
                m[i, k], m[i, 6 + k] = gramian[i, k], product[i, k] / scale[i]
                power[i, k] = product[i, k]
        if to_go >= least:
            solve_in_place(m)
            multiply(reach.T, m[:, 6:], gains[rows - 1 - (to_go - least)])
