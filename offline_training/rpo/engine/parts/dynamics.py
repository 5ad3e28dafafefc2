# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The motion of flights side by side: by Clohessy and Wiltshire, or about a target on its orbit.

The kernels are those of the core, in loops over lanes, which become SIMD.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rpo.engine.lanes import FORCE, MASS, PUSH, RUNS, R, V, compiled
from rpo.engine.tick import Batch, Kind, Part, register, table_of
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place
from rpo_core.world import cw
from rpo_core.world.cw import CwStep, cw_step, unpacked
from rpo_core.world.dynamics import (
    CLOHESSY_WILTSHIRE,
    COLUMNS,
    Environment,
    environment_of,
    inertial,
    middle,
    orbit_row,
    relative_after,
    steps_per_tick,
    target_rate,
    target_start,
    target_step,
    turning,
)

BURNS, MASSES = 0, 1
"""Places in both tables of drawn runs: whether the mass falls; that of each at the start [kg]."""

STEPS = MASSES + RUNS
"""Then, of each run, the fields of `CwStep`."""

STARTS, DENSITY, CHASER = (MASSES + RUNS * i for i in (1, 7, 8))
WORLD = MASSES + 9 * RUNS
"""Or, in the table of orbits: the inertial states of the targets, density and chaser of
`Environment`; then its numbers, how many steps a tick has, and how long one is [s]."""

# Rows of the memory of orbits: flat, so that the compiler knows how far apart they are.
NOW, SLOPE = 0, 6 * RUNS  # inertial state of the target, its derivative
BEGIN, HALF, END = (RUNS * (12 + COLUMNS * i) for i in range(3))  # of a step: the target's orbit
ROWS = 12 + 3 * COLUMNS


@compiled
def step_alike(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Step all loops by the same coefficients under rows FORCE and PUSH."""
    p, q, c = int(t[0]), int(t[1]), unpacked(t, 2, 1)
    for i in range(p):
        state = (w[R + i], w[R + p + i], 0.0, w[V + i], w[V + p + i], 0.0)
        total = (w[FORCE + i] + w[PUSH + i], w[FORCE + p + i] + w[PUSH + p + i], 0.0)
        w[R + i], w[R + p + i], _, w[V + i], w[V + p + i], _ = cw_step(state, total, c)
    for i in range(2 * p, 2 * p + q):
        state = (0.0, 0.0, w[R + i], 0.0, 0.0, w[V + i])
        total = (0.0, 0.0, w[FORCE + i] + w[PUSH + i])
        _, _, w[R + i], _, _, w[V + i] = cw_step(state, total, c)


def alike_part(planar: int, vertical: int, step: CwStep) -> Part:
    """Return the part of so many planar and vertical loops with one step."""
    return Part('dynamics', ((Place.DYNAMICS, step_alike),), table_of(planar, vertical, step))


@compiled
def step_each(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Step paired runs by coefficients of their own under rows FORCE and PUSH.

    A force counts as much more as it moves a chaser that has spent propellant.
    """
    if t[BURNS] > 0.0:
        for s in range(RUNS):
            more = t[MASSES + s] / w[MASS + s]
            for lane in (s, s + RUNS, s + 2 * RUNS):
                w[FORCE + lane] = (w[FORCE + lane] + w[PUSH + lane]) * more
                w[PUSH + lane] = 0.0
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        state = (w[R + s], w[R + y], w[R + z], w[V + s], w[V + y], w[V + z])
        total = (
            w[FORCE + s] + w[PUSH + s],
            w[FORCE + y] + w[PUSH + y],
            w[FORCE + z] + w[PUSH + z],
        )
        after = cw_step(state, total, unpacked(t, STEPS + s, RUNS))
        w[R + s], w[R + y], w[R + z] = after[0], after[1], after[2]
        w[V + s], w[V + y], w[V + z] = after[3], after[4], after[5]


@compiled
def _world(t, s):  # type: ignore[no-untyped-def]
    """World of a run."""
    i = WORLD
    return Environment(
        t[i], t[i + 1], t[DENSITY + s], t[i + 3], t[i + 4], t[i + 5], t[i + 6], t[CHASER + s],
        int(t[i + 8]),
    )  # fmt: skip


@compiled
def _row(m, at, s):  # type: ignore[no-untyped-def]
    i = at + s
    return (
        m[i], m[i + RUNS], m[i + 2 * RUNS], m[i + 3 * RUNS], m[i + 4 * RUNS], m[i + 5 * RUNS],
        m[i + 6 * RUNS], m[i + 7 * RUNS], m[i + 8 * RUNS], m[i + 9 * RUNS], m[i + 10 * RUNS],
    )  # fmt: skip


@compiled
def _fill(m, at, s, row):  # type: ignore[no-untyped-def]
    for j in range(len(row)):
        m[at + RUNS * j + s] = row[j]


@compiled
def _six(m, at, s):  # type: ignore[no-untyped-def]
    i = at + s
    return (
        m[i], m[i + RUNS], m[i + 2 * RUNS], m[i + 3 * RUNS], m[i + 4 * RUNS], m[i + 5 * RUNS]
    )  # fmt: skip


@compiled
def _step_targets(m, t, step):  # type: ignore[no-untyped-def]
    """Move the targets by a step; fill the rows of their orbits."""
    m[BEGIN:HALF] = m[END:]
    for s in range(RUNS):
        before, slope, world = _six(m, NOW, s), _six(m, SLOPE, s), _world(t, s)
        after = target_step(before, slope, step, world)
        slope_after = target_rate(after, world)
        between = middle(before, slope, after, slope_after, step)
        _fill(m, HALF, s, orbit_row(between, world))
        _fill(m, END, s, orbit_row(after, world))
        _fill(m, NOW, s, after)
        _fill(m, SLOPE, s, slope_after)


@compiled
def _turn(w, m, at, sign):  # type: ignore[no-untyped-def]
    """Make rows V inertial (sign 1), or relative to LVLH again (sign -1)."""
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        state = (w[R + s], w[R + y], w[R + z], w[V + s], w[V + y], w[V + z])
        about_x, about_z = m[at + RUNS + s], m[at + 2 * RUNS + s]
        found = inertial(state, about_x, about_z) if sign > 0 else turning(state, about_x, about_z)
        w[V + s], w[V + y], w[V + z] = found[3], found[4], found[5]


@compiled
def _move(w, m, t, step):  # type: ignore[no-untyped-def]
    """Move the chasers by a step; rows V are inertial, rows FORCE are force over mass."""
    light = t[BURNS] > 0.0
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        state = (w[R + s], w[R + y], w[R + z], w[V + s], w[V + y], w[V + z])
        push, lightness = (w[FORCE + s], w[FORCE + y], w[FORCE + z]), 1.0
        if light:
            lightness = t[MASSES + s] / w[MASS + s]
        begin, half, end = _row(m, BEGIN, s), _row(m, HALF, s), _row(m, END, s)
        after = relative_after(state, push, lightness, begin, half, end, step, _world(t, s))
        w[R + s], w[R + y], w[R + z] = after[0], after[1], after[2]
        w[V + s], w[V + y], w[V + z] = after[3], after[4], after[5]


@compiled
def step_orbits(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Step paired runs about their targets under rows FORCE and PUSH; row FORCE is used up."""
    light, steps, step = t[BURNS] > 0.0, int(t[WORLD + 9]), t[WORLD + 10]
    if tick == 0:
        m[NOW:SLOPE] = t[STARTS:DENSITY]
        for s in range(RUNS):
            state, world = _six(m, NOW, s), _world(t, s)
            _fill(m, SLOPE, s, target_rate(state, world))
            _fill(m, END, s, orbit_row(state, world))
    for axis in range(3):
        for s in range(RUNS):
            lane = axis * RUNS + s
            mass = w[MASS + s] if light else t[MASSES + s]
            w[FORCE + lane] = (w[FORCE + lane] + w[PUSH + lane]) / mass
    for i in range(steps):
        _step_targets(m, t, step)
        if i == 0:
            _turn(w, m, BEGIN, 1)
        _move(w, m, t, step)
    _turn(w, m, END, -1)


def _part(batch: Batch) -> Part:
    """Return the motion of runs that differ in mass and orbit."""
    dynamics, thrusters = batch.base.dynamics, batch.base.thrusters
    burns = thrusters is not None and bool(thrusters.fires or thrusters.propellant)
    if dynamics is not None and dynamics.kind != CLOHESSY_WILTSHIRE:
        return _orbits(batch, burns)
    masses, steps = batch.columns('mass_kg')[0], np.zeros((len(CwStep._fields), RUNS))
    radii = batch.columns('orbit_radius_m')[0]
    for s in range(len(batch.starts)):
        mean_motion = cw.mean_motion(float(radii[s]), batch.base.body)
        steps[:, s] = cw.discretise(mean_motion, float(masses[s]), batch.base.dt_s)
    masses[len(batch.starts) :] = 1.0
    table = table_of(burns, masses, steps)
    return Part('dynamics', ((Place.DYNAMICS, step_each),), table)


def _orbits(batch: Batch, burns: bool) -> Part:
    worlds, starts = [], []
    for s in batch.scenarios:
        assert s.dynamics is not None
        worlds.append(environment_of(s.dynamics, s))
        starts.append(target_start(s.dynamics, s))
    first = batch.scenarios[0]
    assert first.dynamics is not None
    steps = steps_per_tick(first.dynamics, first)
    all_of = zip(batch.scenarios, starts, worlds, strict=True)
    own = [(s.mass_kg, *x, world.density, world.chaser) for s, x, world in all_of]
    table = table_of(burns, batch.lanes(own), worlds[0], steps, first.dt_s / steps)
    return Part('dynamics', ((Place.DYNAMICS, step_orbits),), table, np.zeros(ROWS * RUNS))


def uneven_steps(scenario: Scenario, radii_m: Floats) -> str:
    """Return why runs cannot fly side by side: their ticks have different numbers of steps."""
    settings = scenario.dynamics
    if settings is None:
        return ''
    extremes = {float(radii_m.min()), float(radii_m.max())}
    steps = {steps_per_tick(settings, replace(scenario, orbit_radius_m=r)) for r in extremes}
    few = len(steps) == 1
    return '' if few else f'campaign of {scenario.name} has orbits that need other steps in a tick'


register(Kind('dynamics', _part))
