# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Star trackers, gyros and attitude filters side by side: rows SEEN_QUAT, SEEN_RATE, SPREAD."""

from __future__ import annotations

import numpy as np

from rpo.engine.lanes import (
    QUAT,
    QUAT_W,
    RATE,
    RUNS,
    SEEN_QUAT,
    SEEN_QUAT_W,
    SEEN_RATE,
    SPREAD_X,
    SPREAD_Y,
    SPREAD_Z,
    compiled,
)
from rpo.engine.parts.attitude import attitude_in
from rpo.engine.parts.attitude_estimation_tables import RATE as FOUND_RATE
from rpo.engine.parts.attitude_estimation_tables import (
    STATES,
    P,
    X,
    attitude_filter_of,
    attitude_memory_of,
    estimate_attitude,
    scratch_of,
)
from rpo.engine.parts.attitude_sensor_tables import (
    KEY,
    NOISE,
    AttitudeSensing,
    attitude_noise,
    sensed_attitude,
)
from rpo.engine.tick import Batch, Kind, Part, register, table_of
from rpo_core.kernels.vectors import OWN, WIDTH, over_runs, own_tables
from rpo_core.navigation.attitude_estimator import AttitudeEstimator
from rpo_core.navigation.attitude_sensors import AttitudeSensors
from rpo_core.stage import Place

KEYS, NOISES = OWN, 0
"""Places in the table: keys of the noise (2, 40); in the memory: the noise (9, 40). A run's own
table has the sizes of the table and memory of its sensors, that table, that of its filter; its own
memory, that of its sensors, that of its filter."""


@compiled
def _estimate(tick, w, m, s, settings, memory):  # type: ignore[no-untyped-def]
    a, c = 2 + int(settings[0]), int(settings[1])
    for j in range(9):
        memory[NOISE + j] = m[NOISES + j * RUNS + s]
    sensed_attitude(tick, attitude_in(w, QUAT, QUAT_W, RATE, s), settings[2:a], memory)
    f = memory[c:]
    estimate_attitude(tick, memory, settings[a:], f)
    w[SEEN_QUAT_W + s] = f[X + 3]
    for i in range(3):
        lane = s + i * RUNS
        w[SEEN_QUAT + lane], w[SEEN_RATE + lane] = f[X + i], f[FOUND_RATE + i]
        w[SPREAD_X + lane], w[SPREAD_Y + lane] = f[P + i], f[P + STATES + i]
        w[SPREAD_Z + lane] = f[P + 2 * STATES + i]


_estimate_all = over_runs(_estimate, RUNS)


@compiled
def navigate_attitude(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill rows SEEN_QUAT, SEEN_QUAT_W and SEEN_RATE with the estimates, SPREAD with how sure."""
    for s in range(RUNS):
        noise = attitude_noise(tick, int(t[KEYS + s]), int(t[KEYS + RUNS + s]))
        for j in range(9):
            m[NOISES + j * RUNS + s] = noise[j]
    _estimate_all(w, m, t, tick)


def _part(batch: Batch) -> Part | None:
    if batch.base.section(AttitudeEstimator) is None:
        return None
    keys, tables, memories = [], [], []
    for s in batch.scenarios:
        sensors, settings = s.section(AttitudeSensors), s.section(AttitudeEstimator)
        assert sensors is not None and settings is not None
        sensing = AttitudeSensing(sensors, s)
        f = attitude_filter_of(settings, sensors, s)
        sizes = len(sensing.table), len(sensing.memory)
        keys.append(sensing.table[KEY : KEY + 2])
        tables.append(table_of(sizes, sensing.table, f))
        memories.append(table_of(sensing.memory, attitude_memory_of(f)))
    owned = own_tables(
        WIDTH,
        batch.lanes(keys).ravel(),
        batch.lanes(tables),
        np.zeros(9 * RUNS),
        batch.lanes(memories),
        sizes[1],
        scratch_of(f),
    )
    steps = ((Place.ATTITUDE_ESTIMATOR, navigate_attitude),)
    return Part('attitude_estimator', steps, *owned)


register(Kind('attitude_sensors', lambda batch: None))
register(Kind('attitude_estimator', _part))
