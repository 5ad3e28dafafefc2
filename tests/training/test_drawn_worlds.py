# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Candidates judged in a world: sensors, filter, pulses; what thrust costs."""

from dataclasses import replace

import numpy as np
import pytest
from campaign_documents import write_campaign

from rpo_core.control.controller import load_controller
from rpo_core.files import scenario
from rpo_core.files.scenario import load_set
from rpo_core.files.starts import Cube
from rpo_core.files.validation import InputError
from rpo_judge.scoring.drawn import DrawnFlights, DrawnSettings
from rpo_judge.scoring.fitness import Fitness, FitnessSettings
from rpo_montecarlo.campaign import run_batch
from rpo_montecarlo.engine.population import population_of
from rpo_montecarlo.engine.simulator import Simulator
from rpo_thrusters.thrusters import Propellant, Thrusters

TRAINED, ROBUST = load_controller('trained'), load_controller('robust')
LEO = replace(scenario.load_scenario('world_leo'), duration_s=12.0)
ONE_START = replace(load_set('paper_training'), starts=Cube((50.0,)))
SPREAD = {
    'initial_position_m': {'uniform': 5.0},
    'true_anomaly_deg': {'uniform': 180.0},
    'stuck_off_thruster': {'whole': 11},
    'sensor_noise_share': {'uniform': 0.3},
}
COSTS = {'openings': 0.01, 'propellant': 50.0}


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a campaign of a scenario and returns its path."""

    def written(flown, **changes):
        path = tmp_path / 'world.yaml'
        path.write_text(scenario.dumps(flown))
        changes = {'scenario': str(path), 'dispersions': SPREAD, **changes}
        return str(write_campaign(tmp_path, **changes))

    return written


def settings_of(path, **changes):
    """Return settings with a few flights of a campaign."""
    return DrawnSettings(1.0, (path,), flights=6, pool=45, held_out=45, **changes)


def test_flights_in_a_world_have_the_bits_of_the_campaign(write):
    """Also the second time, in two threads."""
    path = write(LEO, success={'mean_error_norm_m': 1.0, 'valve_openings': 100.0})
    flights = DrawnFlights(path, settings_of(path))
    campaign, _ = flights.pool(3)
    with Simulator([flights.case(3)], 2) as simulator:
        first, *others = (*simulator.fly(population_of(ROBUST, TRAINED)), *simulator.fly(
            population_of(ROBUST, TRAINED)))  # fmt: skip
    for again in others:
        np.testing.assert_array_equal(first, again)
    for row, controller in zip(first, (ROBUST, TRAINED), strict=True):
        columns = run_batch.fly_runs(replace(campaign, controller=controller), 0, 45)
        expected = np.column_stack([columns[name] for name in campaign.config.success])
        np.testing.assert_array_equal(flights.values(row), expected)


def test_what_thrusters_spend_costs_fitness(write):
    path = write(LEO)
    drawn = settings_of(path, **COSTS)
    costly = Fitness(ONE_START, FitnessSettings(drawn=drawn), 1)
    free = Fitness(ONE_START, FitnessSettings(drawn=settings_of(path)), 1)
    campaign, _ = DrawnFlights(path, drawn).pool(0)
    with costly.simulator, free.simulator:
        for controller in (TRAINED, ROBUST):
            one = population_of(controller)
            more = costly.score(one).fitness[0] - free.score(one).fitness[0]
            columns = run_batch.fly_runs(replace(campaign, controller=controller), 0, 6)
            spent = 0.01 * columns['valve_openings'] + 50.0 * columns['propellant_kg']
            assert more == pytest.approx(spent.mean(), rel=1e-12)
            assert spent.mean() > 1.0


def test_the_better_half_is_that_of_flying_all(write):
    """Also where thrust costs, of which the flights without it say nothing."""
    drawn = settings_of(write(LEO), **COSTS)
    fitness = Fitness(ONE_START, FitnessSettings(penalty='graded', drawn=drawn), 1)
    scales = (0.8, 0.9, 1.0, 1.2, 2.0, 4.0, 8.0)
    others = [replace(ROBUST, velocity_scale_m_s=scale) for scale in scales]
    population = population_of(*others, TRAINED)
    with fitness.simulator:
        scores = fitness.score(population)
        each = [fitness.score(population.members(slice(i, i + 1))) for i in range(8)]
    expected = np.array([float(s.fitness[0]) for s in each])
    best = np.argsort(expected)[:4]
    np.testing.assert_array_equal(np.argsort(scores.fitness)[:4], best)
    np.testing.assert_array_equal(scores.fitness[best], expected[best])


NEAR = {'initial_position_m': {'uniform': 5.0}}


def test_propellant_without_pulses_costs_fitness_too(write):
    leaking = Thrusters(propellant=Propellant(specific_impulse_s=200.0, mass_kg=1.0))
    short = replace(scenario.load_scenario('approach'), duration_s=12.0).equipped(leaking)
    drawn = settings_of(write(short, dispersions=NEAR), propellant=50.0)
    flights = DrawnFlights(drawn.campaigns[0], drawn)
    with Simulator([flights.case(0, range(3))], 1) as simulator:
        (rows,) = simulator.fly(population_of(ROBUST))
    campaign = replace(flights.pool(0)[0], controller=ROBUST)
    spent = run_batch.fly_runs(campaign, 0, 3)['propellant_kg']
    np.testing.assert_array_equal(flights.cost(rows)[0], 50.0 * spent)
    assert (spent > 0.0).all()


def test_what_cannot_be_judged_is_one_sentence(write):
    path = write(scenario.load_scenario('approach'), dispersions=NEAR)
    with pytest.raises(InputError) as caught:
        Fitness(ONE_START, FitnessSettings(drawn=settings_of(path, **COSTS)), 1)
    said = '`fitness.drawn.openings` needs drawn flights'
    assert said in str(caught.value) and '\n' not in str(caught.value)


@pytest.mark.parametrize('name', ['openings', 'propellant'])
def test_a_cost_is_not_negative(name):
    with pytest.raises(InputError, match=f'fitness.drawn.{name}'):
        DrawnSettings(**{name: -1.0})
