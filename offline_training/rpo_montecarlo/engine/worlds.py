# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Paired runs in true worlds: pulses of valves, motion about a target that follows its orbit.

The kernels are those of the core: motion in loops over lanes, which become SIMD; pulses run by run.
"""

from __future__ import annotations

from rpo_core.kernels.orbit_kernels import (
    COLUMNS,
    Environment,
    inertial,
    middle,
    orbit_row,
    relative_after,
    target_rate,
    target_step,
    turning,
)
from rpo_core.kernels.pulse_kernels import DELTA_V, OPENINGS, SPENT, Tank, Valves, burn, fire
from rpo_montecarlo.engine.lanes import compiled
from rpo_montecarlo.engine.parts import BEFORE, FORCE, MASS, PUSH, RUNS, R, V

# Rows of the table of orbits: flat, so that the compiler knows how far apart they are.
NOW, SLOPE = 0, 6 * RUNS  # inertial state of the target, its derivative
DENSITY, CHASER, FIRST_MASS = (RUNS * (12 + i) for i in range(3))  # of each run
BEGIN, HALF, END = (RUNS * (15 + COLUMNS * i) for i in range(3))  # of a step: the target's orbit
ROWS = 15 + 3 * COLUMNS

THRUST = (DELTA_V, SPENT, OPENINGS)
"""Places in the memory of valves of what their run has spent: delta-v, propellant, openings."""


@compiled
def place_valves(w, valves):  # type: ignore[no-untyped-def]
    """Fill the tanks and shut the valves."""
    if valves is None:
        return
    valves.memory[:] = 0.0
    for s in range(RUNS):
        w[MASS + s] = valves.tanks[s, 2]


@compiled
def fire_valves(w, tick, valves):  # type: ignore[no-untyped-def]
    """Replace row FORCE, the saturated command, by the mean force of pulses; fill row MASS."""
    if valves is None:
        return
    _fire_valves(w, tick, valves, valves.shared)


@compiled
def _fire_valves(w, tick, valves, shared):  # type: ignore[no-untyped-def]
    if shared is None:
        return
    u = shared
    for s in range(RUNS):
        y, z, tank = s + RUNS, s + 2 * RUNS, valves.tanks[s]
        mine = Valves(
            u.number, u.carries, u.dt, u.least, u.quantum, u.dead, u.rise, u.thrust,
            valves.directions[s], valves.failures[s],
        )  # fmt: skip
        force, w[MASS + s] = fire(
            tick,
            (w[FORCE + s], w[FORCE + y], w[FORCE + z]),
            valves.memory[s],
            mine,
            Tank(tank[0], tank[1], tank[2]),
            valves.on,
        )
        w[FORCE + s], w[FORCE + y], w[FORCE + z] = force


@compiled
def burn_propellant(w, valves, dt):  # type: ignore[no-untyped-def]
    """Replace row FORCE, exerted without pulses, by what the tanks allow; fill row MASS.

    The saturated command, which is counted already, is in row BEFORE.
    """
    if valves is None:
        return
    _burn_propellant(w, valves, valves.shared, dt)


@compiled
def _burn_propellant(w, valves, shared, dt):  # type: ignore[no-untyped-def]
    if shared is not None:
        return
    for s in range(RUNS):
        y, z, tank = s + RUNS, s + 2 * RUNS, valves.tanks[s]
        force, w[MASS + s] = burn(
            (w[FORCE + s], w[FORCE + y], w[FORCE + z]),
            (w[BEFORE + s], w[BEFORE + y], w[BEFORE + z]),
            valves.memory[s],
            Tank(tank[0], tank[1], tank[2]),
            dt,
        )
        w[FORCE + s], w[FORCE + y], w[FORCE + z] = force


@compiled
def _world(shared, table, s):  # type: ignore[no-untyped-def]
    """World of a run."""
    u = shared
    density, chaser = table[DENSITY + s], table[CHASER + s]
    return Environment(
        u.mu, u.j2, density, u.reference, u.thinning, u.spin, u.target, chaser, u.linear
    )


@compiled
def _row(t, at, s):  # type: ignore[no-untyped-def]
    i = at + s
    return (
        t[i], t[i + RUNS], t[i + 2 * RUNS], t[i + 3 * RUNS], t[i + 4 * RUNS], t[i + 5 * RUNS],
        t[i + 6 * RUNS], t[i + 7 * RUNS], t[i + 8 * RUNS], t[i + 9 * RUNS], t[i + 10 * RUNS],
    )  # fmt: skip


@compiled
def _fill(t, at, s, row):  # type: ignore[no-untyped-def]
    # fmt: off
    i = at + s
    (t[i], t[i + RUNS], t[i + 2 * RUNS], t[i + 3 * RUNS], t[i + 4 * RUNS], t[i + 5 * RUNS],
     t[i + 6 * RUNS], t[i + 7 * RUNS], t[i + 8 * RUNS], t[i + 9 * RUNS], t[i + 10 * RUNS]) = row
    # fmt: on


@compiled
def _six(t, at, s):  # type: ignore[no-untyped-def]
    i = at + s
    return (
        t[i], t[i + RUNS], t[i + 2 * RUNS], t[i + 3 * RUNS], t[i + 4 * RUNS], t[i + 5 * RUNS]
    )  # fmt: skip


@compiled
def _fill_six(t, at, s, six):  # type: ignore[no-untyped-def]
    # fmt: off
    i = at + s
    (t[i], t[i + RUNS], t[i + 2 * RUNS], t[i + 3 * RUNS], t[i + 4 * RUNS], t[i + 5 * RUNS]) = six
    # fmt: on


@compiled
def place_orbits(orbits):  # type: ignore[no-untyped-def]
    """Put the targets at their starts."""
    if orbits is None:
        return
    table = orbits.table
    table[NOW:SLOPE] = orbits.starts.ravel()
    for s in range(RUNS):
        state, world = _six(table, NOW, s), _world(orbits.shared, table, s)
        _fill_six(table, SLOPE, s, target_rate(state, world))
        _fill(table, END, s, orbit_row(state, world))


@compiled
def _step_targets(table, shared, step):  # type: ignore[no-untyped-def]
    """Move the targets by a step; fill the rows of their orbits."""
    table[BEGIN:HALF] = table[END:]
    for s in range(RUNS):
        before, slope, world = _six(table, NOW, s), _six(table, SLOPE, s), _world(shared, table, s)
        after = target_step(before, slope, step, world)
        slope_after = target_rate(after, world)
        between = middle(before, slope, after, slope_after, step)
        _fill(table, HALF, s, orbit_row(between, world))
        _fill(table, END, s, orbit_row(after, world))
        _fill_six(table, NOW, s, after)
        _fill_six(table, SLOPE, s, slope_after)


@compiled
def _turn(w, table, at, sign):  # type: ignore[no-untyped-def]
    """Make rows V inertial (sign 1), or relative to LVLH again (sign -1)."""
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        state = (w[R + s], w[R + y], w[R + z], w[V + s], w[V + y], w[V + z])
        about_x, about_z = table[at + RUNS + s], table[at + 2 * RUNS + s]
        found = inertial(state, about_x, about_z) if sign > 0 else turning(state, about_x, about_z)
        w[V + s], w[V + y], w[V + z] = found[3], found[4], found[5]


@compiled
def _move(w, table, shared, step, light):  # type: ignore[no-untyped-def]
    """Move the chasers by a step; rows V are inertial, rows FORCE are force over mass."""
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        state = (w[R + s], w[R + y], w[R + z], w[V + s], w[V + y], w[V + z])
        push, lightness = (w[FORCE + s], w[FORCE + y], w[FORCE + z]), 1.0
        if light:
            lightness = table[FIRST_MASS + s] / w[MASS + s]
        begin, half, end = _row(table, BEGIN, s), _row(table, HALF, s), _row(table, END, s)
        world = _world(shared, table, s)
        after = relative_after(state, push, lightness, begin, half, end, step, world)
        w[R + s], w[R + y], w[R + z] = after[0], after[1], after[2]
        w[V + s], w[V + y], w[V + z] = after[3], after[4], after[5]


@compiled
def step_orbits(w, orbits, valves):  # type: ignore[no-untyped-def]
    """Step paired runs about their targets under rows FORCE and PUSH; row FORCE is used up."""
    if orbits is None:
        return
    table, shared, step, light = orbits.table, orbits.shared, orbits.step, valves is not None
    for axis in range(3):
        for s in range(RUNS):
            lane = axis * RUNS + s
            mass = w[MASS + s] if light else table[FIRST_MASS + s]
            w[FORCE + lane] = (w[FORCE + lane] + w[PUSH + lane]) / mass
    for i in range(orbits.steps):
        _step_targets(table, shared, step)
        if i == 0:
            _turn(w, table, BEGIN, 1)
        _move(w, table, shared, step, light)
    _turn(w, table, END, -1)
