# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Star trackers, gyros and attitude filters side by side: rows SEEN_QUAT, SEEN_RATE, SPREAD."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from rpo_core.chain.stage import Place
from rpo_core.files.scenario import Scenario
from rpo_kernels.kernels import Vector
from rpo_montecarlo.engine.lanes import (
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
from rpo_montecarlo.engine.parts.attitude import attitude_in, put_attitude
from rpo_montecarlo.engine.tick import Batch, Draw, Kind, Part, register, table_of
from rpo_nav.attitude_estimator import AttitudeEstimator, attitude_filter_of, attitude_memory_of
from rpo_nav.attitude_filter_kernels import RATE as FOUND_RATE
from rpo_nav.attitude_filter_kernels import STATES, P, X, estimate_attitude
from rpo_nav.attitude_sensor_kernels import KEY, NOISE, attitude_noise, sensed_attitude
from rpo_nav.attitude_sensors import AttitudeSensing, AttitudeSensors

SIZES, KEYS, TABLES = 0, 4, 4 + 2 * RUNS
"""Places in the table: sizes of the tables of a run's sensors and filter, and of their memories;
keys of the noise (2, 40); those tables, run by run. The memory has the noise (9, 40), those of the
sensors, then those of the filters."""

_NOISE = 9 * RUNS


@compiled
def navigate_attitude(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill rows SEEN_QUAT, SEEN_QUAT_W and SEEN_RATE with the estimates, SPREAD with how sure."""
    a, b, c, d = int(t[SIZES]), int(t[SIZES + 1]), int(t[SIZES + 2]), int(t[SIZES + 3])
    for s in range(RUNS):
        noise = attitude_noise(tick, int(t[KEYS + s]), int(t[KEYS + RUNS + s]))
        for j in range(9):
            m[j * RUNS + s] = noise[j]
    for s in range(RUNS):
        y, z, settings = s + RUNS, s + 2 * RUNS, t[TABLES + (a + b) * s :][: a + b]
        arrived, f = m[_NOISE + c * s :][:c], m[_NOISE + c * RUNS + d * s :][:d]
        for j in range(9):
            arrived[NOISE + j] = m[j * RUNS + s]
        sensed_attitude(tick, attitude_in(w, QUAT, QUAT_W, RATE, s), settings[:a], arrived)
        estimate_attitude(tick, arrived, settings[a:], f)
        found = (
            f[X], f[X + 1], f[X + 2], f[X + 3],
            f[FOUND_RATE], f[FOUND_RATE + 1], f[FOUND_RATE + 2],
        )  # fmt: skip
        put_attitude(w, SEEN_QUAT, SEEN_QUAT_W, SEEN_RATE, s, found)
        i, j, k = P, P + STATES, P + 2 * STATES
        w[SPREAD_X + s], w[SPREAD_X + y], w[SPREAD_X + z] = f[i], f[i + 1], f[i + 2]
        w[SPREAD_Y + s], w[SPREAD_Y + y], w[SPREAD_Y + z] = f[j], f[j + 1], f[j + 2]
        w[SPREAD_Z + s], w[SPREAD_Z + y], w[SPREAD_Z + z] = f[k], f[k + 1], f[k + 2]


def _part(batch: Batch) -> Part | None:
    if batch.base.section(AttitudeEstimator) is None:
        return None
    sensing, filters = [], []
    for s in batch.scenarios:
        sensors, settings = s.section(AttitudeSensors), s.section(AttitudeEstimator)
        assert sensors is not None and settings is not None
        sensing.append(AttitudeSensing(sensors, s))
        filters.append(attitude_filter_of(settings, sensors, s))
    memories = [np.asarray(attitude_memory_of(f)) for f in filters]
    tables = [table_of(s.table, f) for s, f in zip(sensing, filters, strict=True)]
    keys = [s.table[KEY : KEY + 2] for s in sensing]
    sizes = [len(v) for v in (sensing[0].table, filters[0], sensing[0].memory, memories[0])]
    return Part(
        'attitude_estimator',
        ((Place.ATTITUDE_ESTIMATOR, navigate_attitude),),
        table_of(sizes, batch.lanes(keys), batch.lanes(tables).T),
        table_of(
            np.zeros(_NOISE),
            batch.lanes([s.memory for s in sensing]).T,
            batch.lanes(memories).T,
        ),
    )


def vary(scenario: Scenario, draw: Draw) -> list[Any]:
    """Return sensors and estimator of a run; the filter assumes what is nominal."""
    sensors, estimator = scenario.section(AttitudeSensors), scenario.section(AttitudeEstimator)
    if sensors is None:
        return []
    star, gyro = sensors.star_tracker, sensors.gyro
    louder = 1.0 + draw.values.get('star_tracker_noise_share', 0.0)
    bias = _more(gyro.bias_rad_s, draw, 'gyro_bias_{}_rad_s')
    found: list[Any] = [
        replace(
            sensors,
            star_tracker=replace(
                star,
                cross_noise_arcsec=louder * star.cross_noise_arcsec,
                boresight_noise_arcsec=louder * star.boresight_noise_arcsec,
            ),
            gyro=replace(gyro, bias_rad_s=bias),
            noise_key=draw.key,
        )
    ]
    if estimator is not None:
        error = _more(estimator.start_error_deg, draw, 'attitude_error_{}_deg')
        scale = estimator.noise_scale / louder
        found.append(replace(estimator, noise_scale=scale, start_error_deg=error))
    return found


def _more(value: Vector, draw: Draw, name: str) -> Vector:
    """Return a vector of a scenario with what was drawn of it."""
    x, y, z = (
        part + draw.values.get(name.format(axis), 0.0)
        for part, axis in zip(value, 'xyz', strict=True)
    )
    return x, y, z


register(Kind('attitude_sensors', lambda batch: None, vary=vary))
register(Kind('attitude_estimator', _part))
