# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The batch simulator flies the bits of the core's closed loop, whatever shortcut it takes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from landing import rest_at_landing

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.scenario import load_scenario, load_set
from rpo_core.files.starts import Box
from rpo_core.judge import metrics
from rpo_core.judge.requirements import Requirements
from rpo_core.judge.verdicts import verdicts
from rpo_kernels import kernels
from rpo_montecarlo.engine import lanes, tick
from rpo_montecarlo.engine.cases import case_of_flights, case_of_set
from rpo_montecarlo.engine.counters import Trace
from rpo_montecarlo.engine.judged import VALUES
from rpo_montecarlo.engine.parts.control import control_of
from rpo_montecarlo.engine.population import population_of
from rpo_montecarlo.engine.simulator import Simulator
from rpo_training.genes import GeneSpace

TRAINING = load_set('paper_training')


def random_controllers(rules: str, count: int, seed: int):
    space = GeneSpace(rules, (20.0, 200.0), (0.3, 3.0))
    population = space.decode(np.random.default_rng(seed).random((count, space.size)))
    return [population.controller(i, f'{rules} {i}') for i in range(count)]


def law_of(controller):
    return population_of(controller).law(0, controller.system.samples)


def recorded(controller, case, loops):
    """Return states (starts, N+1, 6) and forces (starts, N+1, 3), each start from its lanes."""
    p, q = len(loops.runs.planar), len(loops.runs.vertical)
    ticks, control = case.windows.horizon, control_of(controller)
    trace = Trace(ticks, loops.runs.lanes)
    tick.fly(loops.runs, [control.part(loops.runs), trace.part], ticks, lanes.make_scratch())
    states, forces = trace.states, trace.forces
    for pair in loops.pairs:
        i, j = divmod(int(pair), q)
        axes = [i, p + i, 2 * p + j]
        yield np.concatenate([states[:, axes, 0], states[:, axes, 1]], axis=1), forces[:, axes]


@pytest.mark.parametrize(
    'controller',
    [load_controller('handmade'), *random_controllers('free', 3, 1)],
    ids=lambda c: c.name,
)
def test_states_and_forces_are_the_bits_of_the_core(controller):
    base = replace(TRAINING.base, duration_s=40.0)
    case = case_of_set(replace(TRAINING, base=base))
    starts = list(recorded(controller, case, case.full))
    for index in range(0, 216, 7):
        flight = fly(
            replace(base, initial_position_m=tuple(TRAINING.initial_positions_m[index])), controller
        )
        np.testing.assert_array_equal(starts[index][0], flight.states)
        np.testing.assert_array_equal(starts[index][1], flight.forces_n)


def test_a_disturbed_flight_has_the_bits_of_the_core():
    controller = load_controller('handmade')
    flights = [
        replace(load_scenario(name), duration_s=60.0) for name in ('paper_test', 'paper_test_phase')
    ]
    case = case_of_flights(flights, late_s=20.0)
    for scenario, (states, forces) in zip(
        flights, recorded(controller, case, case.full), strict=True
    ):
        flight = fly(scenario, controller)
        np.testing.assert_array_equal(states, flight.states)
        np.testing.assert_array_equal(forces, flight.forces_n)
    with Simulator([case], 1) as simulator:
        rows = simulator.fly(population_of(controller))[0][0]
    for row, scenario in zip(rows, flights, strict=True):
        flight = fly(scenario, controller)
        np.testing.assert_array_equal(row, metrics.row_of(flight, case.windows))
        late = metrics.window(flight, 20.0)
        assert row[metrics.LATE_POSITION] == late.position_m
        assert row[metrics.LATE_VELOCITY] == late.velocity_m_s <= row[metrics.LATE_SPEED]
        assert row[metrics.LATE_FORCE] == late.force_n


@pytest.mark.parametrize('rules', ['odd', 'odd-monotone'])
def test_an_odd_law_needs_half_the_loops(rules):
    controller = random_controllers(rules, 1, 5)[0]
    case = case_of_set(replace(TRAINING, base=replace(TRAINING.base, duration_s=40.0)))
    assert (len(case.full.runs.planar), len(case.full.runs.vertical)) == (36, 6)
    assert (len(case.half.runs.planar), len(case.half.runs.vertical)) == (18, 3)
    for whole, half in zip(
        recorded(controller, case, case.full), recorded(controller, case, case.half), strict=True
    ):
        for ours, theirs in zip(half, whole, strict=True):
            np.testing.assert_array_equal(np.abs(ours), np.abs(theirs))


@pytest.mark.parametrize('rules', rest_at_landing(['free', 'odd']))
def test_metrics_are_those_of_the_core(rules):
    controllers = random_controllers(rules, 4, 11)
    case = case_of_set(TRAINING, horizon_s=220.0, late_s=10.0)
    with Simulator([case], 2) as simulator:
        found = simulator.fly(population_of(*controllers))[0]
    for index in (0, 173):
        for controller, rows in zip(controllers, found, strict=True):
            scenario = TRAINING.scenarios()[index]
            f = metrics.of_flight(fly(scenario, controller))
            expected = [
                f.energy_n2s,
                f.mean_speed_norm_m_s,
                f.slew_per_axis_n_s,
                f.mean_error_norm_m,
            ]
            np.testing.assert_allclose(rows[index, :4], expected, rtol=1e-12)
            longer = fly(replace(scenario, duration_s=220.0), controller)
            np.testing.assert_array_equal(rows[index], metrics.row_of(longer, case.windows))
            late = metrics.window(longer, 10.0)
            assert rows[index, metrics.LATE_POSITION] == late.position_m
            assert rows[index, metrics.LATE_FORCE] == late.force_n


def test_results_do_not_depend_on_the_number_of_threads():
    space = GeneSpace('free')
    population = space.decode(np.random.default_rng(3).random((12, space.size)))
    case = case_of_set(TRAINING)
    outcomes = []
    for workers in (1, 2, 5):
        with Simulator([case], workers) as simulator:
            outcomes.append(simulator.fly(population)[0])
    np.testing.assert_array_equal(outcomes[0], outcomes[1])
    np.testing.assert_array_equal(outcomes[0], outcomes[2])


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
    expected = [kernels.infer(float(r), float(v), system.tables) for r, v in errors.T]
    np.testing.assert_array_equal(rows[lanes.OUTPUT : lanes.OUTPUT + count], expected)


@pytest.mark.parametrize('name', ['handmade', 'trained', 'pd'])
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
