# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The batch simulator flies the bits of the core's closed loop, whatever shortcut it takes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, pi
from pathlib import Path

import numpy as np
import pytest
from campaign_documents import write_campaign
from hypothesis import given, settings
from hypothesis import strategies as st

from rpo_core.chain import stage
from rpo_core.chain.flight import fly
from rpo_core.chain.stage import Place, Section, Stage
from rpo_core.control.controller import load_controller
from rpo_core.control.controller_file import ControllerStage
from rpo_core.files.scenario import ScenarioSet, load, load_scenario, load_set
from rpo_core.files.starts import Box, Grid
from rpo_core.judge import metrics
from rpo_core.judge.requirements import Requirements
from rpo_core.judge.verdicts import verdicts
from rpo_core.wire.interfaces import ALIGNED, APPLIED_FORCE, COMMAND
from rpo_core.world import cw
from rpo_ctrl.baselines import Pd
from rpo_kernels import kernels
from rpo_kernels.jit import COMPILED, as_table
from rpo_kernels.pulse_kernels import DELTA_V, MEMORY, OPENINGS, SPENT
from rpo_montecarlo.campaign import config, run_batch, single
from rpo_montecarlo.engine import lanes, support
from rpo_montecarlo.engine.calls import _interpreted, rows_of
from rpo_montecarlo.engine.cases import case_of_flights, case_of_set
from rpo_montecarlo.engine.flights import flights_of
from rpo_montecarlo.engine.judged import VALUES
from rpo_montecarlo.engine.lanes import compiled
from rpo_montecarlo.engine.parts import estimation, thrusters
from rpo_montecarlo.engine.parts.control import gain_part
from rpo_montecarlo.engine.population import population_of
from rpo_montecarlo.engine.simulator import Simulator
from rpo_montecarlo.engine.tick import Batch, Draw
from rpo_nav.estimator import Estimator, filter_of, memory_of
from rpo_nav.filter_kernels import FULL, HEADING, RESETS, X, estimate
from rpo_nav.navigation_errors import Navigation
from rpo_nav.sensor_kernels import sense
from rpo_nav.sensors import Sensing, Sensor, Sensors
from rpo_thrusters.allocation_kernels import SCRATCH, fire
from rpo_thrusters.table import MODULATIONS, Failure, ThrusterTable
from rpo_thrusters.table import rows_of as rows_of_failures
from rpo_thrusters.thrusters import Propellant, Thrusters, table_for, tank_of
from rpo_training import stepping
from rpo_training.genes import GeneSpace

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


GEO = ROOT / 'offline_training/examples/missions/geo_servicer.yaml'
GRID = ScenarioSet(
    replace(load(GEO), duration_s=20.0, dt_s=0.5, requirements=None),
    Grid((-5.0, 20.0), (30.0,), (0.0, -4.0, 7.0)),
)
PAPERS, LONGER = (
    replace(TRAINING, base=replace(TRAINING.base, duration_s=s)) for s in (20.0, 40.0)
)
PLANNED = load_set('least_energy_starts')
PLANNED = replace(
    PLANNED, base=replace(PLANNED.base, duration_s=190.0), starts=Grid.cube((-100.0, 100.0))
)
LAWS = ('pd', 'lqr', 'mpc', 'apf_smc', 'drift', 'more_words', 'time_to_go')


@pytest.mark.parametrize(
    ('flown', 'controller', 'every'),
    [*((GRID, load_controller(n), 12) for n in ('allround', 'handmade', 'pd')),
     *((PAPERS, load_controller(n), 200) for n in LAWS),
     (PLANNED, load_controller('allround'), 5),
     *((LONGER, c, 7) for c in (load_controller('handmade'), *random_controllers('free', 3, 1)))],
    ids=lambda one: getattr(one, 'name', str(one)),
)  # fmt: skip
def test_flights_of_a_set_have_the_bits_of_the_core(flown, controller, every):
    members = flown.scenarios()
    flights = list(flights_of(controller, flown))
    assert len(flights) == len(members)
    for number in {*range(0, len(members), every), min(3, len(members) - 1), len(members) - 1}:
        expected = fly(members[number], controller)
        np.testing.assert_array_equal(flights[number].states, expected.states)
        np.testing.assert_array_equal(flights[number].forces_n, expected.forces_n)


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


@pytest.mark.parametrize('half', [1, 8, 9, 50])
def test_a_law_has_the_positive_samples_and_is_padded_to_whole_registers(half):
    found = lanes.make_law(2 * half + 1).samples
    assert len(found) == lanes.LANES * ceil(half / lanes.LANES)
    assert found[:half].tolist() == [(i + 1) / half for i in range(half)]
    assert not found[half:].any()


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


@dataclass(frozen=True)
class Lag:
    """Settings of a stage that no part of the engine knows."""

    share: float = 0.5


class LagStage(Stage):
    """The force follows the command by a share of the difference at each tick."""

    name, inputs, outputs = 'lag', (COMMAND,), (APPLIED_FORCE,)
    memory_ticks = None

    def __init__(self, lag, _scenario):
        self.share = lag.share

    def reset(self):
        self.last = (0.0, 0.0, 0.0)

    def step(self, tick, *inputs):
        pairs = zip(self.last, inputs[0], strict=True)
        self.last = tuple(old + self.share * (new - old) for old, new in pairs)
        return (self.last,)


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


@pytest.mark.parametrize(
    'stranger', ['lagged has a stage of its own', 'lagging has a section `lag`']
)
def test_a_campaign_of_a_stranger_has_the_same_columns_and_says_so_once(
    stranger, tmp_path, monkeypatch, capfd
):
    """A controller with a stage of its own, and a section of a plug-in."""
    monkeypatch.setitem(stage.sections(), 'lag', Section('lag', Lag, Place.LINK, LagStage))
    campaign = config.load(write_campaign(tmp_path), controller='pd')
    known = list(run_batch.fly_runs(campaign, 0, 1))
    if 'section' in stranger:
        lagging = replace(campaign.scenario, name='lagging').equipped(Lag(0.25))
        campaign = replace(campaign, scenario=lagging)
    else:
        campaign = replace(campaign, controller=Lagged())
    columns = run_batch.fly_runs(campaign, 0, 3)
    assert list(columns) == known
    for number in range(3):
        flight = single.fly_run(campaign, number)
        assert flight.scenario.section(Lag) == campaign.scenario.section(Lag)
        final = [columns[name][number] for name in run_batch.FINAL]
        np.testing.assert_array_equal(final, flight.states[-1])
        row = metrics.row_of(flight)
        assert columns['energy_n2s'][number] == row[metrics.ENERGY]
        assert columns['delta_v_axis_sum_m_s'][number] == row[metrics.DELTA_V]
    run_batch.fly_runs(campaign, 3, 1)
    said = capfd.readouterr().err
    assert said.count('\n') == 1 and stranger in said and 'one by one' in said


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
    campaign = replace(campaign, scenario=replace(campaign.scenario, **elsewhere))
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
        columns = run_batch.fly_runs(campaign, 38, 4)
        with Simulator(cases, 3) as simulator:
            return [*columns.values(), *simulator.fly(controllers)]

    quickly = both()
    for module in ('campaign.run_batch', 'engine.simulator'):
        monkeypatch.setattr(f'rpo_montecarlo.{module}.why_not', lambda *_: 'test')
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


# Sensors and filters in lanes have the bits of the kernels, also where no flight goes.

PLAIN = replace(load_scenario('approach'), duration_s=8.0)
LIDAR = Sensor(
    'range_bearing', 0.02, 0.01, 0.002, latency_ticks=2, dropout_share=0.2, outlier_share=0.1,
    outlier_size_m=50.0, bias_m=(0.1, 0.0, -0.2), bias_walk_m_s0_5=0.01, scale_error=0.01,
)  # fmt: skip
CAMERA = Sensor('bearing', bearing_noise_rad=0.003, period_ticks=3, field_of_view_rad=1.2)
RADIO = Sensor(
    'relative_position', 0.05, 0.01, velocity_floor_m_s=0.003, velocity_share_1_s=1e-4,
    latency_ticks=5, period_ticks=2, outages_s=((2.0, 4.0),),
)  # fmt: skip
CASES = {
    'lidar, 9 states': ((LIDAR,), Estimator(disturbance_sigma_n=0.01, restart_after=3)),
    'lidar, 6 states': ((LIDAR,), Estimator(restart_after=2, restart_velocity_sigma_m_s=0.1)),
    'three of different latency': (
        (LIDAR, CAMERA, RADIO),
        Estimator(disturbance_sigma_n=0.01, disturbance_walk_n_s0_5=1e-3, delay_ticks=2),
    ),
    'a camera without a gate': (
        (replace(CAMERA, field_of_view_rad=pi),),
        Estimator(gate_sigmas=0.0),
    ),
}


def runs(units, settings, count):
    """Return scenarios that differ in start, mass and key."""
    base = PLAIN.equipped(Sensors(units), settings)
    return [
        replace(base, mass_kg=10.0 + i, initial_position_m=(5.0, 40.0 + i, -20.0)).equipped(
            Sensors(units, (i, 9))
        )
        for i in range(count)
    ]


def lost(truth, tick, run):
    """Return the true state of a run, of which nothing is finite for a while."""
    return truth * 1e200 if run == 3 and 20 <= tick < 23 else truth


@pytest.mark.parametrize('case', CASES)
def test_lanes_have_the_bits_of_the_kernels(case):
    flown = runs(*CASES[case], count=40)
    starts, keys = np.array([s.start for s in flown]), np.zeros((40, 2))
    part = estimation.estimators_of(Batch(flown[0], starts, flown.copy, {}, keys, {}))
    m, t = part.memory.copy(), part.table
    sensing = [Sensing(s.section(Sensors), s) for s in flown]
    filters = [filter_of(s.section(Estimator), s.section(Sensors), s) for s in flown]
    memories = [memory_of(f) for f in filters]
    for f in filters:
        f[FULL] = 0.0
    w, rng = lanes.make_scratch(), np.random.default_rng(1)
    command, trouble, attitude = np.zeros((40, 3)), set(), np.zeros(HEADING)
    for tick in range(PLAIN.ticks + 1):
        truth = np.array([s.start for s in flown]) * (1.0 - 0.01 * tick)
        truth = np.array([lost(row, tick, run) for run, row in enumerate(truth)])
        for axis in range(3):
            rows = slice(axis * 40, axis * 40 + 40)
            w[lanes.R :][rows], w[lanes.V :][rows] = truth[:, axis], truth[:, 3 + axis]
        estimation.navigate(w, m, t, tick)
        for run, (s, f, own) in enumerate(zip(sensing, filters, memories, strict=True)):
            state = tuple(truth[run].tolist())
            sense(tick, state, ALIGNED[:4], s.table, s.memory)
            estimate(tick, tuple(command[run].tolist()), s.memory, attitude, f, own)
            found = [w[row + axis * 40 + run] for row in (lanes.SEEN_R, lanes.SEEN_V)
                     for axis in range(3)]  # fmt: skip
            assert found == list(own[X : X + 6]), (tick, run)
            trouble.add(own[RESETS] > 0)
        command = rng.uniform(-0.7, 0.7, (40, 3))
        for axis in range(3):
            w[lanes.FORCE + axis * 40 :][:40] = command[:, axis]
        estimation.remember(w, m, t, tick)
    assert trouble == {False, True}


def test_a_run_of_which_nothing_is_drawn_has_the_sensors_of_the_scenario():
    sensors, estimator = Sensors((LIDAR, RADIO)), Estimator(noise_scale=1.5)
    varied = estimation.vary_sensors(PLAIN.equipped(sensors, estimator), Draw({}, {}, (3, 4)))
    assert varied[0] == replace(sensors, noise_key=(3, 4)) and varied[1].noise_scale == 1.5


# Tables of thrusters in lanes have the bits of the kernel that the chain flies.

FIRED_TICKS = 40


def firing_runs(table, propellant):
    """Return scenarios whose thrusters differ in errors, failure, mass and tank."""
    draw, found = np.random.default_rng(5), []
    for i in range(lanes.RUNS):
        failure = Failure(
            thruster=table.names[i % len(table.names)],
            stuck='on' if i % 3 == 0 else 'off',
            from_s=0.5 * (i % 4) * PLAIN.dt_s,
            until_s=(10 + i) * PLAIN.dt_s,
            known=i % 2 == 0,
        )
        own = Thrusters(
            table=replace(table, failures=(failure,)),
            matrix=tuple(map(tuple, (np.eye(3) + 0.02 * draw.normal(size=(3, 3))).tolist())),
            propellant=Propellant(mass_kg=2e-4 + 2e-3 * (i % 3), specific_impulse_s=70.0)
            if propellant
            else None,
        )
        found.append(replace(PLAIN, mass_kg=10.0 + i).equipped(own))
    return found


def one_by_one(flown, forces, torques):
    """Return force, torque and mass (7,) of each tick and run, and what the runs have spent."""
    results, spent = np.empty((FIRED_TICKS, lanes.RUNS, 7)), []
    for s, one in enumerate(flown):
        settings = one.thrusters
        rows = rows_of_failures(settings.table.failures, settings.table.names, one.dt_s)
        table = table_for(settings, one)._replace(failures=as_table(np.ravel(rows), np.int64))
        memory, scratch = as_table(np.zeros(MEMORY)), as_table(np.zeros(SCRATCH))
        for tick in range(FIRED_TICKS):
            given = tuple(forces[tick, s].tolist()), tuple(torques[tick, s].tolist())
            force, torque, mass = fire(tick, *given, memory, table, tank_of(settings, one), scratch)
            results[tick, s] = (*force, *torque, mass)
        spent.append([memory[at] for at in (DELTA_V, SPENT, OPENINGS)])
    return results, np.array(spent).T


@pytest.mark.parametrize('modulation', MODULATIONS)
@pytest.mark.parametrize('propellant', [False, True])
def test_lanes_have_the_bits_of_the_kernel(modulation, propellant):
    """Of small demands, of such that no table can meet, of none, and of tanks that get empty."""
    table = ThrusterTable(
        preset='corners_24', force_n=0.2, minimum_impulse_bit_n_s=0.02, modulation=modulation
    )
    flown = firing_runs(table, propellant)
    part = thrusters._part(Batch(flown[0], np.zeros((lanes.RUNS, 6)), flown.copy, {}, None, {}))
    draw = np.random.default_rng(6)
    sizes = draw.choice([0.0, 0.05, 0.3, 2.0], size=(2, FIRED_TICKS, lanes.RUNS, 1))
    forces, torques = sizes * draw.normal(size=(2, FIRED_TICKS, lanes.RUNS, 3))
    expected, spent = one_by_one(flown, forces, torques)
    w, memory, found = lanes.make_scratch(), part.memory.copy(), np.empty_like(expected)
    for tick in range(FIRED_TICKS):
        for row, values in ((lanes.FORCE, forces), (lanes.UNLOADING, torques)):
            w[row : row + lanes.PAIRED_LANES] = values[tick].T.ravel()
        ((_, kernel),) = part.steps
        kernel(w, memory, part.table, tick)
        for at, row in ((0, lanes.FORCE), (3, lanes.EXERTED_TORQUE)):
            found[tick, :, at : at + 3] = w[row : row + lanes.PAIRED_LANES].reshape(3, -1).T
        found[tick, :, 6] = w[lanes.MASS : lanes.MASS + lanes.RUNS]
    assert found.tobytes() == expected.tobytes()
    counted = thrusters.spent_of({part.name: memory})
    assert np.array(list(counted.values())).tobytes() == spent.tobytes()
    tanks = np.array([s.thrusters.propellant.mass_kg for s in flown] if propellant else [1.0])
    assert (spent[2] > 10).all() and (not propellant or (spent[1] == tanks).sum() > 5)


def test_a_gain_multiplies_the_force_of_each_lane_up_to_the_limit():
    w = as_table(np.zeros(80 * lanes.STRIDE))
    force = np.asarray(w)[lanes.FORCE : lanes.FORCE + lanes.PAIRED_LANES]
    force[:] = before = np.linspace(-1.0, 1.0, lanes.PAIRED_LANES)
    part = gain_part(lanes.PAIRED_LANES, 1.5, 0.5)
    part.steps[0][1](w, part.memory, as_table(part.table), 0)
    np.testing.assert_allclose(force, np.clip(1.5 * before, -0.5, 0.5))


def test_what_is_not_compiled_calls_the_kernel_of_a_row():
    taken = []
    _interpreted((lambda *given: taken.append(given), 'memory', 'table'), 'scratch', 7)
    assert taken == [('scratch', 'memory', 'table', 7)]
