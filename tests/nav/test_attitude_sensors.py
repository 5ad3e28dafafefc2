# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a star tracker and a gyro measure: sizes of the errors, times, blinding; bad input."""

from __future__ import annotations

import numpy as np
import pytest
from nav_scenarios import attitude_scenario
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from rpo_core.files.validation import InputError
from rpo_nav.attitude_sensors import ARCSEC, AttitudeSensors, AttitudeSensorsStage, StarTracker

TURNED = Rotation.from_euler('xyz', [20.0, -30.0, 50.0], degrees=True)
STILL = (*TURNED.as_quat(canonical=True).tolist(), 0.01, -0.02, 0.03)


def measured(ticks=4000, attitude=STILL, key=7, **star):
    """Return the measurements (ticks, 7) of a chaser that keeps its attitude."""
    flown = attitude_scenario(star, key=key)
    stage = AttitudeSensorsStage(flown.section(AttitudeSensors), flown)
    return np.array([stage.step(tick, attitude)[0] for tick in range(ticks)])


def came(rows):
    """Return at which ticks the star tracker measured."""
    return np.flatnonzero(rows[:, :4].any(axis=1)).tolist()


def test_the_noise_is_as_large_across_the_boresight_and_about_it_as_it_says():
    rows = measured()
    errors = (TURNED.inv() * Rotation.from_quat(rows[:, :4])).as_rotvec() / ARCSEC
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
    rows = measured()
    steps = np.diff(rows[:, 4:], axis=0)  # of white noise twice its variance; and of the walk
    white, walk = 2e-5 / np.sqrt(0.1), 1e-6 * np.sqrt(0.1)
    np.testing.assert_allclose(steps.std(axis=0), np.sqrt(2.0 * white**2 + walk**2), rtol=0.05)
    runs = np.array([measured(401, key=key)[[0, 400], 4:] for key in range(300)])
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
    rows = measured(60, period_ticks=3, latency_ticks=latency, outages_s=outages)
    blind = {*range(10, 20), *range(25, 31)}
    due = [tick + latency for tick in range(0, 60, 3) if tick not in blind]
    assert came(rows) == [tick for tick in due if tick < 60]


def test_what_comes_late_was_measured_before():
    late, now = (measured(20, latency_ticks=latency) for latency in (4, 0))
    assert np.array_equal(late[4:, :4], now[:16, :4])
    assert np.array_equal(late[:, 4:], now[:, 4:])  # the gyro is not late


def test_a_light_blinds_within_its_angle():
    """The boresight 40 and 60 degrees from the Earth, whose disk has a half angle of 50."""
    light = {'light': [-2.0, 0.0, 0.0], 'light_deg': 50.0, 'boresight': [0.0, 0.0, 3.0]}
    for degrees, sees in ((40.0, False), (49.9, False), (50.1, True), (60.0, True)):
        for about in (0.0, 77.0):  # of an attitude about the boresight nothing depends
            q = Rotation.align_vectors(
                [[-np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0.0]],
                [[0.0, 0.0, 1.0]],
            )[0] * Rotation.from_euler('z', about, degrees=True)
            rows = measured(3, (*q.as_quat(canonical=True), 0.0, 0.0, 0.0), **light)
            assert len(came(rows)) == (3 if sees else 0)


@pytest.mark.parametrize(
    ('changes', 'sentence'),
    [
        ({'star': {'boresight': [0, 0, 0]}}, '`boresight` must have a direction'),
        ({'star': {'light': [0, 0, 0]}}, '`light` must have a direction'),
        ({'star': {'cross_noise_arcsec': 0.0}}, '`cross_noise_arcsec` must be a finite number > 0'),
        ({'star': {'outages_s': [[2.0, 1.0]]}}, 'star_tracker: `outages_s[0][1]` must be'),
        ({'gyro': {'noise_rad_s0_5': -1.0}}, '`noise_rad_s0_5` must be a finite number >= 0'),
        ({'attitude': None}, '`attitude_sensors` must have an attitude to measure'),
        ({'attitude_sensors': None}, '`attitude_sensors` is missing'),
        ({'attitude_filter': {'attitude_sigma_deg': 0.0}}, '`attitude_sigma_deg` must be a finite'),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(changes, sentence):
    with pytest.raises(InputError, match=r'^[^\n]*$') as error:
        attitude_scenario(**changes)
    assert sentence in str(error.value)


def test_the_defaults_are_those_of_an_ordinary_star_tracker():
    assert StarTracker().axes[0] == (0.0, 0.0, 1.0)
