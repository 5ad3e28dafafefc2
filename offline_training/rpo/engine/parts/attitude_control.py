# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Attitude controllers side by side: kernels of `rpo_core.control`, inference in lanes."""

from __future__ import annotations

from typing import Any

import numpy as np

from rpo.engine.lanes import (
    E_R,
    E_V,
    FORCE,
    OUTPUT,
    QUAT,
    QUAT_W,
    RATE,
    REF_QUAT,
    REF_QUAT_W,
    REF_RATE,
    RUNS,
    TORQUE,
    UNLOADING,
    Law,
    compiled,
    infer_lanes,
)
from rpo.engine.parts.attitude import attitude_in, seen_rows, vector_in
from rpo.engine.tick import Batch, Kind, Part, register, table_of
from rpo_core.attitude.attitude_kernels import synchronised
from rpo_core.attitude.chaser import unloaded, wheels_after
from rpo_core.control.attitude import AttitudeControl
from rpo_core.control.attitude_law_kernels import (
    Errors,
    Steering,
    TorqueLaw,
    errors,
    force_ahead,
    limited,
    linear_torque,
)
from rpo_core.control.attitude_limits import TorqueLimits
from rpo_core.kernels.arithmetic import saturate
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import inlined
from rpo_core.kernels.simd import LANES
from rpo_core.stage import Place

WHEELS, ORBIT, DT, ABOVE, UNLOAD, INERTIA, KEPT = 3, 4, 5, 7, 8, 9, 15
FUZZY = HEAD = KEPT + len(TorqueLimits._fields)
LAW = FUZZY + 1
SCALES, FUNCTIONS, RULES, SAMPLES = LAW, LAW + 5, LAW + 15, LAW + 40
"""Places in the table of a law: the numbers of `Steering`, which runs have of their own; whether it
is fuzzy; its gains, or its scales, p1-p10, 25 rules, then the samples and their grades of Z, SP and
LP."""

POINTED, SEEN, HEADS, SHARED = 0, 1, 4, 4 + HEAD * RUNS
"""Places in the table: whether there is a reference; the rows of the attitude that is read; what
each run has; a law as the stage has it, its fuzzy samples padded for the lanes. The memory has the
rate of the reference a tick earlier and the momentum of the wheels (6, 40), then `Errors`, then
the momentum by the torques that arrived (3, 40)."""

OFF, ACTED = 6 * RUNS, 15 * RUNS


@inlined
def limits_at(t: Any, i: int) -> TorqueLimits:
    """Return the limits whose numbers lie in a flat table from place i on."""
    # fmt: off
    return TorqueLimits(
        t[i], t[i + 1], t[i + 2], t[i + 3], t[i + 4], t[i + 5], t[i + 6], t[i + 7], t[i + 8],
        t[i + 9], t[i + 10], t[i + 11], t[i + 12], t[i + 13], t[i + 14], t[i + 15], t[i + 16],
        t[i + 17], t[i + 18], t[i + 19], t[i + 20], t[i + 21],
    )
    # fmt: on


@inlined
def _steering_at(t: Any, i: int) -> Steering:
    """Return what lies in a flat table from place i on."""
    j = i + INERTIA
    return Steering(
        (t[i], t[i + 1], t[i + 2]), t[i + 3], t[i + 4], t[i + 5], t[i + 6], t[i + 7], t[i + 8],
        (t[j], t[j + 1], t[j + 2], t[j + 3], t[j + 4], t[j + 5]), limits_at(t, i + KEPT),
    )  # fmt: skip


@inlined
def _nine(t: Any, i: int) -> Any:
    return (
        t[i], t[i + 1], t[i + 2], t[i + 3], t[i + 4], t[i + 5], t[i + 6], t[i + 7], t[i + 8]
    )  # fmt: skip


@compiled
def _seen(w, t, s):  # type: ignore[no-untyped-def]
    return attitude_in(w, int(t[SEEN]), int(t[SEEN + 1]), int(t[SEEN + 2]), s)


@compiled
def _wanted(w, t, s):  # type: ignore[no-untyped-def]
    if t[POINTED] == 0.0:
        return synchronised(t[HEADS + HEAD * s + ORBIT])
    return attitude_in(w, REF_QUAT, REF_QUAT_W, REF_RATE, s)


@compiled
def _fill_errors(w, m, t, tick):  # type: ignore[no-untyped-def]
    dt = t[HEADS + DT]
    for s in range(RUNS):
        wanted = _wanted(w, t, s)
        before = (m[s], m[s + RUNS], m[s + 2 * RUNS])
        if tick == 0:
            before = (wanted[4], wanted[5], wanted[6])
        found = errors(_seen(w, t, s), wanted, before, dt)
        for j in range(len(found)):
            m[OFF + j * RUNS + s] = found[j]


@compiled
def _errors(m, s):  # type: ignore[no-untyped-def]
    i, n = OFF + s, RUNS
    return Errors(
        m[i], m[i + n], m[i + 2 * n], m[i + 3 * n], m[i + 4 * n], m[i + 5 * n], m[i + 6 * n],
        m[i + 7 * n], m[i + 8 * n],
    )  # fmt: skip


@compiled
def steer(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Turn row FORCE into body axes; fill row TORQUE, with the wheels as by its own commands."""
    law = t[SHARED:]
    _fill_errors(w, m, t, tick)
    if law[FUZZY] > 0.0:
        k = (len(law) - SAMPLES) // 4
        fis = Law(
            law[SCALES:FUNCTIONS], law[FUNCTIONS:RULES], law[RULES:SAMPLES],
            law[SAMPLES : SAMPLES + k], law[SAMPLES + k : SAMPLES + 2 * k],
            law[SAMPLES + 2 * k : SAMPLES + 3 * k], law[SAMPLES + 3 * k :],
        )  # fmt: skip
        angle, rate = law[SCALES], law[SCALES + 1]
        for s in range(RUNS):
            y, z = s + RUNS, s + 2 * RUNS
            e = _errors(m, s)
            w[E_R + s], w[E_V + s] = saturate(-e.ex / angle, 1.0), saturate(-e.wx / rate, 1.0)
            w[E_R + y], w[E_V + y] = saturate(-e.ey / angle, 1.0), saturate(-e.wy / rate, 1.0)
            w[E_R + z], w[E_V + z] = saturate(-e.ez / angle, 1.0), saturate(-e.wz / rate, 1.0)
        infer_lanes(w, 3 * RUNS, fis)
    for s in range(RUNS):
        y, z, i = s + RUNS, s + 2 * RUNS, HEADS + HEAD * s
        seen, e = _seen(w, t, s), _errors(m, s)
        torque, steering = (
            linear_torque(e, _nine(law, LAW), _nine(law, LAW + 9)),
            _steering_at(t, i),
        )
        if law[FUZZY] > 0.0:
            torque = (
                law[SCALES + 2] * w[OUTPUT + s],
                law[SCALES + 3] * w[OUTPUT + y],
                law[SCALES + 4] * w[OUTPUT + z],
            )
        wheels = (m[s + 3 * RUNS], m[s + 4 * RUNS], m[s + 5 * RUNS])
        _, wheels = unloaded(wheels, t[i + ABOVE], t[i + UNLOAD], t[i + DT])
        torque = limited(torque, e, seen, wheels, steering)
        w[TORQUE + s], w[TORQUE + y], w[TORQUE + z] = torque
        after = wheels_after(wheels, torque, t[i + DT], t[i + WHEELS])
        m[s + 3 * RUNS], m[s + 4 * RUNS], m[s + 5 * RUNS] = after
        wanted = _wanted(w, t, s)
        m[s], m[s + RUNS], m[s + 2 * RUNS] = wanted[4], wanted[5], wanted[6]
        force = force_ahead((w[FORCE + s], w[FORCE + y], w[FORCE + z]), seen, steering)
        w[FORCE + s], w[FORCE + y], w[FORCE + z] = force


@compiled
def unload(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill row UNLOADING: what empties the wheels, by the torques that arrived."""
    for s in range(RUNS):
        i, j = HEADS + HEAD * s, ACTED + s
        acted = vector_in(m, ACTED, s)
        taken, wheels = unloaded(acted, t[i + ABOVE], t[i + UNLOAD], t[i + DT])
        w[UNLOADING + s], w[UNLOADING + RUNS + s], w[UNLOADING + 2 * RUNS + s] = taken
        after = wheels_after(wheels, vector_in(w, TORQUE, s), t[i + DT], t[i + WHEELS])
        m[j], m[j + RUNS], m[j + 2 * RUNS] = after


def packed(steering: Steering, law: TorqueLaw) -> Floats:
    """Return a law as a flat table."""
    head = *steering, law.fuzzy
    if not law.fuzzy:
        return table_of(*head, law.attitude, law.rate)
    return table_of(*head, law.angle, law.speed, law.torques, *law.fis)


def padded(law: Floats) -> Floats:
    """Return the table of a law with its fuzzy samples padded for the lanes."""
    if law[FUZZY] == 0.0:
        return law
    rows = law[SAMPLES:].reshape(4, -1)
    more = -rows.shape[1] % LANES
    return table_of(law[:SAMPLES], np.pad(rows, ((0, 0), (0, more))))


def part_of(
    law: Floats,
    heads: Floats,
    starts: Floats,
    seen: tuple[int, int, int] = (QUAT, QUAT_W, RATE),
    pointed: bool = False,
) -> Part:
    """Return the part of a law, with the heads (40, 37) of its runs.

    starts : (3, 40) momentum of the wheels; seen : rows of the attitude that is read
    """
    table = table_of(pointed, seen, heads, padded(law))
    memory = table_of(np.zeros((3, RUNS)), starts, np.zeros((9, RUNS)), starts)
    steps = ((Place.STEERING, steer), (Place.LINK + 1, unload))
    return Part('attitude_control', steps, table, memory)


def _part(batch: Batch) -> Part | None:
    if batch.base.section(AttitudeControl) is None:
        return None
    tables, starts = [], []
    for scenario in batch.scenarios:
        chaser, settings = scenario.named('attitude'), scenario.section(AttitudeControl)
        assert settings is not None
        tables.append(packed(*settings.law_of(scenario)))
        starts.append(chaser.wheels.start_nms if chaser.wheels else (0.0, 0.0, 0.0))
    pointed = batch.base.named('pointing') is not None
    heads = batch.lanes([table[:HEAD] for table in tables]).T
    return part_of(tables[0], heads, batch.lanes(starts), seen_rows(batch.base), pointed)


register(Kind('attitude_control', _part))
