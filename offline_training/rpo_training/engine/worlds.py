# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Paired runs in true worlds: pulses of valves, motion about a target that follows its orbit.

The kernels are those of the core, run by run; only inference and what is around it is SIMD.
"""

from __future__ import annotations

from rpo_core.orbit_kernels import World, relative_step
from rpo_core.pulse_kernels import DELTA_V, OPENINGS, SPENT, Tank, Valves, fire
from rpo_training.engine.lanes import compiled
from rpo_training.engine.parts import FORCE, MASS, PUSH, RUNS, R, V

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
    u = valves.shared
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
def step_orbits(w, tick, orbits, valves):  # type: ignore[no-untyped-def]
    """Step paired runs about their targets under rows FORCE and PUSH."""
    if orbits is None:
        return
    first = 2 * orbits.steps * tick
    for s in range(RUNS):
        y, z, p = s + RUNS, s + 2 * RUNS, orbits.worlds[s]
        world = World(p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7], int(p[8]))
        mass = orbits.masses[s]
        lightness = 1.0
        if valves is not None:
            lightness = mass / w[MASS + s]
            mass = w[MASS + s]
        push = (
            (w[FORCE + s] + w[PUSH + s]) / mass,
            (w[FORCE + y] + w[PUSH + y]) / mass,
            (w[FORCE + z] + w[PUSH + z]) / mass,
        )
        state = (w[R + s], w[R + y], w[R + z], w[V + s], w[V + y], w[V + z])
        rows = orbits.rows[orbits.of[s]]
        after = relative_step(state, push, lightness, rows, first, orbits.steps, orbits.step, world)
        w[R + s], w[R + y], w[R + z] = after[0], after[1], after[2]
        w[V + s], w[V + y], w[V + z] = after[3], after[4], after[5]
