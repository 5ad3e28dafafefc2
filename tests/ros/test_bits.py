# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The same flight, bit for bit: the core's function, one process, several processes, any speed."""

import re
import shlex
from dataclasses import replace

import numpy as np
import pytest
from campaign_documents import write_campaign
from flights import INJECTOR, assert_flown, processes
from invoking import invoke
from landing import rest_at_landing

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import overrides, scenario
from rpo_core.files.scenario import load_scenario
from rpo_core.judge import metrics
from rpo_log.verify import verify
from rpo_mcap.read.run_log import flight_of, read_run
from rpo_montecarlo.campaign import config
from rpo_montecarlo.campaign.run_batch import FINAL, fly_runs
from rpo_montecarlo.campaign.single import fly_run
from rpo_safety.assurance import ASSURANCE_STATUS, ASSURED_FORCE
from rpo_safety.assurance_node import AssuranceNode
from rpo_safety.settings import Assurance
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode


@pytest.mark.every_landing
@pytest.mark.parametrize('controller', ['mpc', 'drift'])
def test_a_baseline_flies_the_bits_of_the_core(together, controller):
    """`mpc` counts ticks."""
    run = together('quick', '--controller', controller)
    assert_flown(run, fly(load_scenario('quick'), load_controller(controller)), 'controller')


# The shipped worlds, changed on the command line, flown by the nodes.

UNITS = (
    '[{kind: range_bearing, noise_floor_m: 0.01, noise_share: 0.01, bearing_noise_rad: 0.002,'
    ' latency_ticks: 3, dropout_share: 0.1}, {kind: relative_position, noise_floor_m: 0.5,'
    ' velocity_floor_m_s: 0.02, period_ticks: 10}]'
)
LATE_AND_SLOW = [f'sensors.units={UNITS}', 'estimator.disturbance_sigma_n=0.01']


@pytest.mark.parametrize(
    ('world', 'more'),
    rest_at_landing(
        [
            ('world_leo', ['initial_position_m=[0,80,0]', *LATE_AND_SLOW]),
            ('world_leo', ['estimator.compensate=true']),
            ('world_elliptic', []),
            ('world_moon', []),
            ('paper_test_measured', []),
            ('quick', ['goal_position_m=[-3,10,2]', 'initial_position_m=[0,80,0]']),
        ]
    ),
)
def test_a_world_flies_the_bits_of_the_core(together, world, more):
    changes = ['duration_s=20.0', *more]
    changed = [word for change in changes for word in ('--set', change)]
    run = together(world, '--controller', 'pd', *changed)
    flight = fly(overrides.load(world, changes), load_controller('pd'))
    assert_flown(run, flight, 'controller', 'dynamics')
    flown = flight_of(read_run(run))
    assert flown.scenario == flight.scenario and flown.scenario.name == f'{world} (changed)'
    np.testing.assert_array_equal(flown.thrust.forces_n, flight.thrust.forces_n)
    if more[1:] == LATE_AND_SLOW:
        logged = {'measurement', 'measurement_2', 'navigation_covariance', 'estimated_disturbance'}
        assert logged <= flight.signals.keys()


def shortened(folder, name, duration_s):
    """Write a shipped scenario whose flight is shorter; return it and its path."""
    flown = overrides.load(name, [f'duration_s={duration_s}'])
    path = folder / 'short.yaml'
    path.write_text(scenario.dumps(flown))
    return flown, str(path)


@pytest.mark.slow
def test_a_world_flies_against_the_wall_clock(ros):
    _, path = shortened(ros.folder, 'world_leo', 20.0)
    free = {'mode': 'free_running', 'real_time_factor': 10.0}
    found = verify(processes(ros, path, 'rpo_nav navigation', **free))
    assert found.difference is None, found.sentence()
    assert 'estimator' in found.stages


@pytest.mark.every_landing
def test_the_full_chain_flies_as_seven_processes(ros):
    flown, path = shortened(ros.folder, 'docking_leo', 40.0)
    others = (INJECTOR, 'rpo_nav navigation', 'rpo_guidance guidance', 'rpo_safety assurance')
    run = processes(ros, path, *others, controller='allround')
    stages = ('sensors', 'estimator', 'guidance', 'assurance', 'thrusters')
    assert_flown(run, fly(flown, load_controller('allround')), *stages)


# A run of a campaign.

RUN = 7


def test_a_run_through_the_nodes_has_the_bits_of_the_campaign(together, tmp_path):
    """By the command that the campaign prints."""
    path = write_campaign(tmp_path)
    result = invoke('campaign', path, '--run', RUN, '--export', tmp_path / 'run_7.yaml')
    assert result.exit_code == 0, result.output
    printed = 'ros2 run rpo_bringup final_approach --scenario '
    together(*shlex.split(re.search(f'^{printed}(.*)', result.output, re.M)[1]))
    flown = read_run(tmp_path / 'run')
    assert flown.complete, flown.gaps
    expected = fly_run(config.load(path), RUN)
    np.testing.assert_array_equal(flown.states, expected.states)
    np.testing.assert_array_equal(flown.forces_n, expected.forces_n)
    np.testing.assert_array_equal(flown.disturbances_n, expected.disturbances_n)
    columns = fly_runs(config.load(path), RUN, 1)
    slew = metrics.row_of(flight_of(flown))[metrics.SLEW]
    assert columns['slew_per_axis_n_s'] == slew, 'one flight has one slew, however late it begins'
    assert [columns[name][0] for name in FINAL] == flown.states[-1].tolist()
    assert columns['delay_ticks'] > 0  # so that all of it takes part
    difference = flown.values['navigation_state'] - flown.states
    assert np.abs(difference).max() > 1e-3  # the controller saw something else, and it is logged
    verified = verify(tmp_path / 'run')
    assert verified.exit_code == 0, verified.sentence()


# Runtime assurance.


def test_a_controller_that_wants_the_target_is_stopped_recorded_and_verified(inner, tmp_path):
    found = scenario.load_scenario('paper_test').equipped(Assurance(keep_out_m=66.0))
    found = replace(found, duration_s=20.0)
    path = tmp_path / 'zone.yaml'
    path.write_text(scenario.dumps(found))
    others = (AssuranceNode, DisturbanceInjectorNode)
    inner.fly(tmp_path / 'run', str(path), *others, controller='allround')
    assert inner.ends() == 0
    log, flight = read_run(tmp_path / 'run'), fly(found, load_controller('allround'))
    assert_flown(tmp_path / 'run', flight, 'assurance')
    assert metrics.of_flight(flight_of(log)) == metrics.of_flight(flight)  # of what was flown
    changed = (log.values[ASSURED_FORCE] != flight.forces_n).any(axis=1)
    assert changed.any()
    events = [event for event in log.events if event.signal == ASSURANCE_STATUS]
    first = events[0].values
    assert first['constraint'] == 'keep_out'
    assert int(first['tick']) == np.flatnonzero(changed)[0]
    assert float(first['after_n.y']) == log.values[ASSURED_FORCE][int(first['tick']), 1]


@pytest.mark.every_landing
def test_the_covariance_of_an_estimate_reaches_assurance(together, tmp_path):
    """It travels in `navigation_state`; where it is large, the node decides as the core does."""
    sure = Assurance(
        keep_out_m=15.0,
        position_error_m=0.5,
        velocity_error_m_s=0.02,
        disturbance_n=0.02,
        thrust_error=0.1,
        sigmas=4.0,
    )
    found = replace(scenario.load_scenario('world_leo').equipped(sure), duration_s=5.0)
    path = tmp_path / 'world.yaml'
    path.write_text(scenario.dumps(found))
    run, flight = together(path, '--controller', 'pd'), fly(found, load_controller('pd'))
    assert_flown(run, flight, 'assurance')
    assured = read_run(run).values[ASSURED_FORCE]
    assert (assured != flight.forces_n).any(axis=1)[:2].all()  # the first estimates are poor
