# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The attitude filter against matrices and SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_scenarios import GYRO, PD, TUMBLING, attitude_scenario
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from rpo_core.chain.flight import fly
from rpo_core.navigation.attitude_estimator import (
    AttitudeEstimator,
    AttitudeEstimatorStage,
)
from rpo_core.navigation.attitude_sensors import AttitudeSensors


def skew(v):
    """Return the matrix of the cross product with a vector."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def transition(rate, dt):
    """Return the matrix (6, 6) of the errors of a tick at a constant rate, by the exponential."""
    a = np.zeros((6, 6))
    a[:3, :3], a[:3, 3:] = -skew(rate), -np.eye(3)
    return expm(a * dt)


class Mekf:
    """Errors: 2 x vector part of estimated^-1 * true, in the chaser's axes; bias of the gyro."""

    def __init__(self, attitude, sigmas, dt, noise, walk, star, axes):
        self.attitude, self.bias = Rotation.from_quat(attitude), np.zeros(3)
        self.p = np.diag(np.square(np.repeat(sigmas, 3)))
        self.dt, self.q = dt, np.zeros((6, 6))
        whole, shared, walked = noise**2 * dt + walk**2 * dt**3 / 3, walk**2 * dt**2 / 2, walk**2
        self.q[:3, :3], self.q[3:, 3:] = np.eye(3) * whole, np.eye(3) * walked * dt
        self.q[:3, 3:] = self.q[3:, :3] = -np.eye(3) * shared
        self.r = axes.T @ np.diag(np.square(star)) @ axes

    def predict(self, before, after):
        rate = 0.5 * (before + after) - self.bias
        self.attitude *= Rotation.from_rotvec(rate * self.dt)
        f = transition(rate, self.dt)
        self.p = f @ self.p @ f.T + self.q

    def update(self, star):
        """Take an attitude against the stars; return its NIS."""
        off = (self.attitude.inv() * star).as_quat(canonical=True)[:3] * 2.0
        spread = self.p[:3, :3] + self.r
        gain = self.p[:, :3] @ np.linalg.inv(spread)
        error = gain @ off
        keep = np.eye(6) - gain @ np.eye(3, 6)
        self.p = keep @ self.p @ keep.T + gain @ self.r @ gain.T
        half = 0.5 * error[:3]
        self.attitude *= Rotation.from_quat([*half, np.sqrt(1.0 - half @ half)])
        self.bias = self.bias + error[3:]
        return off @ np.linalg.solve(spread, off)


def against_stars(rows, flown):
    """Return attitudes (n, 4) to target LVLH as rotations to inertial axes."""
    angles = flown.mean_motion_rad_s * flown.dt_s * np.arange(len(rows))
    return Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0])) * Rotation.from_quat(rows)


def stage_of(flown):
    """Return the filter of a scenario."""
    return AttitudeEstimatorStage(flown.section(AttitudeEstimator), flown)


@pytest.mark.parametrize('latency', [0, 3])
def test_it_is_the_filter_of_matrices_and_rotations(latency):
    star = {'latency_ticks': latency, 'period_ticks': 2, 'outages_s': [[20.0, 35.0]]}
    flown = attitude_scenario(star, ticks=400)
    stage, later, flight = stage_of(flown), stage_of(flown), fly(flown, PD)
    measured = flight.signals['attitude_measurement']
    axes = np.array(flown.section(AttitudeSensors).star_tracker.axes)
    other = Mekf(
        stage.p.start[:4], [np.radians(0.1), 5e-5], flown.dt_s, GYRO['noise_rad_s0_5'],
        GYRO['bias_walk_rad_s1_5'], np.radians([60.0, 10.0, 10.0]) / 3600.0, axes,
    )  # fmt: skip
    came = measured[:, :4].any(axis=1)
    assert came.sum() == (401 - latency + 1) // 2 - 75
    safe = np.where(came[:, None], measured[:, :4], [0.0, 0.0, 0.0, 1.0])
    stars = against_stars(np.roll(safe, -latency, axis=0), flown)  # by the tick they are of
    worst = np.zeros(3)
    for tick in range(401):
        found = stage.step(tick, tuple(measured[tick]))
        assert later.step(1001 + tick, tuple(measured[tick])) == found
        assert np.array_equal(flight.signals['navigation_attitude'][tick], found[0])
        np.testing.assert_array_equal(found[1], stage.covariance[:3, :3].ravel())
        if tick == 340:  # the newest one is of tick 198
            said = f'the attitude estimator is coasting: no star tracker for {142 - latency} ticks'
            assert stage.trouble() == said
        taken = tick - latency
        if taken < 0:
            continue
        if taken > 0:
            other.predict(measured[taken - 1, 4:], measured[taken, 4:])
        if came[tick]:
            nis = other.update(stars[taken])
            assert stage.m.nis[0] == pytest.approx(nis, rel=1e-4)
        here, p = other.attitude, other.p
        for ahead in range(taken, tick):  # on to the present, without the star tracker
            rate = measured[ahead : ahead + 2, 4:].mean(axis=0) - other.bias
            here = here * Rotation.from_rotvec(rate * flown.dt_s)
            f = transition(rate, flown.dt_s)
            p = f @ p @ f.T + other.q
        angle = flown.mean_motion_rad_s * flown.time_s(tick)
        mine = Rotation.from_rotvec([0.0, 0.0, angle]) * Rotation.from_quat(stage.m.x[:4])
        scale = np.sqrt(p.diagonal())
        errors = (
            (here.inv() * mine).magnitude(),
            np.abs(other.bias - np.array(stage.m.x[4:])).max(),
            np.abs((p - stage.covariance) / np.outer(scale, scale)).max(),
        )
        worst = np.maximum(worst, errors)
    assert (worst < [1e-9, 1e-9, 1e-5]).all(), worst


def errors_of(stage, truth, bias):
    """Return the error (6,) of the newest estimate: angles in the chaser's axes, bias."""
    off = Rotation.from_quat(stage.m.x[:4]).inv() * Rotation.from_quat(truth[:4])
    return np.array([*off.as_quat(canonical=True)[:3] * 2.0, *(bias - np.array(stage.m.x[4:]))])


def test_a_false_star_is_rejected_and_many_restart_it():
    at_rest = {**TUMBLING, 'rates_deg_s': None}
    flown = attitude_scenario(attitude_filter={'restart_after': 4}, attitude=at_rest)
    stage, blind = stage_of(flown), stage_of(flown)
    true, n = Rotation.from_quat(TUMBLING['attitude']), flown.mean_motion_rad_s
    rate = true.inv().apply([0.0, 0.0, n])
    right = (*true.as_quat(), *rate)
    wrong = (*-(true * Rotation.from_rotvec([0.0, 0.1, 0.0])).as_quat(canonical=True), *rate)
    for tick in range(50):
        stage.step(tick, right)
        blind.step(tick, right)
    before = np.linalg.norm(errors_of(stage, right, np.zeros(3))[:3])
    for tick in range(50, 53):
        stage.step(tick, wrong)
        blind.step(tick, (0.0, 0.0, 0.0, 0.0, *rate))
        assert np.array_equal(stage.covariance, blind.covariance)
        assert np.linalg.norm(errors_of(stage, right, np.zeros(3))[:3]) < before + 1e-6
    assert stage.trouble() == ''
    stage.step(53, wrong)
    assert 'it was restarted 1 times, the last time at tick 53' in stage.trouble()
    assert np.linalg.norm(errors_of(stage, wrong, np.zeros(3))[:3]) < 1e-9
    assert stage.m.x[3] > 0.0 > wrong[3], 'of two signs, the one with w >= 0'
    start = np.square([np.radians(0.1)] * 3 + [5e-5] * 3)
    np.testing.assert_allclose(stage.covariance, np.diag(start), rtol=1e-12)


@settings(max_examples=25)
@given(
    st.lists(
        st.lists(st.floats() | st.floats(-1.0, 1.0), min_size=7, max_size=7),
        min_size=1, max_size=25,
    ),
    st.integers(0, 3),
)  # fmt: skip
def test_its_attitude_is_a_unit_quaternion_whatever_is_measured(rows, latency):
    flown = attitude_scenario({'latency_ticks': latency}, attitude_filter={'restart_after': 2})
    stage = stage_of(flown)
    for tick, row in enumerate(rows):
        attitude, spread = stage.step(tick, tuple(row))
        assert np.isfinite([*attitude, *spread]).all()
        assert np.linalg.norm(attitude[:4]) == pytest.approx(1.0)
        assert attitude[3] >= 0.0


def test_of_missing_ticks_the_rate_is_held():
    flown = attitude_scenario({'latency_ticks': 2})
    first, gapped = stage_of(flown), stage_of(flown)
    row = (0.0, 0.0, 0.0, 0.0, 0.01, 0.02, -0.03)
    for tick in range(20):
        whole = first.step(tick, row)
        if tick in (0, 19):
            found = gapped.step(tick, row)
    assert found == whole


def test_a_new_flight_does_not_hold_the_attitude_of_the_last_one():
    stage = stage_of(attitude_scenario())
    none = (0.0, 0.0, 0.0, 0.0, 0.01, 0.02, -0.03)
    at_start = stage.off(none)[0]
    stage.off((1.0, 0.0, 0.0, 0.0, *none[4:]))
    assert stage.off(none)[0] != at_start
    stage.reset()
    assert stage.off(none)[0] == at_start
