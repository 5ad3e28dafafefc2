# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The same flight, bit for bit: the core's function, one process, several, any speed, any fault."""

import re
import shlex
from dataclasses import replace

import numpy as np
import pytest
from campaign_documents import write_campaign
from flights import INJECTOR, assert_flown, lasting, processes, started
from inside import inside
from invoking import invoke
from landing import rest_at_landing
from mcap.reader import make_reader

from rpo.montecarlo import config
from rpo.montecarlo.run_batch import fly_run, fly_runs
from rpo_core.assurance.settings import Assurance
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import DEFAULT_CONTROLLER
from rpo_core.judge import metrics
from rpo_core.judge.metrics import FINAL
from rpo_core.scenario import overrides, scenario
from rpo_core.wire.interfaces import ASSURANCE_STATUS, ASSURED_FORCE, BODY_TORQUE
from rpo_core.world.link import CORRUPTIONS
from rpo_ctrl.assurance_node import AssuranceNode
from rpo_log.read.run_log import flight_of, read_run
from rpo_log.verify import verify
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode
from rpo_sim.fault_injector_node import FaultInjectorNode

# A shipped world, changed on the command line, flown by the nodes.

UNITS = (
    '[{kind: range_bearing, noise_floor_m: 0.01, noise_share: 0.01, bearing_noise_rad: 0.002,'
    ' latency_ticks: 3, dropout_share: 0.1}, {kind: relative_position, noise_floor_m: 0.5,'
    ' velocity_floor_m_s: 0.02, period_ticks: 10}]'
)


def test_a_world_flies_the_bits_of_the_core(together):
    """With sensors that are late and slow."""
    changes = ['duration_s=20.0', 'goal_position_m=[-3,10,2]', 'initial_position_m=[0,80,0]']
    changes += [f'sensors.units={UNITS}', 'estimator.disturbance_sigma_n=0.01']
    changed = [word for change in changes for word in ('--set', change)]
    run = together('world_leo', '--controller', 'pd', *changed)
    flight = fly(overrides.load('world_leo', changes), load_controller('pd'))
    assert_flown(run, flight, 'controller', 'dynamics')
    flown = flight_of(read_run(run))
    assert flown.scenario == flight.scenario and flown.scenario.name == 'world_leo (changed)'
    np.testing.assert_array_equal(flown.thrust.forces_n, flight.thrust.forces_n)
    logged = {'measurement', 'measurement_2', 'navigation_covariance', 'estimated_disturbance'}
    assert logged <= flight.signals.keys()


@pytest.mark.every_landing
def test_the_full_chain_flies_as_seven_processes(ros):
    path = lasting(40.0, ros.folder, 'docking_leo')
    others = (INJECTOR, 'rpo_ctrl navigation', 'rpo_ctrl guidance', 'rpo_ctrl assurance')
    run = processes(ros, path, *others, controller='allround')
    stages = ('sensors', 'estimator', 'guidance', 'assurance', 'thrusters')
    assert_flown(run, fly(scenario.load_scenario(path), load_controller('allround')), *stages)


@pytest.mark.every_landing
def test_the_chaser_as_one_process_has_the_same_bits(ros):
    path = lasting(20.0, ros.folder, 'tumbling_docking')
    software = ros.node('rpo_bringup', 'flight_software')
    for node in started(ros, ros.folder / 'run', scenario=path).values():
        assert node.wait() == 0, node.output
    assert software.stop() == 0
    flight = fly(scenario.load_scenario(path), load_controller(DEFAULT_CONTROLLER))
    assert_flown(ros.folder / 'run', flight, 'attitude')


@pytest.mark.every_landing
def test_a_chaser_that_turns_flies_against_the_wall_clock_and_verifies(ros):
    """What acted, in its axes, was commanded; with every answer in its tick it is lockstep."""
    path = lasting(20.0, ros.folder, 'tumbling_docking')
    others = ('rpo_ctrl navigation', 'rpo_ctrl guidance', 'rpo_ctrl assurance')
    others += ('rpo_ctrl attitude_controller',)
    run = processes(ros, path, *others, mode='free_running', real_time_factor=2.0)
    found = verify(run)
    assert found.exit_code == 0, found.sentence()
    assert found.free_running and {'attitude', 'estimator'} <= set(found.stages)
    log = read_run(run)
    expected = fly(scenario.load_scenario(path), load_controller('handmade'))
    torque = log.values['applied_torque']
    assert np.abs(torque).max() > 1e-3
    if np.array_equal(log.values['applied_body_force'], expected.signals['body_force']):
        np.testing.assert_array_equal(log.states, expected.states)
    np.testing.assert_array_equal(flight_of(log).signals[BODY_TORQUE], torque)


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


KINDS = ('drop', 'freeze', 'repeat', 'delay', 'reorder')
THROUGH = [
    '-r', 'fuzzy_controller:relative_state:=relative_state_faulty',
    '-r', 'fuzzy_controller:control_force:=control_force_raw',
]  # fmt: skip
STATES = {'from_topic': 'relative_state', 'to_topic': 'relative_state_faulty'}


def messages(folder):
    """Return what was recorded; remapped topics are an attachment, which only one log has."""
    with (folder / 'run.mcap').open('rb') as stream:
        found = make_reader(stream).iter_messages(log_time_order=False)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in found]


@pytest.mark.parametrize(
    ('counted', 'faults'),
    rest_at_landing(
        [
            (KINDS, dict.fromkeys(KINDS, 0.2)),
            (CORRUPTIONS, {'corrupt': 0.3}),
            *(([kind], {'corrupt': 0.3, 'corruption': kind}) for kind in CORRUPTIONS),
        ]
    ),
)
def test_lost_repeated_reordered_or_spoilt_messages_leave_the_same_bytes(
    straight, ros_env, tmp_path, counted, faults
):
    """In both directions; a lost one comes again."""
    with inside(THROUGH) as inner:
        injectors = [
            inner.start(FaultInjectorNode({'seed': seed, **topics, **faults}))
            for seed, topics in ((1, STATES), (2, {}))
        ]
        scenario = lasting(20.0, tmp_path, 'paper_test')
        inner.fly(tmp_path / 'run', scenario, DisturbanceInjectorNode, resend_after_s=0.01)
        assert inner.ends() == 0
    for injector in injectors:
        assert all(injector.link.counts[kind] > 10 for kind in counted), injector.link.counts
    assert messages(tmp_path / 'run') == messages(straight)
