# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The linear plant beside two-body truths: exact orbits, growth of the error, Basilisk."""

from dataclasses import replace
from importlib.util import find_spec
from itertools import pairwise

import numpy as np
import pytest
from invoking import invoke

from rpo.analysis import basilisk, truth
from rpo.training.config import load_start
from rpo_core.attitude.target import Target
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.scenario.scenario import load_scenario
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.world import cw

SCIPY, BASILISK = {'SciPy': truth.by_scipy}, {'Basilisk': basilisk.by_basilisk}
SHORT = replace(load_scenario('paper_test'), duration_s=8.0)


def masses(scenario):
    return np.full(scenario.ticks, scenario.mass_kg)


def test_a_chaser_on_its_own_circular_orbit_stays_on_it():
    """On a circle 1 km higher it runs away at the difference of mean motions: exact geometry."""
    n, radius = SHORT.mean_motion_rad_s, SHORT.orbit_radius_m
    high = radius + 1000.0
    other = cw.mean_motion(high)
    start = (1000.0, 0.0, 0.0), (0.0, (other - n) * high, 0.0)
    scenario = replace(SHORT, initial_position_m=start[0], initial_velocity_m_s=start[1])
    states = truth.by_scipy(scenario, np.zeros((scenario.ticks, 3)), masses(scenario))
    angle = (other - n) * scenario.duration_s
    expected = high * np.cos(angle) - radius, high * np.sin(angle)
    np.testing.assert_allclose(states[-1, :2], expected, rtol=0, atol=2e-9)


def test_gravity_by_encke_is_the_difference_of_two_pulls():
    target, offset = np.array([6.678e6, 0.0, 0.0]), np.array([3e5, -2e5, 1e5])

    def pull(r):
        return -cw.MU_EARTH_M3_S2 * r / np.linalg.norm(r) ** 3

    expected = pull(target + offset) - pull(target)
    np.testing.assert_allclose(truth.encke(offset, target), expected, rtol=1e-12)


@pytest.mark.parametrize('matrix', [np.eye(3), [[0.9, 0.1, 0.0], [0.0, 1.1, 0.0], [0.0, 0.2, 1.0]]])
def test_close_to_the_target_the_plant_is_right(matrix):
    """Errors of the second order, with forces and disturbance: 70 m away, micrometres in 8 s.

    The forces are those of thrusters with errors, two ticks late.
    """
    scenario = SHORT.equipped(Thrusters(tuple(map(tuple, np.array(matrix).tolist())), 2))
    flight = fly(scenario, load_controller('handmade'))
    forces = flight.thrust.forces_n + flight.disturbances_n[:-1]
    expected = flight.saturated_forces_n @ np.transpose(matrix) + flight.disturbances_n[:-1]
    np.testing.assert_allclose(forces, expected, rtol=1e-15)
    errors = np.abs(flight.states - truth.by_scipy(scenario, forces, masses(scenario))).max(axis=0)
    assert (errors[:3] < 1e-5).all() and (errors[3:] < 1e-6).all()
    assert np.abs(flight.states[-1] - flight.states[0]).max() > 1.0
    wrong = forces * [-1.0, 1.0, 1.0]  # a sign gone wrong costs centimetres
    other = truth.by_scipy(scenario, wrong, masses(scenario))
    assert np.abs(flight.states - other).max() > 0.01


def test_the_error_grows_with_the_square_of_the_distance():
    for (near_m, near), (far_m, far) in pairwise(truth.drift_errors(SHORT, 400.0).items()):
        np.testing.assert_allclose(far / near, (far_m / near_m) ** 2, rtol=0.01)


def test_a_chaser_that_must_dock_turned_drifts_like_any_other():
    """Its requirements of attitude are none of a drift."""
    docking, plain = load_scenario('tumbling_docking'), load_scenario('approach')
    found, expected = (truth.drift_errors(s, 100.0) for s in (docking, plain))
    np.testing.assert_array_equal(list(found.values()), list(expected.values()))


@pytest.mark.slow
def test_the_command_prints_both_tables(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = tmp_path / 'truth.md'
    page.write_text('# Truth\n')
    arguments = ['truth', 'quick', '--write', str(page)]
    result = invoke(*arguments)
    assert result.exit_code == 0, result.output
    assert 'linear − SciPy, position' in result.output
    assert '3000 m' in result.output and '|' not in result.output  # a table, not its Markdown
    text = page.read_text()
    assert text.startswith('# Truth\n') and '| 3000 m |' in text


@pytest.mark.slow
def test_basilisk_flies_what_scipy_flies():
    if find_spec('Basilisk') is None:
        pytest.skip('Basilisk (layer truth) is not installed')
    flight = fly(load_scenario('paper_test'), load_start('trained'))
    found = truth.compare(flight, {**BASILISK, **SCIPY})
    assert list(found.errors) == ['Basilisk', 'SciPy']
    assert found.disagreement_m < 1e-7
    for errors in found.errors.values():
        assert 1e-6 < np.linalg.norm(errors[-1, :3]) < 1e-4


WORLDS = ('world_leo', 'world_elliptic', 'world_moon')


@pytest.mark.parametrize('world', WORLDS)
def test_a_true_world_is_that_of_scipy(world):
    """Pulses, falling mass, J2, drag: the states of the plant in 20 s."""
    flight = fly(replace(load_scenario(world), duration_s=20.0), load_controller('pd'))
    found = truth.compare(flight, SCIPY)
    errors = np.abs(found.errors['SciPy']).max(axis=0)
    assert (errors[:3] < 1e-9).all() and (errors[3:] < 1e-10).all()
    assert found.plant == 'two_body'


@pytest.mark.slow
@pytest.mark.parametrize('world', WORLDS)
def test_basilisk_flies_the_true_worlds(world):
    """Within 1e-5 m over 400 s; drag is not in this truth."""
    if find_spec('Basilisk') is None:
        pytest.skip('Basilisk (layer truth) is not installed')
    scenario = load_scenario(world)
    scenario = scenario.equipped(replace(scenario.dynamics, drag=None))
    found = truth.compare(fly(scenario, load_start('trained')), BASILISK)
    assert np.linalg.norm(found.errors['Basilisk'][:, :3], axis=1).max() < 1e-5


TUMBLE = Target(
    kind='tumble',
    attitude=(0.1, 0.2, -0.3, 0.9),
    rates_deg_s=(3.5, 9.3, 6.0),  # 11.6 deg/s together
    inertia_kg_m2=((10.0, 0.5, 0.0), (0.5, 14.0, 0.3), (0.0, 0.3, 20.0)),
)


@pytest.mark.parametrize(
    ('target', 'most_rad'),
    [(TUMBLE, 1e-11), (Target(kind='spin', axis=(1.0, 2.0, 3.0), rate_deg_s=3.0), 1e-11)],
)
def test_a_target_turns_as_the_truths_say(target, most_rad):
    turning = replace(load_scenario('paper_test'), duration_s=400.0).equipped(target)
    theirs = truth.attitude_by_scipy(turning)
    assert truth.attitude_error_rad(turning, theirs) < most_rad
    slower = turning.equipped(replace(target, attitude=(0.1, 0.2, -0.3, 0.8)))
    assert truth.attitude_error_rad(slower, theirs) > 0.01
    if find_spec('Basilisk') is not None:
        assert truth.attitude_error_rad(turning, basilisk.attitude_by_basilisk(turning)) < 1e-8
