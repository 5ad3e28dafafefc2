# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A camera that turns with the chaser: its view, and how sure of its attitude the filter is."""

from __future__ import annotations

import numpy as np
from nav_scenarios import LIDAR, attitude_scenario, unmodelled
from scipy.spatial.transform import Rotation

from rpo_core.chain.flight import fly
from rpo_core.control.controller_file import parse
from rpo_nav.estimator import Estimator, EstimatorStage
from rpo_nav.filter_kernels import START

CAMERA = {**LIDAR, 'body_fixed': True}
TURNED = Rotation.from_euler('xyz', [20.0, -30.0, 50.0], degrees=True)


def quaternion(turned):
    """Return an attitude (7,) that is at rest."""
    return (*turned.as_quat(canonical=True).tolist(), 0.0, 0.0, 0.0)


def covariance_after_one(spread):
    """Return the filter's covariance after one measurement, and its start, 1 m of each axis."""
    flown = attitude_scenario(
        sensors={'units': [CAMERA]}, estimator={'position_sigma_m': 1.0, 'gate_sigmas': 0.0}
    )
    stage = EstimatorStage(flown.section(Estimator), flown)
    assert stage.inputs[2:] == ('attitude', 'attitude_covariance')
    at = np.array(stage.filter[START : START + 3])
    seen = (*TURNED.inv().apply(at), 0.0, 0.0, 0.0, *[0.0] * 18)
    stage.step(0, (0.0,) * 3, seen, quaternion(TURNED), tuple(np.ravel(spread)))
    return stage.covariance[:3, :3], at


def noise_of(at, spread):
    """Return the covariance of a measurement: noise of the camera, and r x e of the attitude."""
    distance, turn = np.linalg.norm(at), TURNED.as_matrix()
    u, x = at / distance, np.cross(np.eye(3), at)  # rows: e_i x r
    own = np.outer(u, u) * (0.01 * distance) ** 2
    own += (np.eye(3) - np.outer(u, u)) * max(0.01, 0.002 * distance) ** 2
    return own + x.T @ turn @ spread @ turn.T @ x


def test_what_is_unsure_of_the_attitude_widens_the_measurement():
    """Of alike angles it is the Kalman filter of matrices; of others never smaller than that."""
    alike = np.eye(3) * 0.01**2
    found, at = covariance_after_one(alike)
    expected = np.linalg.inv(np.eye(3) + np.linalg.inv(noise_of(at, alike)))
    np.testing.assert_allclose(found, expected, atol=1e-9)
    rng = np.random.default_rng(5)
    for _ in range(10):
        root = rng.normal(size=(3, 3)) * 0.01
        found, at = covariance_after_one(root @ root.T)
        least = np.linalg.inv(np.eye(3) + np.linalg.inv(noise_of(at, root @ root.T)))
        assert np.linalg.eigvalsh(found - least).min() > -1e-9
        assert np.trace(found) < 2.0 * np.trace(least)


def test_both_filters_together_are_consistent():
    """The chaser tumbles; its attitude is estimated. A wrong turn would be metres."""
    drift = parse({'kind': 'drift', 'name': 'drift', 'max_force_n': 0.5, 'provenance': {}})
    runs, ticks, nees = 30, 150, []
    for key in range(runs):
        sensors = {'units': [CAMERA], 'noise_key': [key, 1]}
        flown = attitude_scenario(
            {'period_ticks': 5}, key=key, sensors=sensors, estimator={}, ticks=ticks
        )
        flight = fly(flown, drift, unmodelled(flown, key))
        errors = (flight.signals['navigation_state'] - flight.states)[ticks, :3]
        spread = flight.signals['navigation_covariance'][ticks, :9].reshape(3, 3)
        nees.append(errors @ np.linalg.solve(spread, errors))
    assert abs(np.mean(nees) - 3.0) < 4.0 * np.sqrt(6.0 / runs)
