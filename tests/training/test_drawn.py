# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Fitness by drawn flights: what is flown, which are chosen, what they cost, and stages."""

from dataclasses import replace

import numpy as np

from rpo.engine.population import population_of
from rpo.montecarlo.run_batch import fly_run
from rpo.scoring.drawn import HELD_OUT, DrawnFlights, DrawnSettings
from rpo.scoring.fitness import Fitness, FitnessSettings, driving
from rpo.training.config import load_start
from rpo_core.control.fuzzy import RuleTable
from rpo_core.judge.verdicts import verdicts
from rpo_core.scenario.scenario import load_set
from rpo_core.world.starts import Grid

TRAINED, ROBUST = load_start('trained'), load_start('robust')
JUDGED = {'paper_test': ('hold_error_per_axis_m', 'hold_speed_per_axis_m_s')}
FEW = DrawnSettings(
    100.0, ('paper_test',), margin=0.03, flights=6, pool=50, held_out=45, judged=JUDGED
)
ONE_START = replace(load_set('paper_training'), starts=Grid.cube((50.0,)))


def test_stages_and_what_is_held_out_have_draws_of_their_own():
    flights = DrawnFlights('paper_test', FEW)
    starts = []
    for stage in (0, 1, 2, HELD_OUT, 1):
        flights.enter(stage)
        starts.append(flights.drawn.starts)
    assert [len(s) for s in starts] == [50, 50, 50, 45, 50]
    assert len(np.unique(np.vstack(starts), axis=0)) == 195
    np.testing.assert_array_equal(starts[4], starts[1])


def test_a_force_that_drives_is_seen():
    """Mirrored along velocity, the rules push a fast chaser on."""
    codes = ROBUST.system.rules.codes[::-1]
    system = replace(ROBUST.system, rules=RuleTable.from_codes(codes))
    good, bad = driving(population_of(ROBUST, replace(ROBUST, system=system)))
    assert good < 1e-3 < 0.1 < bad


def test_a_force_limited_by_the_disturbance_of_each_run_is_judged_by_that_run():
    flights = DrawnFlights('paper_test', replace(FEW, judged={}))
    flights.enter(1)
    judged = flights.fly([ROBUST])
    flown = [fly_run(replace(flights.campaign, controller=ROBUST), number) for number in (0, 5)]
    values = [[verdict.value for verdict in verdicts(flight)] for flight in flown]
    limits = np.array([[verdict.limit for verdict in verdicts(flight)] for flight in flown])
    force = flights.judged.index('hold_force_per_disturbance')
    limits[:, force] *= 1.1  # the campaign's share; the scenario has 1.0
    np.testing.assert_array_equal(judged.limits[[0, 5]], limits)
    np.testing.assert_array_equal(judged.values[0, [0, 5]], values)
    assert judged.limits[0, force] != judged.limits[5, force]
    flights.choose(judged)
    shares = (judged.values[0] / judged.limits).max(axis=1)
    assert set(np.argsort(-shares)[:3]) <= set(flights.drawn.numbers)
    assert len(flights.drawn.numbers) == 6


def test_candidates_that_cannot_reach_the_better_half_are_not_flown():
    """The better half, and its order, are those of flying all."""
    fitness = Fitness(ONE_START, FitnessSettings(penalty='graded', drawn=FEW), 1)
    worse = [replace(ROBUST, velocity_scale_m_s=scale) for scale in (0.8, 0.9, 1.2, 2.0, 4.0, 6.0)]
    population = population_of(*worse, TRAINED, ROBUST)
    with fitness.simulator:
        fitness.enter(0)
        scores = fitness.score(population)
        each = [fitness.score(population_of(one)) for one in (*worse, TRAINED, ROBUST)]
    expected = np.array([float(s.fitness[0]) for s in each])
    best = np.argsort(expected)[:4]
    np.testing.assert_array_equal(np.argsort(scores.fitness)[:4], best)
    np.testing.assert_array_equal(scores.fitness[best], expected[best])
    assert (scores.fitness > expected).any(), 'some were not flown'
    assert (scores.fitness >= expected).all()
