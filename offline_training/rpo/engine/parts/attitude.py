# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Chasers that turn, side by side: rows QUAT and RATE; the thrust turns with them."""

from __future__ import annotations

from typing import Any

import numpy as np

from rpo.engine.lanes import (
    EXERTED_TORQUE,
    FORCE,
    MASS,
    QUAT,
    QUAT_W,
    RATE,
    RUNS,
    SEEN_QUAT,
    SEEN_QUAT_W,
    SEEN_RATE,
    SHIFT_R,
    SHIFT_V,
    TORQUE,
    UNLOADING,
    R,
    V,
    compiled,
)
from rpo.engine.tick import SHIFTED, Batch, Kind, Part, register, table_of
from rpo_core.attitude.attitude_kernels import attitude_at
from rpo_core.attitude.chaser import chaser_tick, craft_at, turned_force
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place

FIRST = 1
"""Place in a tick of what is done once, before the first attitude is read."""

DT, WHEELS, FIRED, BURNS, MASSES = range(5)
CRAFTS = MASSES + RUNS
"""Places in the table: the tick [s]; whether wheels are commanded, thrusters give torque, the mass
falls; the mass of each run [kg]; the numbers of its `Craft` (20, 40).
The memory has the momentum of the wheels (3, 40), then the attitudes at the start (7, 40)."""


@compiled
def attitude_in(w, quat, quat_w, rate, s):  # type: ignore[no-untyped-def]
    """Return the attitude of a run in three rows of the scratch."""
    y, z = s + RUNS, s + 2 * RUNS
    return (
        w[quat + s], w[quat + y], w[quat + z], w[quat_w + s],
        w[rate + s], w[rate + y], w[rate + z],
    )  # fmt: skip


@compiled
def put_attitude(w, quat, quat_w, rate, s, a):  # type: ignore[no-untyped-def]
    """Put the attitude of a run into three rows of the scratch."""
    y, z = s + RUNS, s + 2 * RUNS
    w[quat + s], w[quat + y], w[quat + z], w[quat_w + s] = a[0], a[1], a[2], a[3]
    w[rate + s], w[rate + y], w[rate + z] = a[4], a[5], a[6]


def seen_rows(base: Scenario) -> tuple[int, int, int]:
    """Return the rows of the attitude that stages of a scenario read: estimated, or true."""
    estimated = base.named('attitude_estimator') is not None
    return (SEEN_QUAT, SEEN_QUAT_W, SEEN_RATE) if estimated else (QUAT, QUAT_W, RATE)


@compiled
def vector_in(w, row, s):  # type: ignore[no-untyped-def]
    """Return the three numbers of a run in a row."""
    return w[row + s], w[row + RUNS + s], w[row + 2 * RUNS + s]


@compiled
def begin(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill rows QUAT and RATE at the start."""
    if tick > 0:
        return
    for s in range(RUNS):
        put_attitude(w, QUAT, QUAT_W, RATE, s, attitude_at(m, 3 * RUNS + s, RUNS))


@compiled
def rotate(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Turn the chasers by a tick, and row FORCE, which is in their axes, into target LVLH."""
    dt = t[DT]
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        wanted = outside = (0.0, 0.0, 0.0)
        if t[WHEELS] > 0.0:
            wanted = vector_in(w, TORQUE, s)
            u = vector_in(w, UNLOADING, s)  # the wheels take up what empties them
            wanted = (wanted[0] - u[0], wanted[1] - u[1], wanted[2] - u[2])
        if t[FIRED] > 0.0:
            outside = vector_in(w, EXERTED_TORQUE, s)
        c = craft_at(t, CRAFTS + s, RUNS)
        now = attitude_in(w, QUAT, QUAT_W, RATE, s)
        middle, end, wheels = chaser_tick(now, (m[s], m[y], m[z]), wanted, outside, dt, c)
        m[s], m[y], m[z] = wheels
        mean, shift = turned_force(vector_in(w, FORCE, s), now, middle, end, dt, c.body.orbit)
        w[FORCE + s], w[FORCE + y], w[FORCE + z] = mean
        w[SHIFT_R + s], w[SHIFT_R + y], w[SHIFT_R + z] = shift[0], shift[1], shift[2]
        w[SHIFT_V + s], w[SHIFT_V + y], w[SHIFT_V + z] = shift[3], shift[4], shift[5]
        put_attitude(w, QUAT, QUAT_W, RATE, s, end)


@compiled
def shift(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Move the states by what turning adds to the force of the tick."""
    for s in range(RUNS):
        mass = w[MASS + s] if t[BURNS] > 0.0 else t[MASSES + s]
        for lane in (s, s + RUNS, s + 2 * RUNS):
            w[R + lane] += w[SHIFT_R + lane] / mass
            w[V + lane] += w[SHIFT_V + lane] / mass


def _part(batch: Batch) -> Part | None:
    base = batch.base
    if base.attitude is None:
        return None
    crafts, starts, wheels, masses = [], [], [], []
    for scenario in batch.scenarios:
        n, chaser = scenario.mean_motion_rad_s, scenario.attitude
        craft = chaser.craft(n)
        crafts.append((*craft.body, *craft[1:]))
        starts.append(chaser.start(n))
        wheels.append(chaser.wheels.start_nms if chaser.wheels else (0.0,) * 3)
        masses.append(scenario.mass_kg)
    thrusters: Any = base.thrusters
    flags = (
        base.dt_s,
        base.named('attitude_control') is not None and base.attitude.wheels is not None,
        thrusters is not None and thrusters.table is not None,
        thrusters is not None and thrusters.propellant is not None,
    )
    table = table_of(*flags, batch.lanes(masses), batch.lanes(crafts))
    memory = np.concatenate([batch.lanes(wheels).ravel(), batch.lanes(starts).ravel()])
    steps = ((FIRST, begin), (Place.ATTITUDE, rotate), (SHIFTED, shift))
    return Part('attitude', steps, table, memory)


register(Kind('attitude', _part))
register(Kind('unloading', lambda _: None))  # a part of `attitude_control`
