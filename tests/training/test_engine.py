# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The lanes of a search have the bits of the core's closed loop, whatever shortcut they take."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from rpo.engine import lanes
from rpo.engine.cases import case_of_flights, case_of_set
from rpo.engine.population import population_of
from rpo.engine.search import Simulator
from rpo.training.genes import GeneSpace
from rpo_core.chain.flight import fly
from rpo_core.control import inference
from rpo_core.control.controller import FuzzyController, load_controller
from rpo_core.control.controller_file import ControllerStage
from rpo_core.judge import metrics
from rpo_core.scenario.requirements import Requirements
from rpo_core.scenario.scenario import load_scenario, load_set
from rpo_core.world import cw
from rpo_core.world.starts import Box, Grid

TRAINING = load_set('paper_training')


def random_controller(rules: str, seed: int):
    space = GeneSpace(rules, (20.0, 200.0), (0.3, 3.0))
    genes = np.random.default_rng(seed).random((1, space.size))
    return space.decode(genes).controller(0, f'{rules} {seed}')


def test_an_odd_law_needs_half_the_loops():
    """And a quarter of the pairs of these: 54 distinct flights of 216."""
    case = case_of_set(TRAINING)
    for (group,), counts in ((case.crossed, (36, 6, 216)), (case.halved, (18, 3, 54))):
        assert (group.loops.planar, group.loops.vertical, group.lanes.shape[1]) == counts


@settings(max_examples=20, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(['free', 'odd']),
    st.sampled_from([3, 17, 101, 201]),
    st.integers(1, lanes.STRIDE),
)
def test_inference_in_lanes_has_the_bits_of_the_kernel(seed, rules, samples, count):
    rng = np.random.default_rng(seed)
    controller = random_controller(rules, seed)
    system = replace(controller.system, samples=samples)
    population = population_of(replace(controller, system=system))
    corners = [-1.0, -0.0, 0.0, 1.0, *np.abs(population.functions[0, :10])]
    errors = np.where(
        rng.random((2, count)) < 0.3,
        rng.choice(corners, (2, count)),
        rng.uniform(-1.0, 1.0, (2, count)),
    )
    rows = lanes.make_scratch()
    rows[lanes.E_R : lanes.E_R + count], rows[lanes.E_V : lanes.E_V + count] = errors
    lanes.infer_lanes(rows, count, population.law(0, samples))
    expected = [inference.infer(float(r), float(v), system.tables) for r, v in errors.T]
    np.testing.assert_array_equal(rows[lanes.OUTPUT : lanes.OUTPUT + count], expected)


class LaggedStage(ControllerStage):
    """The force of the last state but one: a controller with memory."""

    memory_ticks = 1

    def __init__(self, inner):
        self.inner = inner

    def reset(self):
        self.last = (0.0, 0.0, 0.0)

    def step(self, tick, *inputs):
        force, (self.last,) = self.last, self.inner.step(tick, *inputs)
        return (force,)


class Lagged:
    """A controller that no lane knows; it flies through the chain."""

    name = 'lagged'
    provenance = ()

    def stage(self, dt_s):
        return LaggedStage(load_controller('pd').stage(dt_s))


TEST = load_scenario('paper_test')
PLACES = {
    'target': {},
    'disturbed': {'disturbance': TEST.disturbance},
    'goal': {'goal_position_m': (-3.0, 40.0, 7.0)},
    'moon': {
        'goal_position_m': (0.0, 10.0, 0.0),
        'body': cw.BODIES['moon'],
        'orbit_radius_m': 1.9e6,
    },
}
REQUIRED = Requirements(
    hold_from_s=4.0, hold_error_norm_m=1.0, final_speed_norm_m_s=1.0, arrival_time_s=5.0,
    arrival_error_norm_m=70.0, contact_range_m=60.0, contact_lateral_speed_m_s=1.0,
)  # fmt: skip
STARTS = {
    'shared loops': Grid((-80.0, 20.0, 80.0), (30.0, -90.0), (0.0, -50.0)),
    'more than lanes': Box((-80.0, 20.0, -50.0), (80.0, 90.0, 50.0), random=300),
}
LAWS = ('free', 'odd', 'pd', 'lqr', 'mpc', 'apf_smc', 'drift', 'more_words', 'time_to_go', 'lagged')


def row_of_core(scenario, controller, case):
    """Return the row of a flight through the chain."""
    return metrics.counts_of(fly(scenario, controller), case.windows)[: case.columns]


@settings(max_examples=20, deadline=None)
@given(
    law=st.sampled_from(LAWS),
    place=st.sampled_from(sorted(PLACES)),
    starts=st.sampled_from(sorted(STARTS)),
    together=st.booleans(),
    seed=st.integers(0, 2**32 - 1),
)
def test_a_case_has_the_rows_of_the_core(law, place, starts, together, seed):
    if law == 'lagged':
        controller = Lagged()
    else:
        known = law not in ('free', 'odd')
        controller = load_controller(law) if known else random_controller(law, seed)
    base = replace(TRAINING.base, duration_s=6.0, requirements=REQUIRED, **PLACES[place])
    flown = replace(TRAINING, base=base, starts=STARTS[starts])
    horizon_s = 6.0 if together else 8.0
    case = case_of_set(flown, late_s=2.0, horizon_s=horizon_s, together=together)
    with Simulator([case], 1) as simulator:
        fuzzy = isinstance(controller, FuzzyController)
        rows = simulator.fly(population_of(controller) if fuzzy else [controller])[0][0]
    scenarios = list(case.scenarios())
    for number in {0, 8, len(rows) - 1, *np.random.default_rng(seed).integers(len(rows), size=2)}:
        expected = row_of_core(scenarios[number], controller, case)
        np.testing.assert_array_equal(rows[number], expected)


def test_flights_of_two_disturbances_and_two_cases_on_threads():
    tests = [
        replace(load_scenario(name), duration_s=15.0) for name in ('paper_test', 'paper_test_phase')
    ]
    training = replace(TRAINING, base=replace(TRAINING.base, duration_s=20.0))
    cases = [case_of_set(training, horizon_s=30.0, late_s=5.0), case_of_flights(tests, 10.0)]
    controllers = [random_controller('free', seed) for seed in range(4)]
    with Simulator(cases, 3) as simulator:
        both = simulator.fly(population_of(*controllers))
    for case, rows in zip(cases, both, strict=True):
        for controller, of_case in zip(controllers, rows, strict=True):
            for number, scenario in list(enumerate(case.scenarios()))[:: max(1, len(of_case) - 1)]:
                expected = row_of_core(scenario, controller, case)
                np.testing.assert_array_equal(of_case[number], expected)
