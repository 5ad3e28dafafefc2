# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The inner loop of thrusters that fire in pulses, waste fuel and fail.

Kernels of + - * / and comparisons (`rpo_core.kernels.jit`), the same bits everywhere. A thruster is
a valve, open for a part of each tick.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from rpo_core.kernels.arithmetic import Vector, pick
from rpo_core.kernels.jit import kernel, step_kernel

OFF, ON = 1, 2
"""How a valve is stuck."""


class Valves(NamedTuple):
    """Thrusters as the kernels read them; times in seconds.

    number : of valves, 6 or 12: those of x+ first, then x-, y+, y-, z+, z-; 0: there are none
    carries : 1 where what is left of an impulse goes to the next tick (sigma-delta), else 0
    dt, least, quantum, dead, rise : length of a tick, shortest pulse, quantum of its length (0:
        none), from the signal to the first thrust, from there to full thrust
    thrust : of a valve, as the allocation knows it [N]
    directions : (number, 3) force of each valve at full thrust, with its errors [N]
    """

    number: int
    carries: int
    dt: float
    least: float
    quantum: float
    dead: float
    rise: float
    thrust: float
    directions: list[list[float]]


class Tank(NamedTuple):
    """What pulses cost.

    exhaust : velocity, specific impulse x standard gravity [m/s]; 0: the mass does not change
    content : propellant at the start [kg]; mass : of the chaser at the start, with it [kg]
    """

    exhaust: float
    content: float
    mass: float


class Spent(NamedTuple):
    """What thrusters have spent so far.

    delta_v : sum of thrust x on-time / mass over all valves [m/s]; propellant : [kg]
    openings : times that a valve opened
    """

    delta_v: float
    propellant: float
    openings: float


@kernel
def on_time(impulse: float, thrust: float, v: Valves) -> float:
    """Length of the pulse [s] of valves with a thrust [N] together, for an impulse >= 0 [N s]."""
    if thrust <= 0.0:
        return 0.0
    time = impulse / thrust
    if time >= v.dt:
        return v.dt
    if v.quantum > 0.0:
        time = v.quantum * int(time / v.quantum + 0.5)
        time = v.dt if time > v.dt else time
    return time if time >= v.least else 0.0


@kernel
def full_thrust_time(on: float, was_open: float, v: Valves) -> float:
    """Time at full thrust with the impulse of a pulse of length `on` [s].

    After the dead time the thrust rises linearly. A valve that is open already has neither.
    """
    if was_open > 0.0:
        return on
    after = on - v.dead
    if after <= 0.0:
        return 0.0
    if after < v.rise:
        return after * after / (2.0 * v.rise)
    return after - 0.5 * v.rise


@kernel
def spend(spent: Spent, impulse: float, tank: Tank) -> tuple[float, float, Spent]:
    """Take the propellant of an impulse [N s].

    Return the share that the tank gave, the mass [kg] in the middle of the tick, and what is spent.
    """
    burns = tank.exhaust > 0.0
    needed = pick(burns, impulse, 0.0) / pick(burns, tank.exhaust, 1.0)
    left = tank.content - spent.propellant
    short = needed > left
    share = pick(short, left, 1.0) / pick(short, needed, 1.0)
    needed = pick(short, left, needed)
    mass = tank.mass - spent.propellant - 0.5 * needed
    delta_v = spent.delta_v + share * impulse / mass
    return share, mass, Spent(delta_v, spent.propellant + needed, spent.openings)


@step_kernel
def allocate(tick: int, command: Vector, carried: Any, v: Valves, failures: Any, on: Any) -> None:
    """Fill `on`: for how long [s] each valve is commanded to open.

    An axis fires the valves of one side, all alike, or one alone where the impulse is too small for
    all. Valves that are known to be stuck are left
    alone, and the others give what they do not, up to their thrust: that is exact where the axis
    has enough thrust left, and where it is a whole number of quanta.
    """
    each = v.number // 6
    for i in range(v.number):
        on[i] = 0.0
    for axis in range(3):
        wanted = command[axis] * v.dt + carried[axis]
        ready_plus = ready_minus = each
        for k in range(len(failures)):
            f = failures[k]
            valve = int(f[0])
            if f[4] == 1 and f[2] <= tick < f[3] and valve // each // 2 == axis:
                plus = valve // each % 2 == 0
                ready_plus -= 1 if plus else 0
                ready_minus -= 0 if plus else 1
                on[valve] = -1.0
                if f[1] == ON:
                    wanted -= v.thrust * v.dt if plus else -v.thrust * v.dt
        side = 0 if wanted >= 0.0 else 1
        ready = ready_plus if side == 0 else ready_minus
        size = wanted if side == 0 else -wanted
        time = on_time(size, ready * v.thrust, v)
        if time == 0.0 and ready > 1:
            ready = 1
            time = on_time(size, v.thrust, v)
        left = size - time * ready * v.thrust
        first = (2 * axis + side) * each
        for i in range(first, first + each):
            if on[i] == 0.0 and ready > 0:
                on[i] = time
                ready -= 1
        most = each * v.thrust * v.dt
        left = most if left > most else left
        carried[axis] = (left if side == 0 else -left) if v.carries == 1 else 0.0
    for i in range(v.number):
        on[i] = 0.0 if on[i] < 0.0 else on[i]


@step_kernel
def fire(
    tick: int,
    command: Vector,
    carried: Any,
    was_open: Any,
    spent: Spent,
    v: Valves,
    failures: Any,
    tank: Tank,
    on: Any,
) -> tuple[Vector, float, Spent]:
    """Return the mean force (3,) [N] of a tick for a saturated command, and the mass [kg].

    A pulse lies in the middle of its tick, so that its mean force moves the chaser as the pulse
    does. The third is what is spent then.

    carried : (3,) impulse [N s] of each axis that is left over
    was_open : (number,) 1 where a valve was open to the end of the tick before
    failures : (n, 5) valve, OFF or ON, first tick, tick after the last, 1 where it is known
    on : (number,) scratch, filled with how long [s] each valve is open
    """
    allocate(tick, command, carried, v, failures, on)
    for k in range(len(failures)):
        f = failures[k]
        if f[2] <= tick < f[3]:
            on[int(f[0])] = v.dt if f[1] == ON else 0.0
    x = y = z = impulse = opened = 0.0
    for i in range(v.number):
        time = on[i]
        if time > 0.0:
            if was_open[i] == 0.0:
                opened += 1.0
            full = full_thrust_time(time, was_open[i], v)
            d = v.directions[i]
            x += full * d[0]
            y += full * d[1]
            z += full * d[2]
            impulse += time * v.thrust
        was_open[i] = 1.0 if time >= v.dt else 0.0
    share, mass, after = spend(spent, impulse, tank)
    scale = share / v.dt
    after = Spent(after.delta_v, after.propellant, spent.openings + opened)
    return (x * scale, y * scale, z * scale), mass, after


@kernel
def burn(
    force: Vector, saturated: Vector, spent: Spent, tank: Tank, dt: float
) -> tuple[Vector, float, Spent]:
    """Return the force (3,) [N] that the tank allows of one exerted without pulses, and the mass.

    The propellant is that of the saturated command, axis by axis. The third is what is spent then.
    """
    impulse = (abs(saturated[0]) + abs(saturated[1]) + abs(saturated[2])) * dt
    share, mass, after = spend(spent, impulse, tank)
    return (force[0] * share, force[1] * share, force[2] * share), mass, after
