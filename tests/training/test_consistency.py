# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How consistent the estimators of the shipped worlds are, and the command that prints it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from invoking import invoke

from rpo.analysis.consistency import (
    Consistency,
    as_configured,
    attitude_consistency,
    consistency,
    in_its_world,
)
from rpo_core.attitude.chaser import Chaser
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_core.navigation.attitude_estimator import AttitudeEstimator
from rpo_core.navigation.attitude_sensors import AttitudeSensors, Gyro, StarTracker
from rpo_core.navigation.estimator import Estimator
from rpo_core.navigation.sensors import Sensors
from rpo_core.scenario import scenario as scenario_file
from rpo_core.scenario.scenario import load_scenario

WORLDS = ('world_leo', 'world_elliptic', 'world_moon')

TUMBLING = load_scenario('approach').equipped(
    Chaser(
        inertia_kg_m2=((2.0, 0.1, 0.0), (0.1, 1.5, 0.05), (0.0, 0.05, 1.0)),
        attitude=(0.1, -0.2, 0.3, 0.9),
        rates_deg_s=(1.5, -1.0, 2.0),
    ),
    AttitudeSensors(
        star_tracker=StarTracker(boresight=(1.0, 2.0, -0.5), period_ticks=5, latency_ticks=2),
        gyro=Gyro(noise_rad_s0_5=2e-5, bias_walk_rad_s1_5=1e-6),
    ),
    AttitudeEstimator(),
)


@pytest.mark.parametrize('name', [*WORLDS, 'tumbling_docking'])
def test_the_shipped_estimators_are_consistent(name):
    """Few and short flights, bounds of 95 % for the mean over ten moments."""
    found = consistency(replace(as_configured(load_scenario(name)), duration_s=50.0), 40)
    assert found.holds, found
    assert found.correlation < 2.0 * found.correlation_bound


def test_an_estimator_that_trusts_its_sensors_too_much_is_found():
    flown = replace(as_configured(load_scenario('world_leo')), duration_s=50.0)
    wrong = replace(flown.section(Estimator), noise_scale=0.6)
    found = consistency(flown.equipped(wrong), 20)
    assert not found.holds
    assert found.nees.mean() > 8.0


@pytest.mark.every_landing
def test_in_its_world_errors_are_held_against_the_filters_own_covariance():
    """NEES of a flight by hand; in `world_leo` the filter claims more than its errors."""
    scenario, controller = load_scenario('world_leo'), load_controller('allround')
    found = in_its_world(scenario, controller, 2)
    sensors, tick = scenario.section(Sensors), 2000  # the fifth of ten moments
    expected = []
    for run in range(2):
        flight = fly(scenario.equipped(replace(sensors, noise_key=(run, 2**31))), controller)
        error = (flight.signals['navigation_state'] - flight.states)[tick, 3:]
        spread = flight.signals['navigation_covariance'][tick, 9:].reshape(3, 3)
        expected.append(error @ np.linalg.inv(spread) @ error)
    assert found['velocity'][4] == pytest.approx(np.mean(expected), rel=1e-9)
    assert found['velocity'].mean() < 2.0
    assert found['position'].mean() < 3.0


@pytest.mark.parametrize('outage', [False, True])
@pytest.mark.parametrize(
    ('flown', 'runs'),
    [
        (replace(TUMBLING, duration_s=100.0), 100),
        pytest.param(replace(TUMBLING, duration_s=400.0), 1000, marks=pytest.mark.slow),
        pytest.param(load_scenario('tumbling_docking'), 1000, marks=pytest.mark.slow),
    ],
)
def test_an_attitude_filter_is_consistent(flown, runs, outage):
    found = attitude_consistency(flown, runs, outage=outage)
    assert found.holds, found
    if runs == 1000:
        assert 5.79 <= found.nees.mean() <= 6.21
        return
    assert found.correlation < 2.0 * found.correlation_bound
    measured = [0 <= tick < 350 or tick >= 650 for tick in range(0, 999, 5)]
    assert found.innovations == 100 * (sum(measured) if outage else 200)


@pytest.mark.parametrize('wrong', [0, 1, 2, 3, None])
def test_one_estimator_of_two_that_is_wrong_is_exit_code_1(wrong, tmp_path, monkeypatch):
    """Also the first one, after which all others hold."""
    told = []

    def judged(*_, **__):
        nees = 60.0 if len(told) == wrong else 6.0
        told.append(nees)
        return Consistency(np.full(10, nees), np.ones(10), 3.0, 20, 0.0, 100)

    for function in ('consistency', 'attitude_consistency'):
        monkeypatch.setattr(f'rpo.analysis.consistency.{function}', judged)
    path = tmp_path / 'short.yaml'
    path.write_text(scenario_file.dumps(replace(load_scenario('tumbling_docking'), duration_s=2.0)))
    done = invoke('evaluate', '--estimator', path, '--runs', '2')
    assert len(told) == 4 and 'As its world is' in done.stdout, done.output
    assert done.exit_code == int(wrong is not None)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize('changes', [{}, {'dropout_share': 0.1, 'latency_ticks': 3}])
def test_a_thousand_flights(changes):
    found = consistency(as_configured(load_scenario('world_leo'), **changes), 1000)
    assert np.allclose(found.nees_bounds, (5.79, 6.21), atol=0.006)
    assert 5.79 <= found.nees.mean() <= 6.21
    assert found.holds, found


def test_the_command_and_its_bad_input():
    done = invoke('evaluate', '--estimator', 'world_moon', '--runs', '2')
    assert done.exit_code == 0, done.output
    assert 'NEES of 6 states' in done.output
    assert '10 % lost' in done.output
    assert re.search(r'As its world is, .* those of velocity \d+ % smaller', done.output)
    with pytest.raises(InputError, match='must have sections `sensors` and `estimator`'):
        as_configured(load_scenario('paper_test'))
