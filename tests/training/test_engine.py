# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The batch simulator flies the bits of the core's closed loop, whatever shortcut it takes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpo.engine import lanes, support
from rpo.engine.calls import rows_of
from rpo.engine.cases import case_of_flights, case_of_set
from rpo.engine.judged import VALUES
from rpo.engine.lanes import compiled
from rpo.engine.parts.control import gain_part
from rpo.engine.population import population_of
from rpo.engine.simulator import Simulator
from rpo.montecarlo import run_batch, variations
from rpo.training import stepping
from rpo.training.genes import GeneSpace
from rpo_core.chain.flight import fly
from rpo_core.control import inference
from rpo_core.control.baselines import Pd
from rpo_core.control.controller import load_controller
from rpo_core.control.controller_file import ControllerStage
from rpo_core.judge import metrics
from rpo_core.judge.verdicts import verdicts
from rpo_core.kernels.jit import COMPILED, as_table
from rpo_core.navigation.estimator import Estimator
from rpo_core.navigation.sensors import Navigation, Sensor, Sensors
from rpo_core.scenario.requirements import Requirements
from rpo_core.scenario.scenario import load_scenario, load_set
from rpo_core.world import cw
from rpo_core.world.starts import Box, Grid

ROOT = Path(__file__).parents[2]
TRAINING = load_set('paper_training')


def random_controllers(rules: str, count: int, seed: int):
    space = GeneSpace(rules, (20.0, 200.0), (0.3, 3.0))
    population = space.decode(np.random.default_rng(seed).random((count, space.size)))
    return [population.controller(i, f'{rules} {i}') for i in range(count)]


def law_of(controller):
    return population_of(controller).law(0, controller.system.samples)


def test_an_odd_law_needs_half_the_loops():
    case = case_of_set(TRAINING)
    assert (len(case.full.runs.planar), len(case.full.runs.vertical)) == (36, 6)
    assert (len(case.half.runs.planar), len(case.half.runs.vertical)) == (18, 3)


@settings(max_examples=20, deadline=None)
@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from(['free', 'odd']),
    st.sampled_from([3, 17, 101, 201]),
    st.integers(1, lanes.STRIDE),
)
def test_inference_in_lanes_has_the_bits_of_the_kernel(seed, rules, samples, count):
    rng = np.random.default_rng(seed)
    controller = random_controllers(rules, 1, seed)[0]
    system = replace(controller.system, samples=samples)
    corners = [-1.0, -0.0, 0.0, 1.0, *np.abs(population_of(controller).functions[0, :10])]
    errors = np.where(
        rng.random((2, count)) < 0.3,
        rng.choice(corners, (2, count)),
        rng.uniform(-1.0, 1.0, (2, count)),
    )
    rows = lanes.make_scratch()
    rows[lanes.E_R : lanes.E_R + count], rows[lanes.E_V : lanes.E_V + count] = errors
    lanes.infer_lanes(rows, count, law_of(replace(controller, system=system)))
    expected = [inference.infer(float(r), float(v), system.tables) for r, v in errors.T]
    np.testing.assert_array_equal(rows[lanes.OUTPUT : lanes.OUTPUT + count], expected)


@pytest.mark.parametrize('name', ['handmade', 'allround', 'pd'])
def test_more_starts_than_lanes_fly_batch_by_batch(name):
    """300 random starts have more loops than lanes; rows and flights have the core's bits."""
    limits = {'hold_from_s': 4.0, 'hold_error_norm_m': 1.0, 'final_speed_norm_m_s': 1.0}
    limits |= {'contact_range_m': 60.0, 'contact_lateral_speed_m_s': 1.0}
    base = replace(TRAINING.base, duration_s=6.0, requirements=Requirements(**limits))
    some = Box((-80.0, 20.0, -50.0), (80.0, 90.0, 50.0), random=300)
    many, controller = replace(TRAINING, base=base, starts=some), load_controller(name)
    case = case_of_set(many, late_s=2.0, together=True)
    assert case.full is None
    with Simulator([case], 1) as simulator:
        rows = simulator.fly([controller])[0][0]
    assert rows.shape == (308, case.columns)
    members = many.scenarios()
    for number in (0, 8, 39, 40, 307):
        flight = fly(members[number], controller)
        np.testing.assert_array_equal(rows[number, : len(metrics.UNITS)], metrics.row_of(flight))
        values = dict(zip(VALUES, rows[number, len(metrics.UNITS) :], strict=True))
        assert [values[v.key] for v in verdicts(flight)] == [v.value for v in verdicts(flight)]


# What the engine does not know is flown one by one, with the same columns, and it says so.


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
    name = 'lagged'
    provenance = ()

    def stage(self, dt_s):
        return LaggedStage(load_controller('pd').stage(dt_s))


@dataclass(frozen=True, kw_only=True)
class Halved(Pd):
    """A baseline whose law is not the whole truth."""

    def stage(self, dt_s):
        return LaggedStage(super().stage(dt_s))


@pytest.fixture(autouse=True)
def forget():
    support._announced.clear()


def test_shipped_controllers_are_known_in_perfect_scenarios():
    scenario = load_scenario('paper_test')
    for name in ('allround', 'handmade', 'pd', 'lqr', 'mpc', 'apf_smc', 'drift'):
        assert support.why_not(scenario, load_controller(name)) == ''
    noisy = scenario.equipped(Navigation(position_noise_m=0.1))
    assert 'section `navigation`' in support.why_not(noisy, load_controller('pd'))
    halved = Halved(name='halved', position_gain_n_m=0.01, velocity_gain_n_s_m=0.5)
    for stranger in (Lagged(), halved):
        assert f'controller {stranger.name} has' in support.why_not(scenario, stranger)


def test_a_campaign_of_a_stranger_has_the_same_columns_and_says_so_once(loaded, capfd):
    campaign = loaded(controller='pd')
    known = list(run_batch.fly_runs(campaign, 0, 1))
    campaign = replace(campaign, controller=Lagged())
    columns = run_batch.fly_runs(campaign, 0, 3)
    assert list(columns) == known
    for number in range(3):
        flight = run_batch.fly_run(campaign, number)
        final = [columns[name][number] for name in run_batch.FINAL]
        np.testing.assert_array_equal(final, flight.states[-1])
        row = metrics.row_of(flight)
        assert columns['energy_n2s'][number] == row[metrics.ENERGY]
        assert columns['delta_v_axis_sum_m_s'][number] == row[metrics.DELTA_V]
    run_batch.fly_runs(campaign, 3, 1)
    said = capfd.readouterr().err
    assert said.count('\n') == 1 and 'lagged has a stage of its own' in said
    assert 'one by one' in said


MOON = {'body': cw.BODIES['moon'], 'orbit_radius_m': 1.9e6}


@pytest.mark.parametrize(
    ('elsewhere', 'laws'),
    [
        ({}, ('pd', 'lqr', 'mpc', 'drift')),
        ({'goal_position_m': (-3.0, 40.0, 7.0)}, ('apf_smc', 'more_words')),
        ({'goal_position_m': (0.0, 10.0, 0.0), **MOON}, ('mpc', 'time_to_go')),
    ],
    ids=['target', 'goal', 'moon'],
)
def test_both_ways_give_the_same_rows(elsewhere, laws, monkeypatch, loaded):
    """A campaign, and starts, of what the engine knows are flown singly to the same bits.

    Of cases of two windows, disturbed in two ways, on threads; odd laws and others.
    """
    campaign = loaded()
    changed = replace(campaign.scenario, **elsewhere)
    campaigns = [
        replace(campaign, scenario=changed, controller=load_controller(name))
        for name in ('handmade', *laws)
    ]
    base = replace(load_set('paper_training').base, duration_s=20.0, **elsewhere)
    training = case_of_set(
        replace(load_set('paper_training'), base=base, starts=Grid.cube((50.0, -100.0))),
        horizon_s=30.0,
        late_s=5.0,
    )
    tests = [  # the last are of a shorter window
        replace(load_scenario(name), duration_s=15.0, **elsewhere)
        for name in ('paper_test', 'paper_test_phase')
    ]
    cases = [training, case_of_flights(tests, 10.0)]
    controllers = [load_controller(name) for name in ('allround', *laws)]
    controllers += random_controllers('free', 1, 11)

    def both():
        columns = [run_batch.fly_runs(campaign, 38, 4).values() for campaign in campaigns]
        with Simulator(cases, 3) as simulator:
            return [*chain(*columns), *simulator.fly(controllers)]

    quickly = both()
    for module in ('montecarlo.run_batch', 'engine.simulator'):
        monkeypatch.setattr(f'rpo.{module}.why_not', lambda *_: 'test')
    for ours, singly in zip(quickly, both(), strict=True):
        np.testing.assert_array_equal(ours, singly)


def test_strangers_are_flown_through_cases(capfd):
    test = replace(load_scenario('paper_test'), duration_s=20.0)
    case = case_of_flights([test], 10.0)
    with Simulator([case], 2) as simulator:
        (rows,) = simulator.fly([Lagged(), Lagged()])
    expected = metrics.row_of(fly(test, Lagged()), case.windows)
    np.testing.assert_array_equal(rows, [[expected], [expected]])
    assert capfd.readouterr().err.count('one by one') == 1


@compiled
def broken(w, memory, table, tick):
    if tick == 3:
        raise ValueError('flights differ')
    w[0] = w[0] + 1.0


def test_an_error_of_a_kernel_ends_the_flights():
    nothing, w = np.zeros(1), np.zeros((1, 1))
    rows = [rows_of([(broken, nothing, nothing)])]
    rows = np.array(rows) if COMPILED else rows
    for tick in range(3):
        stepping._pass(rows, tick, w)
    with pytest.raises(ValueError, match='flights differ'):
        stepping._pass(rows, 3, w)
    assert w[0, 0] == 3.0


def test_a_run_of_which_nothing_is_drawn_has_the_sensors_of_the_scenario():
    sensors, estimator = Sensors((Sensor('relative_position', 0.05),)), Estimator(noise_scale=1.5)
    equipped = load_scenario('approach').equipped(sensors, estimator)
    draw = variations.Draw({}, {}, (3, 4))
    assert variations.sensors(equipped, draw) == replace(sensors, noise_key=(3, 4))
    assert variations.estimator(equipped, draw).noise_scale == 1.5


def test_a_gain_multiplies_the_force_of_each_lane_up_to_the_limit():
    w = as_table(np.zeros(80 * lanes.STRIDE))
    force = np.asarray(w)[lanes.FORCE : lanes.FORCE + lanes.PAIRED_LANES]
    force[:] = before = np.linspace(-1.0, 1.0, lanes.PAIRED_LANES)
    part = gain_part(lanes.PAIRED_LANES, 1.5, 0.5)
    part.steps[0][1](w, part.memory, as_table(part.table), 0)
    np.testing.assert_allclose(force, np.clip(1.5 * before, -0.5, 0.5))
