# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Which thrusters of a table fire: the inner loop.

Kernels of + - * / and comparisons (`kernels.jit`), the same bits everywhere. The allocation is
a linear programme: thrusts between zero and the largest, the wanted force exactly, then as near to
the wanted torque as possible, then as little propellant. It is solved by a dual simplex method
along the demand: from no force to the whole of it, or to as much of it as there is. The start is
one of the bases that were computed before (`Table.bases`), most often that of the optimum. Nothing
is remembered from call to call. Tables are flat: rows of six numbers, force then torque.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from rpo_core.kernels.arithmetic import Vector, pick
from rpo_core.kernels.jit import inlined, step_kernel
from rpo_core.thrusters.pulse_kernels import ON, Spent, Tank, spend

MOST_THRUSTERS = 24

ROWS = 6
"""Force x, y, z [N], and torque x, y, z over the lever [N]."""

BASIS, VALUE, RATE, DUAL, INVERSE = 0, 6, 12, 18, 24
"""Places in the scratch: variables of the basis, their values, their change along the demand, the
price of each row, the inverse of the basis, row by row."""
FULL = INVERSE + ROWS * ROWS
"""Place of 1 for each thruster that is held at its largest thrust."""
LIMIT = FULL + MOST_THRUSTERS
"""Place of the largest thrust of each thruster now [N]."""
THRUST = LIMIT + MOST_THRUSTERS
"""Place of the thrust of each thruster [N]."""
AIM = THRUST + MOST_THRUSTERS
"""Place of what is added to the force and torque that thrusters give."""
SCRATCH = AIM + ROWS

START = 2 * ROWS + ROWS * ROWS
"""Numbers of a basis that was computed before: price of each row, variables, inverse."""

LARGEST = 1e300
_MOST_PIVOTS = 100
_LEAST_PIVOT, _LEAST_RATE = 1e-10, 1e-13
"""Shares of the largest number of the inverse, the rate also of the demand; less is rounding."""


class Table(NamedTuple):
    """Thrusters as the kernels read them.

    Variables of the programme: thrusts 0 to number - 1 [N]; then for each axis of torque the torque
    that is left over to the one and to the other side; then for each row one that must stay zero.

    number, carries, dt : of thrusters; 1 where what is left of an impulse goes to the next tick;
        length of a tick [s]
    bound : largest |force| of an axis that is carried [N]
    penalty : cost of a newton of torque over the lever; LARGEST: none may be left over
    lever : length that makes torques forces [m]
    columns : (number, 6) force and torque over the lever for one newton, as the allocation knows it
    most, cost : (number,) largest thrust [N]; cost of a newton
    burns : (number,) propellant of a newton, relative to that of the tank
    bits : (number,) least impulse of a tick [N s]
    acts : (number, 6) force [N], torque [N m] that act for one newton, with errors
    bases : (n, START) to start from; the first is that of no force
    """

    number: int
    carries: int
    dt: float
    bound: float
    penalty: float
    lever: float
    columns: list[float]
    most: list[float]
    cost: list[float]
    burns: list[float]
    bits: list[float]
    acts: list[float]
    bases: list[float]


@step_kernel
def dearest(wanted: Any, t: Table) -> float:
    """Which basis to start from: the one whose price of the demand is highest, a lower bound."""
    best = most = 0.0
    for k in range(len(t.bases) // START):
        at = START * k
        price = t.bases[at] * wanted[0] + t.bases[at + 1] * wanted[1] + t.bases[at + 2] * wanted[2]
        price += t.bases[at + 3] * wanted[3]
        price += t.bases[at + 4] * wanted[4]
        price += t.bases[at + 5] * wanted[5]
        higher = price > most
        best, most = pick(higher, k, best), pick(higher, price, most)
    return best


@step_kernel
def start(basis: int, t: Table, w: Any) -> None:
    """Fill the scratch with a basis to start from."""
    at = START * basis
    for i in range(ROWS):
        w[DUAL + i] = t.bases[at + i]
        w[BASIS + i] = t.bases[at + ROWS + i]
        w[VALUE + i] = 0.0
    for i in range(ROWS * ROWS):
        w[INVERSE + i] = t.bases[at + 2 * ROWS + i]
    for i in range(t.number):
        w[FULL + i] = 0.0


@step_kernel
def along(column: int, row: int, t: Table, w: Any) -> float:
    """Row of the inverse (-1: the prices) times the column of a variable."""
    at = DUAL if row < 0 else INVERSE + ROWS * row
    if column < t.number:
        total = 0.0
        for i in range(ROWS):
            total += w[at + i] * t.columns[ROWS * column + i]
        return total
    torque = column - t.number
    return w[at + 3 + torque // 2] if torque % 2 == 0 else -w[at + 3 + torque // 2]


@step_kernel
def entering(row: int, down: bool, smallest: float, t: Table, w: Any) -> tuple[int, float]:
    """Variable that takes the place of the one in a row, and the change of that row's price.

    down : whether the one in the row would fall below zero; else it would exceed its largest value
    smallest : pivot that is no rounding

    Of all that push it back, the one whose reduced cost is the first to become zero; -1: none.
    """
    chosen, least, change = -1, LARGEST, 0.0
    variables = t.number + (ROWS if t.penalty < LARGEST else 0)
    for j in range(variables):
        thruster = j < t.number
        if thruster and w[LIMIT + j] <= 0.0:
            continue
        pivot = along(j, row, t, w)
        full = thruster and w[FULL + j] > 0.0
        if abs(pivot) < smallest or (pivot < 0.0) == (down == full):
            continue
        reduced = (t.cost[j] if thruster else t.penalty) - along(j, -1, t, w)
        reduced = -reduced if full else reduced
        ratio = (reduced if reduced > 0.0 else 0.0) / abs(pivot)
        if ratio < least:
            basic = False
            for i in range(ROWS):
                basic = basic or w[BASIS + i] == j
            if not basic:
                chosen, least = j, ratio
                change = (-ratio if full else ratio) * (1.0 if pivot > 0.0 else -1.0)
    return chosen, change


@step_kernel
def exchange(row: int, variable: int, change: float, t: Table, w: Any) -> None:
    """Put a variable into a row of the basis."""
    for i in range(ROWS):
        w[DUAL + i] += change * w[INVERSE + ROWS * row + i]
    pivot = along(variable, row, t, w)
    for i in range(ROWS):
        if i != row:
            share = along(variable, i, t, w) / pivot
            if share != 0.0:
                for k in range(ROWS):
                    w[INVERSE + ROWS * i + k] -= share * w[INVERSE + ROWS * row + k]
    for k in range(ROWS):
        w[INVERSE + ROWS * row + k] /= pivot
    w[BASIS + row] = variable
    full = variable < t.number and w[FULL + variable] > 0.0
    w[VALUE + row] = w[LIMIT + variable] if full else 0.0
    if full:
        w[FULL + variable] = 0.0


@inlined
def _larger(a: float, b: float) -> float:
    return a if a > b else b


@step_kernel
def _largest(w: Any) -> float:
    """Return the largest |number| of the inverse, 1 at least: of four that do not wait."""
    a = b = c = d = 1.0
    for i in range(INVERSE, INVERSE + ROWS * ROWS, 4):
        a, b = _larger(a, abs(w[i])), _larger(b, abs(w[i + 1]))
        c, d = _larger(c, abs(w[i + 2])), _larger(d, abs(w[i + 3]))
    return _larger(_larger(a, b), _larger(c, d))


@step_kernel
def advance(t: Table, w: Any) -> tuple[float, int]:
    """Add what AIM of the scratch holds to what the thrusters give, as far as they can.

    Returns the share of it that is added, and the row of the basis that limits it; 1, -1: all.
    """
    done = demand = 0.0
    for i in range(ROWS):
        demand = abs(w[AIM + i]) if abs(w[AIM + i]) > demand else demand
    for _ in range(_MOST_PIVOTS):
        largest = _largest(w)
        least = _LEAST_RATE * largest * demand
        step, row, down = 1.0 - done, -1, False
        for i in range(ROWS):
            rate = 0.0
            for k in range(ROWS):
                rate += w[INVERSE + ROWS * i + k] * w[AIM + k]
            w[RATE + i] = rate
            variable = int(w[BASIS + i])
            falls, torque = rate < -least, t.number <= variable < t.number + ROWS
            moves = falls or (rate > least and not torque)
            top = w[LIMIT + (variable if variable < t.number else 0)]
            top = top if variable < t.number else 0.0
            # no branch: which of them limits changes from call to call
            way = w[VALUE + i] if falls else top - w[VALUE + i]
            pace = -rate if falls else rate
            room = way / (pace if moves else 1.0)
            nearer = moves and room < step
            step = room if nearer else step
            row = i if nearer else row
            down = falls if nearer else down
        step = step if step > 0.0 else 0.0
        for i in range(ROWS):
            w[VALUE + i] += step * w[RATE + i]
        if row < 0:
            return 1.0, -1
        done += step
        variable, change = entering(row, down, _LEAST_PIVOT * largest, t, w)
        if variable < 0:
            return done, row
        leaving = int(w[BASIS + row])
        if leaving < t.number:
            w[FULL + leaving] = 0.0 if down else 1.0
        exchange(row, variable, change, t, w)
    return done, 0


@step_kernel
def allocate(wanted: Any, t: Table, w: Any) -> tuple[float, int]:
    """Fill THRUST of the scratch for a wanted force and torque (6,), in units of the rows.

    Of a demand that cannot be met the thrusters give the largest share in its own direction, then
    what more they have of each axis, x first: never a force against it.

    Returns that share, 1 where they can; and the row of the basis that limits it, -1 where none
    does. LIMIT of the scratch holds the largest thrusts.
    """
    return allocate_from(int(dearest(wanted, t)), wanted, t, w)


@step_kernel
def allocate_from(basis: int, wanted: Any, t: Table, w: Any) -> tuple[float, int]:
    """Do what `allocate` does, from a basis."""
    for i in range(ROWS):
        w[AIM + i] = wanted[i]
    start(basis, t, w)
    share, limiting = advance(t, w)
    if limiting >= 0:
        for axis in range(-1, 3):  # the rest of the torque, then of the force
            for i in range(ROWS):
                more = i == axis or (axis < 0 and i >= 3)
                w[AIM + i] = (1.0 - share) * wanted[i] if more else 0.0
            advance(t, w)
    for i in range(t.number):
        w[THRUST + i] = w[LIMIT + i] if w[FULL + i] > 0.0 else 0.0
    for i in range(ROWS):
        variable = int(w[BASIS + i])
        if variable < t.number:
            value = w[VALUE + i] if w[VALUE + i] > 0.0 else 0.0
            w[THRUST + variable] = value if value < w[LIMIT + variable] else w[LIMIT + variable]
    return share, limiting


@step_kernel
def want(command: Vector, torque: Vector, carried: Any, t: Table, w: Any, wanted: Any) -> None:
    """Fill `wanted` (6,) with commands and what is carried, LIMIT with what all could give."""
    for i in range(3):
        wanted[i] = command[i] + carried[i] / t.dt
        wanted[3 + i] = torque[i] / t.lever + carried[3 + i] / t.dt
    for i in range(t.number):
        w[LIMIT + i] = t.most[i]


@step_kernel
def leave_out(tick: int, failures: Any, t: Table, w: Any, wanted: Any) -> None:
    """Take those that are known to be stuck from LIMIT, and what they give from `wanted`."""
    for k in range(len(failures)):
        f = failures[k]
        if f[4] == 1 and f[2] <= tick < f[3]:
            stuck = int(f[0])
            if f[1] == ON and w[LIMIT + stuck] > 0.0:
                for i in range(ROWS):
                    wanted[i] -= t.most[stuck] * t.columns[ROWS * stuck + i]
            w[LIMIT + stuck] = 0.0


@step_kernel
def carry(carried: Any, t: Table, w: Any, wanted: Any) -> None:
    """Close those below their impulse bit; remember what is left over."""
    for i in range(t.number):
        thrust = w[THRUST + i]
        w[THRUST + i] = pick(thrust * t.dt < t.bits[i], 0.0, thrust)
    for i in range(ROWS if t.carries == 1 else 0):
        left = wanted[i]
        for k in range(t.number):
            left -= w[THRUST + k] * t.columns[ROWS * k + i]
        left = pick(left > t.bound, t.bound, pick(left < -t.bound, -t.bound, left))
        carried[i] = left * t.dt


@step_kernel
def stick(tick: int, failures: Any, t: Table, w: Any) -> None:
    """Open or close those that are stuck."""
    for k in range(len(failures)):
        f = failures[k]
        if f[2] <= tick < f[3]:
            stuck = int(f[0])
            w[THRUST + stuck] = t.most[stuck] if f[1] == ON else 0.0


@step_kernel
def exert(
    was_open: Any, spent: Spent, t: Table, tank: Tank, w: Any
) -> tuple[Vector, Vector, float, Spent]:
    """Return force, torque, mass and what is spent by what THRUST holds; a closed one adds zero."""
    x = y = z = tx = ty = tz = impulse = burnt = opened = 0.0
    for i in range(t.number):
        thrust, a = w[THRUST + i], ROWS * i
        opened += pick(thrust > 0.0, pick(was_open[i] == 0.0, 1.0, 0.0), 0.0)
        was_open[i] = pick(thrust >= t.most[i], 1.0, 0.0)
        x += thrust * t.acts[a]
        y += thrust * t.acts[a + 1]
        z += thrust * t.acts[a + 2]
        tx += thrust * t.acts[a + 3]
        ty += thrust * t.acts[a + 4]
        tz += thrust * t.acts[a + 5]
        impulse += thrust * t.dt
        burnt += thrust * t.dt * t.burns[i]
    share, mass, after = spend(spent, burnt, tank)
    delta_v = after.delta_v + share * (impulse - burnt) / mass
    after = Spent(delta_v, after.propellant, spent.openings + opened)
    return (x * share, y * share, z * share), (tx * share, ty * share, tz * share), mass, after


@step_kernel
def fire(
    tick: int,
    command: Vector,
    torque: Vector,
    carried: Any,
    was_open: Any,
    spent: Spent,
    t: Table,
    failures: Any,
    tank: Tank,
    w: Any,
    wanted: Any,
) -> tuple[Vector, Vector, float, Spent]:
    """Return mean force (3,) [N] and torque (3,) [N m] of a tick for commands, and the mass [kg].

    A thruster gives at least its impulse bit, or nothing. Those that are known to be stuck are left
    out, and the others give what they do not. The fourth is what is spent then.

    carried : (6,) impulse that is left over, of the force and of the torque over the lever [N s]
    was_open : (number,) 1 where a thruster was open to the end of the tick before
    failures : (n, 5) thruster, OFF or ON, first tick, tick after the last, 1 where it is known
    w, wanted : (SCRATCH,), (6,) scratch; THRUST of the first is filled
    """
    want(command, torque, carried, t, w, wanted)
    leave_out(tick, failures, t, w, wanted)
    allocate(wanted, t, w)
    carry(carried, t, w, wanted)
    stick(tick, failures, t, w)
    return exert(was_open, spent, t, tank, w)
