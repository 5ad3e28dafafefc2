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
from rpo.scoring.fitness import Fitness, FitnessSettings, excess
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.judge import metrics
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
