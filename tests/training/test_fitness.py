# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Fitness against the core's figures, and the least energy against an independent optimum."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import yaml
from invoking import invoke

from rpo.analysis.optimal import least_energy
from rpo.engine.population import population_of
from rpo.engine.search import Simulator
from rpo.scoring import fitness
from rpo.scoring.fitness import Fitness, FitnessSettings, excess
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.judge import metrics
from rpo_core.judge.metrics import LATE_POSITION, LATE_SPEED
from rpo_core.scenario import scenario as scenarios
from rpo_core.scenario.scenario import load_set
from rpo_core.world.starts import Grid

TRAINING = load_set('paper_training')
SMALL = replace(TRAINING, starts=Grid.cube((-50.0, 100.0)))
HANDMADE = load_controller('handmade')


def score(settings, controller=HANDMADE, scenarios=SMALL):
    fitness = Fitness(scenarios, settings, 1)
    with fitness.simulator:
        return fitness.score(population_of(controller))


def test_the_flat_fitness_is_the_papers():
    figures = [metrics.of_flight(fly(scenario, HANDMADE)) for scenario in SMALL.scenarios()]
    scores = score(FitnessSettings())
    assert scores.fitness[0] == pytest.approx(np.mean([f.fitness for f in figures]), rel=1e-12)
    missed = np.array([[not held for held in f.conditions] for f in figures]).sum(axis=0)
    assert scores.failures[0].tolist() == missed.tolist()
    assert missed.any(), 'the test must see a penalty'


def test_excess_grows_from_zero_at_the_limit():
    values = excess(np.array([0.5, 1.0, 2.0, 16.0, 1e12]), 1.0)
    np.testing.assert_allclose(values, [0.0, 0.0, 1.0 - 2.0**-0.25, 0.5, 0.999], rtol=1e-12)


@pytest.mark.parametrize(
    'terms',
    [
        {'limit_cycle': 5.0},
        {'tests': 5.0},
        {'robustness': 5.0},
        {'mass_kg': (30.0,)},
        {'between': 2},
    ],
)
def test_optional_terms_see_what_the_papers_fitness_does_not(terms):
    """A heavy velocity scale swings for ever or arrives late: the terms must cost something."""
    poor = replace(HANDMADE, position_scale_m=25.0, velocity_scale_m_s=2.0)
    assert (
        score(FitnessSettings(**terms), poor).fitness[0] > score(FitnessSettings(), poor).fitness[0]
    )


def test_flights_between_the_starts_are_random_states_in_their_box():
    """Nine flights of three planar and three vertical loops, none from a start of the training."""
    fitness = Fitness(SMALL, FitnessSettings(between=3), 1)
    training, between = fitness.simulator.cases
    positions, speeds = between.starts[:, :3], np.abs(between.starts[:, 3:])
    assert (between.starts.shape, len(np.unique(between.starts, axis=0))) == ((9, 6), 9)
    assert [len(np.unique(positions[:, axis])) for axis in range(3)] == [3, 3, 3]
    assert (positions >= training.starts[:, :3].min(axis=0)).all()
    assert (positions <= training.starts[:, :3].max(axis=0)).all()
    assert not set(map(tuple, between.starts)) & set(map(tuple, training.starts))
    assert 0.0 < speeds.max() <= 0.1 * np.abs(training.starts).max() / SMALL.base.duration_s
    with fitness.simulator:
        rows = fitness.simulator.fly(population_of(HANDMADE))[1][0]
    scenario = next(s for i, s in enumerate(between.scenarios()) if i == 5)
    np.testing.assert_array_equal(rows[5], metrics.row_of(fly(scenario, HANDMADE), between.windows))


def test_the_corner_flights_are_those_of_the_core():
    """Late position and speed of a few; no two flights are the same."""
    for case, share in zip(fitness.corner_cases(), fitness.CORNER_MASS_SHARES, strict=True):
        scenarios = fitness.corner_flights(share)
        assert len(set(scenarios)) == len(case.starts) == 32
        simulator = Simulator([case], 1)
        (figures,) = simulator.fly(population_of(HANDMADE))
        for index in (0, 13, 31):
            flight = fly(scenarios[index], HANDMADE)
            late = metrics.window(flight, metrics.CLAIM_WINDOW_S)
            assert figures[0, index, LATE_POSITION] == late.position_m
            last = metrics.window_ticks(flight.scenario, metrics.CLAIM_WINDOW_S)
            speed = np.linalg.norm(np.abs(flight.velocities_m_s[-last:]).max(axis=0))
            assert figures[0, index, LATE_SPEED] == pytest.approx(speed, rel=1e-12)


def test_the_least_energy_is_the_gramians():
    """Against the continuous Gramian by van Loan's exponential; held forces cost a little more."""
    scenario, starts = TRAINING.base, TRAINING.initial_positions_m
    n, m, t = scenario.mean_motion_rad_s, scenario.mass_kg, scenario.duration_s
    a = np.zeros((6, 6))
    a[:3, 3:] = np.eye(3)
    a[3, 0], a[3, 4], a[4, 3], a[5, 2] = 3 * n * n, 2 * n, -2 * n, -n * n
    b = np.vstack([np.zeros((3, 3)), np.eye(3) / m])
    expm = scipy.linalg.expm(np.block([[-a, b @ b.T], [np.zeros((6, 6)), a.T]]) * t)
    gramian = expm[6:, 6:].T @ expm[:6, 6:]
    states = np.hstack([starts, np.zeros_like(starts)])
    drift = states @ expm[6:, 6:]
    continuous = np.einsum('ij,ij->i', drift, np.linalg.solve(gramian, drift.T).T)
    least = least_energy(scenario, states)
    np.testing.assert_allclose(least, continuous, rtol=1e-5)
    assert (least >= continuous * (1.0 - 1e-9)).all()
    assert least.mean() == pytest.approx(1.901, abs=1e-3)
    assert least[-1] == pytest.approx(4.545, abs=1e-3)


def evaluate(*arguments):
    return invoke('evaluate', *arguments)


def test_a_scenario_judges_any_controller_by_its_requirements(tmp_path):
    document = yaml.safe_load(scenarios.dumps(replace(SMALL.base, duration_s=20.0)))
    document['requirements'] = {'final_error_norm_m': 16.0, 'energy_n2s': 1e-9}
    del document['initial_position_m']
    document |= {'schema': scenarios.SET_SCHEMA, 'initial_position_axis_m': [5.0, 10.0]}
    mine = tmp_path / 'mine.yaml'
    mine.write_text(yaml.safe_dump(document))
    told = evaluate('drift', 'allround', '--scenario', str(mine))
    assert told.exit_code == 1, told.output
    lines = [' '.join(line.split()) for line in told.output.splitlines()]
    # drifting, only the start [10, 10, 10] is farther than 16 m after 20 s
    drift, _, energy, trained_energy = (
        *(line for line in lines if 'norm' in line),
        *(line for line in lines if 'energy J' in line),
    )
    assert drift.endswith('17.3 m 1 of 8 MISSED')
    assert energy.endswith('0 N²s 0 of 8 holds')
    assert trained_energy.endswith('8 of 8 MISSED')
    assert evaluate('allround', '--scenario', 'paper_test').exit_code == 0


def test_the_weight_of_an_error_multiplies_the_penalties_of_error_and_arrival_alone():
    plain, heavy = (FitnessSettings(error_weight=weight) for weight in (1.0, 3.0))
    values = np.full((1, 2, 3), 1e3)  # everything is missed
    for settings, late in ((plain, 1.0), (heavy, 3.0)):
        fitness = Fitness(SMALL, settings, 1)
        labels = fitness.conditions.labels
        assert sorted(labels) == ['arrival', 'slew', 'speed']
        with fitness.simulator:
            found = fitness._penalties(values)
        assert found.tolist() == [[settings.penalty_n2s * (2.0 + late)] * 2]
