# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Fitness by drawn flights: what is flown, which are chosen, what they cost, and stages."""

from dataclasses import replace

import numpy as np
import pytest

from rpo.engine.population import population_of
from rpo.engine.simulator import Simulator
from rpo.montecarlo import run_batch
from rpo.montecarlo.run_batch import fly_run
from rpo.scoring.drawn import HELD_OUT, DrawnFlights, DrawnSettings
from rpo.scoring.fitness import Fitness, FitnessSettings, driving
from rpo.training.config import load_start
from rpo_core.control.fuzzy import RuleTable
from rpo_core.judge.verdicts import verdicts
from rpo_core.scenario.scenario import load_scenario, load_set
from rpo_core.world.starts import Grid

TRAINED, ROBUST = load_start('trained'), load_start('robust')
JUDGED = {'paper_test': ('hold_error_per_axis_m', 'hold_speed_per_axis_m_s')}
FEW = DrawnSettings(
    100.0, ('paper_test',), margin=0.03, flights=6, pool=50, held_out=45, judged=JUDGED
)
ONE_START = replace(load_set('paper_training'), starts=Grid.cube((50.0,)))


def test_stages_and_what_is_held_out_have_draws_of_their_own():
    flights = DrawnFlights('paper_test', FEW)
    starts = [flights.case(stage).starts for stage in (0, 1, 2, HELD_OUT)]
    assert [len(s) for s in starts] == [50, 50, 50, 45]
    assert len(np.unique(np.vstack(starts), axis=0)) == 195
    np.testing.assert_array_equal(flights.case(1).starts, starts[1])


def test_the_term_is_the_mean_graded_penalty_of_the_flights():
    settings = FitnessSettings(penalty='graded', margin=0.03, drawn=FEW)
    fitness = Fitness(ONE_START, settings, 1)
    alone = Fitness(ONE_START, replace(settings, drawn=DrawnSettings()), 1)
    flights = DrawnFlights('paper_test', FEW)
    population = population_of(TRAINED, ROBUST)
    with fitness.simulator, alone.simulator, Simulator([flights.case(HELD_OUT)], 1) as simulator:
        fitness.enter(HELD_OUT)
        scores, without = fitness.score(population), alone.score(population)
        values = simulator.fly(population)[0][..., flights.columns]
    limits = 0.97 * flights.limits
    shares = 0.1 + 0.9 * (1.0 - (limits / np.maximum(values, limits)) ** 0.25)
    expected = 100.0 * np.where(values > limits, shares, 0.0).sum(axis=(-2, -1)) / FEW.flights
    np.testing.assert_allclose(scores.fitness - without.fitness, expected, rtol=1e-9)
    assert fitness.labels == (*alone.labels, 'paper_test')
    missed = (values > flights.limits).any(axis=-1).sum(axis=-1)
    assert scores.failures[:, -1].tolist() == missed.tolist()
    assert missed[0] > 5 > missed[1], 'of `trained`, one run in four misses'


def test_a_force_that_drives_is_seen():
    """Mirrored along velocity, the rules push a fast chaser on."""
    codes = ROBUST.system.rules.codes[::-1]
    system = replace(ROBUST.system, rules=RuleTable.from_codes(codes))
    good, bad = driving(population_of(ROBUST, replace(ROBUST, system=system)))
    assert good < 1e-3 < 0.1 < bad


def test_a_force_limited_by_the_disturbance_of_each_run_is_judged_by_that_run():
    flights = DrawnFlights('paper_test', replace(FEW, judged={}))
    chosen = [0, 5]
    campaign = replace(flights.pool(1)[0], controller=ROBUST)
    with Simulator([flights.case(1, chosen)], 1) as simulator:
        (rows,) = simulator.fly(population_of(ROBUST))
    flown = [fly_run(campaign, number) for number in chosen]
    values = [[verdict.value for verdict in verdicts(flight)] for flight in flown]
    limits = [[verdict.limit for verdict in verdicts(flight)] for flight in flown]
    force = flights.judged.index('hold_force_per_disturbance')
    limits = np.array(limits)
    limits[:, force] *= 1.1  # the campaign's share; the scenario has 1.0
    np.testing.assert_array_equal(flights.limits, limits)
    np.testing.assert_array_equal(rows[0][..., flights.columns], values)
    assert flights.limits[0, force] != flights.limits[1, force]
    assert flights.choose(rows[0]) == [0, 1]


# Candidates judged in a world: sensors, filter, pulses.

LEO = replace(load_scenario('world_leo'), duration_s=12.0)
SPREAD = {
    'initial_position_m': {'uniform': 5.0},
    'true_anomaly_deg': {'uniform': 180.0},
    'stuck_off_thruster': {'whole': 11},
    'sensor_noise_share': {'uniform': 0.3},
}


def settings_of(path):
    """Return settings with a few flights of a campaign."""
    return DrawnSettings(1.0, (path,), flights=6, pool=45, held_out=45)


@pytest.mark.parametrize('world', [False, True])
def test_drawn_flights_have_the_bits_of_the_campaign(write, world):
    """Also the second time, in two threads."""
    limits = {'mean_error_norm_m': 1.0, 'valve_openings': 100.0}
    path = str(write(LEO, dispersions=SPREAD, success=limits)) if world else 'paper_test'
    flights, chosen = DrawnFlights(path, settings_of(path) if world else FEW), [1, 41, 44]
    campaign, _ = flights.pool(3)
    with Simulator([flights.case(3, chosen)], 2) as simulator:
        first, again = (simulator.fly(population_of(ROBUST, TRAINED))[0] for _ in range(2))
    np.testing.assert_array_equal(first, again)
    for row, controller in zip(first, (ROBUST, TRAINED), strict=True):
        columns = run_batch.fly_runs(replace(campaign, controller=controller), 0, 45)
        names = list(campaign.config.success)
        assert names == flights.judged
        expected = np.column_stack([columns[name] for name in names])[chosen]
        np.testing.assert_array_equal(row[..., flights.columns], expected)


@pytest.mark.parametrize('world', [False, True])
def test_candidates_that_cannot_reach_the_better_half_are_not_flown(write, world):
    """The better half, and its order, are those of flying all."""
    drawn = settings_of(str(write(LEO, dispersions=SPREAD))) if world else FEW
    fitness = Fitness(ONE_START, FitnessSettings(penalty='graded', drawn=drawn), 1)
    worse = [replace(ROBUST, velocity_scale_m_s=scale) for scale in (0.8, 0.9, 1.2, 2.0, 4.0, 6.0)]
    population = population_of(*worse, TRAINED, ROBUST)
    with fitness.simulator:
        fitness.enter(0)
        scores = fitness.score(population)
        each = [fitness.score(population.members(slice(i, i + 1))) for i in range(8)]
    expected = np.array([float(s.fitness[0]) for s in each])
    best = np.argsort(expected)[:4]
    np.testing.assert_array_equal(np.argsort(scores.fitness)[:4], best)
    np.testing.assert_array_equal(scores.fitness[best], expected[best])
    assert (scores.fitness > expected).any(), 'some were not flown'
    assert (scores.fitness >= expected).all()
