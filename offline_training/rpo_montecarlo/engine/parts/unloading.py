# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Wheels that thrusters empty, side by side: row UNLOADING."""

from __future__ import annotations

import numpy as np

from rpo_attitude.unloading import Unloading
from rpo_core.chain.stage import Place
from rpo_kernels.chaser_kernels import unloaded, wheels_after
from rpo_montecarlo.engine.lanes import RUNS, TORQUE, UNLOADING, compiled
from rpo_montecarlo.engine.parts.attitude import vector_in
from rpo_montecarlo.engine.tick import Batch, Kind, Part, register, table_of

DT, ABOVE, TORQUES, MOST = range(4)
"""Places in the table: tick [s], the fields of the section, largest momentum of a wheel [N m s]."""


@compiled
def unload(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill row UNLOADING; the memory has the momentum of the wheels (3, 40)."""
    for s in range(RUNS):
        torque, spun = unloaded(vector_in(m, 0, s), t[ABOVE], t[TORQUES], t[DT])
        after = wheels_after(spun, vector_in(w, TORQUE, s), t[DT], t[MOST])
        for axis in range(3):
            w[UNLOADING + axis * RUNS + s], m[axis * RUNS + s] = torque[axis], after[axis]


def _part(batch: Batch) -> Part | None:
    settings = batch.base.section(Unloading)
    if settings is None:
        return None
    wheels = batch.base.attitude.wheels
    table = table_of(batch.base.dt_s, settings.above_nms, settings.torque_nm, wheels.momentum_nms)
    starts = batch.lanes([s.attitude.wheels.start_nms for s in batch.scenarios])
    return Part('unloading', ((Place.UNLOADING, unload),), table, np.ravel(starts))


register(Kind('unloading', _part))
