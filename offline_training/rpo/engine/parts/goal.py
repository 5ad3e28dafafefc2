# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A goal away from the target, as `rpo_core.control.controller_file.FollowStage` flies to it."""

from __future__ import annotations

import numpy as np

from rpo.engine.lanes import FORCE, RUNS, SEEN_R, SEEN_V, R, V, compiled
from rpo.engine.tick import ADDED, Batch, Kind, Part, register, table_of
from rpo_core.guidance.guidance import Guidance
from rpo_core.kernels.arrays import Floats
from rpo_core.stage import Place
from rpo_core.world import cw

LANES, FROM_TRUTH, POSITION = range(3)
"""Places in the table; the goal [m] of each lane, then the force [N] that holds there."""


@compiled
def aim(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill rows SEEN with the state relative to the goal, as navigation finds it."""
    n = int(t[LANES])
    if t[FROM_TRUTH] > 0.0:
        for s in range(n):
            w[SEEN_R + s] = w[R + s]
            w[SEEN_V + s] = w[V + s]
    for s in range(n):
        w[SEEN_R + s] -= t[POSITION + s]


@compiled
def hold(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Add the force that holds at the goal to row FORCE."""
    n = int(t[LANES])
    for s in range(n):
        w[FORCE + s] += t[POSITION + n + s]


def part_of(position_m: Floats, force_n: Floats, *, from_truth: bool) -> Part:
    """Return the part of goals and holding forces (lanes,).

    from_truth : whether there is no navigation
    """
    table = table_of(len(position_m), from_truth, position_m, force_n)
    return Part('goal', ((Place.GUIDANCE, aim), (ADDED, hold)), table)


def position_of(part: Part) -> Floats:
    """Return the goal [m] of each lane."""
    return part.table[POSITION:][: int(part.table[LANES])]


def _part(batch: Batch) -> Part | None:
    """Return the goal, and for each run the force that holds its mass there on its orbit."""
    base = batch.base
    if base.goal is None:
        return None
    forces = np.zeros((3, RUNS))
    columns = batch.columns('orbit_radius_m', 'mass_kg')[:, : len(batch.starts)]
    for s, (radius_m, mass_kg) in enumerate(columns.T.tolist()):
        mean_motion = cw.mean_motion(radius_m, base.body)
        forces[:, s] = cw.holding_force_n(base.goal_position_m, mean_motion, mass_kg)
    made = part_of(np.repeat(base.goal_position_m, RUNS), forces.ravel(), from_truth=False)
    return made if base.section(Guidance) is None else made._replace(steps=())


register(Kind('', _part))
