# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What sensors measure: sizes of the errors, times, and all of it a function of the tick."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from nav_scenarios import LIDAR, attitude_scenario, make
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from rpo_core.wire import interfaces
from rpo_kernels import noise
from rpo_nav.attitude_sensors import AttitudeSensors, AttitudeSensorsStage, StarTracker
from rpo_nav.navigation_errors import Navigation
from rpo_nav.sensor_kernels import across
from rpo_nav.sensors import Sensor, Sensors, SensorsStage

FAR = (60.0, -80.0, 0.0, 0.1, 0.2, 0.3)  # 100 m


def measured(unit, ticks=4000, state=FAR, key=7, more=()):
    """Return the measurements (ticks, 24) of a chaser that stays where it is."""
    flown = make([unit, *more], key=key, ticks=4000, estimator=None)
    stage = SensorsStage(flown.section(Sensors), flown)
    return np.array([stage.step(tick, state)[0] for tick in range(ticks)])


def came(rows):
    """Return which measurements came."""
    return rows[:, 6] >= 0.0


def test_a_navigation_of_no_errors_says_the_true_state_and_cannot_be_changed():
    assert Navigation().solution(7, FAR) == FAR
    assert hash(Navigation()) == hash(Navigation())


def test_the_noise_of_a_lidar_grows_with_range_along_and_across():
    unit = {**LIDAR, 'noise_share': 0.01, 'bearing_noise_rad': 0.003, 'noise_floor_m': 0.02}
    for state, sigmas in ((FAR, (1.0, 0.3)), ((0.3, -0.4, *[0.0] * 4), (0.02, 0.02))):
        errors = measured(unit, state=state)[:, :3] - state[:3]
        u = np.array(state[:3]) / np.linalg.norm(state[:3])
        side = np.array([-u[1], u[0], 0.0])
        for axis, sigma in ((u, sigmas[0]), (side, sigmas[1]), ([0, 0, 1], sigmas[1])):
            found = errors @ axis
            assert kstest(found / sigma, 'norm').pvalue > 1e-3
            assert abs((found[1:] * found[:-1]).mean()) < 4.0 * sigma**2 / np.sqrt(len(found))


def test_the_message_has_the_covariance_that_the_sensor_claims():
    rows = measured({**LIDAR, 'bearing_noise_rad': 0.003})
    claimed = rows[:, 6:15].reshape(-1, 3, 3).mean(axis=0)
    assert np.allclose(claimed, np.cov((rows[:, :3] - FAR[:3]).T), atol=0.06)
    assert (rows[:, 15] == -1.0).all()  # no velocity


def test_position_and_velocity_by_axis():
    unit = {
        'kind': 'relative_position', 'noise_share': 0.01, 'velocity_floor_m_s': 1e-4,
        'velocity_share_1_s': 1e-4,
    }  # fmt: skip
    rows = measured(unit)
    errors = rows[:, :6] - FAR
    assert np.allclose(errors.std(axis=0), [1.0] * 3 + [0.01] * 3, rtol=0.05)
    assert np.allclose(np.corrcoef(errors.T), np.eye(6), atol=0.07)
    assert np.allclose(rows[:, [15, 19, 23]].mean(axis=0), 1e-4, rtol=0.05)
    first, second = (noise.philox(9, block, 1, 0, 7, 1) for block in range(2))
    draws = (noise.normal_pair(*first[2:])[1], *noise.normal_pair(*second[:2]))
    assert np.allclose(errors[9, 3:], 0.01 * np.array(draws))


def test_a_camera_measures_a_direction():
    rows = measured({'kind': 'bearing', 'bearing_noise_rad': 0.001})
    assert np.allclose(np.linalg.norm(rows[:, :3], axis=1), 1.0)
    assert (rows[:, :3] @ np.array([0.8, 0.6, 0.0])).std() == pytest.approx(0.001, rel=0.05)


def test_bias_scale_and_walk():
    still = {'kind': 'relative_position', 'noise_floor_m': 1e-9}
    rows = measured({**still, 'bias_m': [0.1, 0.2, -0.3], 'scale_error': 0.01}, ticks=5)
    expected = np.add(FAR[:3], [0.1, 0.2, -0.3]) * 1.01
    assert np.allclose(rows[:, :3], expected, atol=1e-6)
    ends = [
        measured({**still, 'bias_walk_m_s0_5': 0.5}, ticks=91, key=key)[90, :3] - FAR[:3]
        for key in range(300)
    ]
    assert np.std(ends) == pytest.approx(0.5 * np.sqrt(9.1), rel=0.08)


def test_the_walk_is_a_function_of_the_tick():
    flown = make([{**LIDAR, 'bias_walk_m_s0_5': 0.5}], estimator=None)
    stages = [SensorsStage(flown.section(Sensors), flown) for _ in range(2)]
    whole = [stages[0].step(tick, FAR) for tick in range(50)]
    assert stages[1].step(49, FAR) == whole[49]


@pytest.mark.parametrize('latency', [0, 4])
def test_period_latency_and_dropouts(latency):
    unit = {**LIDAR, 'period_ticks': 3, 'latency_ticks': latency, 'dropout_share': 0.25}
    rows = measured(unit)
    due = (np.arange(len(rows)) - latency) % 3 == 0
    due[:latency] = False
    assert not came(rows)[~due].any()
    assert came(rows)[due].mean() == pytest.approx(0.75, abs=0.05)
    nothing = [0.0] * 6 + [-1.0] + [0.0] * 8 + [-1.0] + [0.0] * 8
    assert (rows[~came(rows)] == nothing).all()


def test_what_comes_late_was_measured_before():
    flown = make([{**LIDAR, 'latency_ticks': 4}], estimator=None)
    prompt = make([LIDAR], estimator=None)
    late, now = (SensorsStage(f.section(Sensors), f) for f in (flown, prompt))
    states = [tuple(value + tick for value in FAR) for tick in range(20)]
    rows = [late.step(tick, state)[0] for tick, state in enumerate(states)]
    assert rows[4:] == [now.step(tick, state)[0] for tick, state in enumerate(states[:16])]
    again = SensorsStage(flown.section(Sensors), flown)  # its memory is as deep as it says
    again.reset()
    found = [again.step(tick, states[tick])[0] for tick in range(10, 20)]
    assert found[again.memory_ticks :] == rows[14:]


def test_what_a_tick_that_was_left_out_would_have_measured_never_comes():
    flown = make([{**LIDAR, 'latency_ticks': 4}], estimator=None)
    stage = SensorsStage(flown.section(Sensors), flown)
    rows = np.array([stage.step(tick, FAR)[0] for tick in (*range(10), *range(16, 21))])
    assert came(rows).tolist() == [False] * 4 + [True] * 6 + [False] * 4 + [True]


def test_field_of_view_and_outages():
    ahead = {**LIDAR, 'boresight': [3.0, 4.0, 12.0], 'field_of_view_rad': 0.5}
    b, first = np.array([3.0, 4.0, 12.0]) / 13.0, np.array([4.0, -3.0, 0.0]) / 5.0
    for side in (first, np.cross(b, first)):
        for angle in (0.45, 0.55, -0.45, -0.55, np.pi):
            to_target = np.cos(angle) * b + np.sin(angle) * side
            rows = measured(ahead, 3, (*(-100.0 * to_target), 0, 0, 0))
            assert (came(rows) == (abs(angle) < 0.5)).all()
    outages = [[[1.0, 2.0], [2.5, 3.01]], [[0.1, 99.0]]]
    flown = make([{**LIDAR, 'outages_s': some} for some in outages], estimator=None)
    stage = SensorsStage(flown.section(Sensors), flown)
    rows = np.array([stage.step(tick, FAR) for tick in range(40)])
    assert np.flatnonzero(~came(rows[:, 0])).tolist() == [*range(10, 20), *range(25, 31)]
    assert np.flatnonzero(~came(rows[:, 1])).tolist() == [*range(1, 40)]


def test_outliers():
    rows = measured({**LIDAR, 'outlier_share': 0.1, 'outlier_size_m': 50.0})
    errors = rows[:, :3] - FAR[:3]
    far = np.abs(errors).max(axis=1) > 6.0
    assert far.mean() == pytest.approx(0.1, abs=0.02)
    assert np.allclose(errors[far].std(axis=0), 50.0, rtol=0.15)


def test_keys_and_sensors_are_independent():
    first, other = measured(LIDAR, key=1), measured(LIDAR, key=2)
    assert np.array_equal(first, measured(LIDAR, key=1))
    assert abs(np.corrcoef(first[:, 0], other[:, 0])[0, 1]) < 0.06
    unkeyed, keyed = Sensors((Sensor(**LIDAR),)), Sensors((Sensor(**LIDAR),), (0, 0))
    assert unkeyed == keyed
    flown = make([LIDAR, LIDAR], estimator=None)
    stage = SensorsStage(flown.section(Sensors), flown)
    pairs = np.array([stage.step(tick, FAR) for tick in range(2000)])
    assert abs(np.corrcoef(pairs[:, 0, 0], pairs[:, 1, 0])[0, 1]) < 0.08
    assert pairs.shape[2] == len(interfaces.row_of('measurement_2').columns)


def test_the_frame_of_the_line_of_sight_is_right_handed():
    rng = np.random.default_rng(3)
    rows = [*rng.normal(size=(200, 3)), *np.eye(3), *-np.eye(3)]
    for u in (row / np.linalg.norm(row) for row in rows):
        first, second = map(np.array, across(*u.tolist()))
        frame = np.column_stack([u, first, second])
        assert np.allclose(frame.T @ frame, np.eye(3))
        assert np.allclose(np.cross(u, first), second)


DIGEST = """
import hashlib, numpy as np
from nav_scenarios import LIDAR, PD, attitude_scenario, make
from rpo_kernels import jit
from rpo_core.chain.flight import fly
units = [
    {**LIDAR, 'latency_ticks': 2, 'dropout_share': 0.1, 'outlier_share': 0.02,
     'outlier_size_m': 9.0},
    {'kind': 'relative_position', 'velocity_floor_m_s': 0.01, 'period_ticks': 5,
     'noise_floor_m': 0.3, 'bias_walk_m_s0_5': 0.01, 'field_of_view_rad': 2.0},
    {'kind': 'bearing', 'bearing_noise_rad': 0.001, 'period_ticks': 2, 'latency_ticks': 1},
]
camera = {'units': [{**LIDAR, 'body_fixed': True, 'latency_ticks': 1}]}
turning = attitude_scenario({'latency_ticks': 2}, sensors=camera, estimator={})
found = hashlib.sha256()
for scenario in (make(units, estimator={'disturbance_sigma_n': 0.01}), turning):
    flight = fly(scenario, PD)
    found.update(flight.states.tobytes())
    for name in sorted(flight.signals):
        found.update(flight.signals[name].tobytes())
print(jit.COMPILED, found.hexdigest())
"""


@pytest.mark.every_landing
def test_interpreted_and_compiled_bits_are_the_same():
    pytest.importorskip('numba')
    said = []
    for choice in '01':
        variables = {**os.environ, 'RPO_JIT': choice, 'PYTHONPATH': os.pathsep.join(sys.path)}
        done = subprocess.run(
            [sys.executable, '-c', DIGEST], env=variables, cwd=Path(__file__).parent,
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        said.append(done.stdout.split())
    assert [compiled for compiled, _ in said] == ['False', 'True']
    assert said[0][1] == said[1][1]


# What a star tracker and a gyro measure: sizes of the errors, times, blinding; bad input.

TURNED = Rotation.from_euler('xyz', [20.0, -30.0, 50.0], degrees=True)
STILL = (*TURNED.as_quat(canonical=True).tolist(), 0.01, -0.02, 0.03)


def attitude_measured(ticks=4000, attitude=STILL, key=7, **star):
    """Return the measurements (ticks, 7) of a chaser that keeps its attitude."""
    flown = attitude_scenario(star, key=key)
    stage = AttitudeSensorsStage(flown.section(AttitudeSensors), flown)
    return np.array([stage.step(tick, attitude)[0] for tick in range(ticks)])


def stars_came(rows):
    """Return at which ticks the star tracker attitude_measured."""
    return np.flatnonzero(rows[:, :4].any(axis=1)).tolist()


def test_the_noise_is_as_large_across_the_boresight_and_about_it_as_it_says():
    rows = attitude_measured()
    errors = (TURNED.inv() * Rotation.from_quat(rows[:, :4])).as_rotvec(degrees=True) * 3600.0
    axes = np.array(attitude_scenario().section(AttitudeSensors).star_tracker.axes)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(axes[0], np.array([1.0, 2.0, -0.5]) / np.sqrt(5.25))
    for axis, sigma in zip(axes, (60.0, 10.0, 10.0), strict=True):
        found = errors @ axis / sigma
        assert kstest(found, 'norm').pvalue > 1e-3
        assert abs((found[1:] * found[:-1]).mean()) < 4.0 / np.sqrt(len(found))
    assert (rows[:, 3] >= 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(rows[:, :4], axis=1), 1.0)


def test_the_gyro_has_white_noise_and_a_bias_that_walks():
    rows = attitude_measured()
    steps = np.diff(rows[:, 4:], axis=0)  # of white noise twice its variance; and of the walk
    white, walk = 2e-5 / np.sqrt(0.1), 1e-6 * np.sqrt(0.1)
    np.testing.assert_allclose(steps.std(axis=0), np.sqrt(2.0 * white**2 + walk**2), rtol=0.05)
    runs = np.array([attitude_measured(401, key=key)[[0, 400], 4:] for key in range(300)])
    bias = np.array([3e-5, -5e-5, 2e-5]) + STILL[4:]
    np.testing.assert_allclose(runs[:, 0].mean(axis=0), bias, atol=4.0 * white / np.sqrt(300))
    walked = np.sqrt(2.0 * white**2 + (1e-6) ** 2 * 40.0)
    np.testing.assert_allclose((runs[:, 1] - runs[:, 0]).std(axis=0), walked, rtol=0.1)


def test_the_bias_is_a_function_of_the_tick():
    flown = attitude_scenario()
    whole, other = (AttitudeSensorsStage(flown.section(AttitudeSensors), flown) for _ in range(2))
    rows = [whole.step(tick, STILL) for tick in range(50)]
    assert other.step(49, STILL) == rows[49]
    other.reset()
    assert other.step(0, STILL) == rows[0]


@pytest.mark.parametrize('latency', [0, 4])
def test_period_latency_and_outages(latency):
    outages = [[1.0, 2.0], [2.5, 3.01]]
    rows = attitude_measured(60, period_ticks=3, latency_ticks=latency, outages_s=outages)
    blind = {*range(10, 20), *range(25, 31)}
    due = [tick + latency for tick in range(0, 60, 3) if tick not in blind]
    assert stars_came(rows) == [tick for tick in due if tick < 60]


def test_an_attitude_that_comes_late_was_measured_before():
    late, now = (attitude_measured(20, latency_ticks=latency) for latency in (4, 0))
    assert np.array_equal(late[4:, :4], now[:16, :4])
    assert np.array_equal(late[:, 4:], now[:, 4:])  # the gyro is not late


def test_an_attitude_of_a_tick_that_was_left_out_never_comes():
    flown = attitude_scenario({'latency_ticks': 4})
    stage = AttitudeSensorsStage(flown.section(AttitudeSensors), flown)
    rows = np.array([stage.step(tick, STILL)[0] for tick in (*range(10), *range(16, 21))])
    assert stars_came(rows) == [*range(4, 10), 14]


def test_a_light_blinds_within_its_angle():
    """The boresight 40 and 60 degrees from the Earth, whose disk has a half angle of 50."""
    light = {'light': [-2.0, 0.0, 0.0], 'light_deg': 50.0, 'boresight': [0.0, 0.0, 3.0]}
    for degrees, sees in ((40.0, False), (49.9, False), (50.1, True), (60.0, True)):
        for about in (0.0, 77.0):  # of an attitude about the boresight nothing depends
            q = Rotation.align_vectors(
                [[-np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0.0]],
                [[0.0, 0.0, 1.0]],
            )[0] * Rotation.from_euler('z', about, degrees=True)
            rows = attitude_measured(3, (*q.as_quat(canonical=True), 0.0, 0.0, 0.0), **light)
            assert len(stars_came(rows)) == (3 if sees else 0)


def test_the_defaults_are_those_of_an_ordinary_star_tracker():
    assert StarTracker().axes[0] == (0.0, 0.0, 1.0)
