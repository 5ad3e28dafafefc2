# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The attitude filter against matrices and SciPy's rotations, and against its own covariance."""

from __future__ import annotations

import numpy as np
import pytest
from attitude_oracle import Mekf, transition
from hypothesis import given, settings
from hypothesis import strategies as st
from nav_scenarios import GYRO, PD, TUMBLING, attitude_scenario
from scipy.spatial.transform import Rotation

from rpo_core.chain.flight import fly
from rpo_nav.attitude_estimator import AttitudeEstimator, AttitudeEstimatorStage, attitude_memory_of
from rpo_nav.attitude_filter_kernels import SQUARE, TESTED, P, X, step_attitude
from rpo_nav.attitude_sensors import AttitudeSensors


def against_stars(rows, flown):
    """Return attitudes (n, 4) to target LVLH as rotations to inertial axes."""
    angles = flown.mean_motion_rad_s * flown.dt_s * np.arange(len(rows))
    return Rotation.from_rotvec(np.outer(angles, [0.0, 0.0, 1.0])) * Rotation.from_quat(rows)


@pytest.mark.parametrize('latency', [0, 3])
def test_it_is_the_filter_of_matrices_and_rotations(latency):
    flown = attitude_scenario({'latency_ticks': latency, 'period_ticks': 2}, ticks=400)
    stage = AttitudeEstimatorStage(flown.section(AttitudeEstimator), flown)
    flight = fly(flown, PD)
    measured = flight.signals['attitude_measurement']
    axes = np.array(flown.section(AttitudeSensors).star_tracker.axes)
    other = Mekf(
        stage.filter[21:25], [np.radians(0.1), 5e-5], flown.dt_s, GYRO['noise_rad_s0_5'],
        GYRO['bias_walk_rad_s1_5'], np.radians([60.0, 10.0, 10.0]) / 3600.0, axes,
    )  # fmt: skip
    came = measured[:, :4].any(axis=1)
    assert came.sum() == (401 - latency + 1) // 2
    safe = np.where(came[:, None], measured[:, :4], [0.0, 0.0, 0.0, 1.0])
    stars = against_stars(np.roll(safe, -latency, axis=0), flown)  # by the tick they are of
    worst = np.zeros(3)
    for tick in range(401):
        stage.step(tick, tuple(measured[tick]))
        assert np.array_equal(flight.signals['navigation_attitude'][tick, :4], stage.memory[X:][:4])
        taken = tick - latency
        if taken < 0:
            continue
        if taken > 0:
            other.predict(measured[taken - 1, 4:], measured[taken, 4:])
        if came[tick]:
            nis = other.update(stars[taken])
            assert stage.memory[TESTED + 1] == pytest.approx(nis, rel=1e-4)
        here, p = other.attitude, other.p
        for later in range(taken, tick):  # on to the present, without the star tracker
            rate = measured[later : later + 2, 4:].mean(axis=0) - other.bias
            here = here * Rotation.from_rotvec(rate * flown.dt_s)
            f = transition(rate, flown.dt_s)
            p = f @ p @ f.T + other.q
        angle = flown.mean_motion_rad_s * flown.time_s(tick)
        mine = Rotation.from_rotvec([0.0, 0.0, angle]) * Rotation.from_quat(stage.memory[X:][:4])
        scale = np.sqrt(p.diagonal())
        errors = (
            (here.inv() * mine).magnitude(),
            np.abs(other.bias - stage.memory[X + 4 : X + 7]).max(),
            np.abs((p - stage.covariance) / np.outer(scale, scale)).max(),
        )
        worst = np.maximum(worst, errors)
    assert (worst < [1e-9, 1e-9, 1e-5]).all(), worst


@settings(max_examples=30)
@given(st.lists(st.floats(-0.5, 0.5), min_size=6, max_size=6), st.integers(0, 99))
def test_a_step_is_the_exponential(numbers, seed):
    """Attitude by SciPy; covariance by the matrix exponential, to second order in the turn."""
    flown = attitude_scenario()
    stage = AttitudeEstimatorStage(flown.section(AttitudeEstimator), flown)
    m, dt = attitude_memory_of(stage.filter), flown.dt_s
    root = np.random.default_rng(seed).normal(size=(6, 6)) * ([1e-3] * 3 + [1e-4] * 3)
    before = root.T @ root
    q = Rotation.from_rotvec(numbers[:3]).as_quat(canonical=True)
    for at, values in ((X, [*q, 0.0, 0.0, 0.0]), (P, before.ravel())):
        for j, value in enumerate(values):
            m[at + j] = float(value)
    step_attitude(m, tuple(numbers[3:]), stage.filter)
    rate = np.array(numbers[3:])
    expected = Rotation.from_rotvec([0.0, 0.0, -flown.mean_motion_rad_s * dt]) * (
        Rotation.from_quat(q) * Rotation.from_rotvec(rate * dt)
    )
    np.testing.assert_allclose(m[X : X + 4], expected.as_quat(canonical=True), atol=1e-15)
    f = transition(rate, dt)
    after = np.array(m[P : P + SQUARE]).reshape(6, 6)
    np.testing.assert_array_equal(after, after.T)
    scale = np.sqrt(np.outer(after.diagonal(), after.diagonal()))
    noise = np.zeros((6, 6))
    for i in range(3):
        noise[i, i], noise[i + 3, i + 3] = stage.filter[3], stage.filter[5]
        noise[i, i + 3] = noise[i + 3, i] = stage.filter[4]
    assert (np.abs(after - f @ before @ f.T - noise) < 2e-5 * scale).all()


def stage_of(flown):
    """Return the filter of a scenario."""
    return AttitudeEstimatorStage(flown.section(AttitudeEstimator), flown)


def errors_of(stage, truth, bias):
    """Return the error (6,) of the newest estimate: angles in the chaser's axes, bias."""
    off = Rotation.from_quat(stage.memory[X : X + 4]).inv() * Rotation.from_quat(truth[:4])
    return np.array([*off.as_quat(canonical=True)[:3] * 2.0, *(bias - stage.memory[X + 4 : X + 7])])


@pytest.mark.parametrize('star', [{}, {'latency_ticks': 3, 'period_ticks': 5}], ids=str)
def test_errors_are_as_large_as_it_says(star):
    """Mean NEES of 6 and NIS of 3; bounds of 4 sigma for so few runs."""
    runs, ticks, sigma = 60, 200, 5e-5
    nees, nis, still = [], [], {'bias_walk_rad_s1_5': 0.0}
    for key in range(runs):
        bias = np.random.default_rng(key).normal(size=3) * sigma
        flown = attitude_scenario(
            star, {**still, 'bias_rad_s': bias.tolist()}, key, ticks=ticks,
            attitude_filter={'bias_sigma_rad_s': sigma},
        )  # fmt: skip
        flight, stage = fly(flown, PD), stage_of(flown)
        for tick in range(ticks + 1):
            stage.step(tick, tuple(flight.signals['attitude_measurement'][tick]))
            if stage.memory[TESTED] > 0.0:
                nis.append(stage.memory[TESTED + 1])
        error = errors_of(stage, flight.signals['chaser_attitude'][ticks], bias)
        nees.append(error @ np.linalg.solve(stage.covariance, error))
    assert abs(np.mean(nees) - 6.0) < 4.0 * np.sqrt(12.0 / runs)
    assert abs(np.mean(nis) - 3.0) < 4.0 * np.sqrt(6.0 / len(nis))


def test_without_a_star_tracker_the_angles_grow_as_the_gyro_says():
    """Closed form of a chaser that does not turn: t^2 of bias, t of noise, t^3 of the walk."""
    flown = attitude_scenario({'outages_s': [[0.05, 999.0]]})
    stage, zero = stage_of(flown), (0.0,) * 7
    for tick in range(301):
        found = stage.step(tick, zero)
    sigma, bias = np.radians(0.1), 5e-5
    noise, walk, t = GYRO['noise_rad_s0_5'], GYRO['bias_walk_rad_s1_5'], 30.0
    angle = sigma**2 + (bias * t) ** 2 + noise**2 * t + walk**2 * t**3 / 3.0
    np.testing.assert_allclose(stage.covariance.diagonal()[:3], angle, rtol=1e-5)
    np.testing.assert_allclose(stage.covariance.diagonal()[3:], bias**2 + walk**2 * t)
    np.testing.assert_array_equal(found[1], stage.covariance[:3, :3].ravel())
    said = 'the attitude estimator is coasting: no star tracker for 300 ticks'
    assert stage.trouble() == said


def test_a_false_star_is_rejected_and_many_restart_it():
    at_rest = {**TUMBLING, 'rates_deg_s': None}
    flown = attitude_scenario(attitude_filter={'restart_after': 4}, attitude=at_rest)
    stage = stage_of(flown)
    true, n = Rotation.from_quat(TUMBLING['attitude']), flown.mean_motion_rad_s
    rate = true.inv().apply([0.0, 0.0, n])
    right = (*true.as_quat(), *rate)
    wrong = (*(true * Rotation.from_rotvec([0.0, 0.1, 0.0])).as_quat(), *rate)
    for tick in range(50):
        stage.step(tick, right)
    before = np.linalg.norm(errors_of(stage, right, np.zeros(3))[:3])
    for tick in range(50, 53):
        stage.step(tick, wrong)
        assert np.linalg.norm(errors_of(stage, right, np.zeros(3))[:3]) < before + 1e-6
    assert stage.trouble() == ''
    stage.step(53, wrong)
    assert 'it was restarted 1 times, the last time at tick 53' in stage.trouble()
    assert np.linalg.norm(errors_of(stage, wrong, np.zeros(3))[:3]) < 1e-9


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


def test_a_filter_that_restarts_gives_w_not_below_zero():
    stage = stage_of(attitude_scenario({}, attitude_filter={'restart_after': 2}))
    half = (0.6, 0.0, 0.0, -0.8, 0.0, 0.0, 0.0)
    found = [stage.step(tick, half)[0] for tick in range(5)]
    assert 'it was restarted' in stage.trouble()
    assert min(attitude[3] for attitude in found) >= 0.0
    np.testing.assert_allclose(found[-1][:4], [-0.6, 0.0, 0.0, 0.8], atol=0.01)


def test_of_missing_ticks_the_rate_is_held_and_it_may_begin_at_any_tick():
    flown = attitude_scenario({'latency_ticks': 2})
    first, gapped, later = (stage_of(flown) for _ in range(3))
    row = (0.0, 0.0, 0.0, 0.0, 0.01, 0.02, -0.03)
    for tick in range(20):
        whole = first.step(tick, row)
        assert later.step(1001 + tick, row) == whole
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
