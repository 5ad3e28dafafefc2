# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Scenarios with sensors and estimators for the tests."""

from __future__ import annotations

from datetime import datetime, timezone
from typing import Any

from rpo_core.control.baselines import Pd
from rpo_core.scenario import scenario
from rpo_core.scenario.scenario import Scenario

LIDAR = {
    'kind': 'range_bearing',
    'noise_floor_m': 0.01,
    'noise_share': 0.01,
    'bearing_noise_rad': 0.002,
}
PD = Pd(name='pd', max_force_n=0.5, position_gain_n_m=0.01375, velocity_gain_n_s_m=0.6734)


def make(units: Any = (LIDAR,), key: int = 7, ticks: int = 300, **changes: Any) -> Scenario:
    """Return a scenario with sensors, and with an estimator unless `estimator` is None."""
    document = {
        'schema': 'rpo/scenario/1',
        'name': 'navigated',
        'orbit_radius_m': 6678000.0,
        'mass_kg': 10.0,
        'max_force_n': 0.5,
        'dt_s': 0.1,
        'duration_s': ticks / 10,
        'initial_position_m': [10.0, 60.0, -40.0],
        'initial_velocity_m_s': [0.0, 0.0, 0.0],
        'epoch': datetime(2026, 1, 1, tzinfo=timezone.utc),
        'disturbance': 'none',
        'sensors': {'units': list(units), 'noise_key': [key, 1]},
        'estimator': {},
        **changes,
    }
    return scenario.parse({name: value for name, value in document.items() if value is not None})


TUMBLING = {
    'inertia_kg_m2': [[2.0, 0.1, 0.0], [0.1, 1.5, 0.05], [0.0, 0.05, 1.0]],
    'attitude': [0.1, -0.2, 0.3, 0.9],
    'rates_deg_s': [1.5, -1.0, 2.0],
}
TUMBLE = {
    'kind': 'tumble', 'attitude': [0.2, -0.4, 0.1, 0.8], 'rates_deg_s': [1.0, 2.0, -1.5],
    'inertia_kg_m2': [[12.0, 0.0, 0.0], [0.0, 15.0, 0.0], [0.0, 0.0, 20.0]],
}  # fmt: skip
STAR = {'cross_noise_arcsec': 10.0, 'boresight_noise_arcsec': 60.0, 'boresight': [1.0, 2.0, -0.5]}
GYRO = {'noise_rad_s0_5': 2e-5, 'bias_rad_s': [3e-5, -5e-5, 2e-5], 'bias_walk_rad_s1_5': 1e-6}


def attitude_scenario(
    star: Any = (), gyro: Any = (), key: int = 7, attitude_filter: Any = (), **changes: Any
) -> Scenario:
    """Return a scenario whose chaser tumbles, and knows its attitude by a filter."""
    attitude_sensors = {
        'star_tracker': {**STAR, **dict(star)},
        'gyro': {**GYRO, **dict(gyro)},
        'noise_key': [key, 2],
    }
    sections = {
        'sensors': None,
        'estimator': None,
        'attitude': TUMBLING,
        'attitude_sensors': attitude_sensors,
        'attitude_estimator': dict(attitude_filter),
        'attitude_control': {'controller': 'attitude_pd'},  # without wheels it turns forces only
        **changes,
    }
    return make(**sections)
