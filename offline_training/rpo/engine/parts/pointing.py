# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Where chasers shall look, side by side: rows REF; and how they lie at their first contact."""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np

from rpo.engine.lanes import (
    BODY_QUAT,
    BODY_QUAT_W,
    BODY_R,
    BODY_RATE,
    KNOWN_R,
    KNOWN_V,
    QUAT,
    QUAT_W,
    RATE,
    REF_QUAT,
    REF_QUAT_W,
    REF_RATE,
    RUNS,
    R,
    compiled,
)
from rpo.engine.parts.approach import know
from rpo.engine.parts.attitude import attitude_in, put_attitude, seen_rows, vector_in
from rpo.engine.parts.target import ATTITUDE, BODY, DT, TURNS, body_of, step_attitudes, targets_of
from rpo.engine.tick import COMMANDED, Batch, Kind, Part, register, table_of
from rpo_core.attitude.attitude_kernels import attitude_at, frame_of, synchronised
from rpo_core.attitude.pointing import NOWHERE, Aim, Pointing, from_target, off_contact, pointed
from rpo_core.attitude.target import ALIGNED
from rpo_core.judge.contact import Port, port_of, touches
from rpo_core.kernels.arrays import Floats
from rpo_core.navigation.sensors import STILL
from rpo_core.scenario.requirements import ATTITUDES
from rpo_core.stage import Place

BEGINS = BODY
AIM = BEGINS + 3
"""Places in the table of pointing: after the targets that are known the rows of the chaser's
attitude, -1 for none; the numbers of `Aim`. The memory has the attitudes of the targets (7, 40),
the turns (4, 40)."""

GOAL, SEEN, MATE, ORBITS = 4, 9, 10, 14
"""Places in the table of contact: the numbers of `Port`; whether the target turns; docked attitude;
mean motions (40,). The memory has whether a run has touched (40,), its angle [deg] and its rate
[deg/s] (2, 40)."""


@compiled
def _aim_at(t, i):  # type: ignore[no-untyped-def]
    return Aim(
        (t[i], t[i + 1], t[i + 2]), (t[i + 3], t[i + 4], t[i + 5]),
        (t[i + 6], t[i + 7], t[i + 8]), (t[i + 9], t[i + 10], t[i + 11], t[i + 12]),
        (t[i + 13], t[i + 14], t[i + 15]), t[i + 16], t[i + 17], t[i + 18], t[i + 19], t[i + 20],
    )  # fmt: skip


@compiled
def point_all(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill rows REF; turn the targets that are known by a tick."""
    aim, n, turns = _aim_at(t, AIM), RUNS, t[TURNS]
    for s in range(RUNS):
        target, body, i = attitude_at(m, s, n), body_of(t, turns, s), ATTITUDE + s
        k, v = vector_in(w, KNOWN_R, s), vector_in(w, KNOWN_V, s)
        state, before = (*k, *v), (m[i], m[i + n], m[i + 2 * n], m[i + 3 * n])
        if tick == 0 and t[BEGINS] >= 0.0:
            own = attitude_in(w, int(t[BEGINS]), int(t[BEGINS + 1]), int(t[BEGINS + 2]), s)
            before = from_target((own[0], own[1], own[2], own[3]), target)
        reference, turned = pointed(state, target, frame_of(target, body), before, aim)
        put_attitude(w, REF_QUAT, REF_QUAT_W, REF_RATE, s, reference)
        m[i], m[i + n], m[i + 2 * n], m[i + 3 * n] = turned
    step_attitudes(m, t, t[DT])


@compiled
def touch(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Keep how the chaser lies at its first contact."""
    port = Port(t[0], int(t[1]), t[2], t[3], (t[4], t[5], t[6]), t[7], t[8])
    row = BODY_R if t[SEEN] > 0.0 else R
    for s in range(RUNS):
        x, y, z = vector_in(w, row, s)
        if m[s] > 0.0 or not touches(x - t[GOAL], y - t[GOAL + 1], z - t[GOAL + 2], port):
            continue
        target = synchronised(t[ORBITS + s])
        if t[SEEN] > 0.0:
            target = attitude_in(w, BODY_QUAT, BODY_QUAT_W, BODY_RATE, s)
        mate = (t[MATE], t[MATE + 1], t[MATE + 2], t[MATE + 3])
        chaser = attitude_in(w, QUAT, QUAT_W, RATE, s)
        m[s] = 1.0
        m[RUNS + s], m[2 * RUNS + s] = off_contact(chaser, target, mate)


def _pointing(batch: Batch) -> Part | None:
    settings = batch.base.section(Pointing)
    if settings is None:
        return None
    targets = [s.target.known if s.target else STILL for s in batch.scenarios]
    table, attitudes = targets_of(batch, targets, [0] * len(targets))
    rows = (-1, -1, -1) if batch.base.attitude is None else seen_rows(batch.base)
    table = table_of(table, rows, *settings.aim(batch.base.dt_s))
    memory = table_of(attitudes, batch.lanes([NOWHERE] * len(targets)))
    steps = ((Place.GUIDANCE - 1, know), (Place.POINTING, point_all))
    return Part('pointing', steps, table, memory)


def _contact(batch: Batch) -> Part | None:
    base: Any = batch.base
    if base.requirements is None or not set(ATTITUDES) & base.requirements.limits.keys():
        return None
    settings = base.section(Pointing)
    mate = settings.mate if settings else ALIGNED
    port = port_of(base.requirements, base.goal_position_m)
    numbers = (*port[:4], *port.goal, *port[5:], base.target is not None)
    table = table_of(*numbers, mate, batch.lanes([s.mean_motion_rad_s for s in batch.scenarios]))
    memory = table_of(np.zeros(RUNS), np.full(2 * RUNS, inf))
    return Part('contact', ((COMMANDED, touch),), table, memory)


def turned_at_contact(memories: dict[str, Floats], count: int) -> Floats:
    """Return angles [deg] and rates [deg/s] (count, 2) at contact, of the memories of a flight."""
    return memories['contact'].reshape(3, RUNS)[1:, :count].T


register(Kind('pointing', _pointing))
register(Kind('', _contact))
