# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A chaser that turns, flown by its nodes: the bits of the chain, logged, verified."""

import numpy as np
import pytest
import yaml
from flights import INJECTOR, assert_flown, lasting, processes
from landing import rest_at_landing

from rpo_attitude.turns import apart
from rpo_core.chain.chain import Chain
from rpo_core.chain.flight import fly
from rpo_core.chain.stage import Place
from rpo_core.control.controller import load_controller
from rpo_core.files.scenario import load_scenario
from rpo_core.wire.interfaces import BODY_TORQUE, CHASER_ATTITUDE
from rpo_log.verify import verify
from rpo_mcap.read.run_log import flight_of, read_run

TURNING = {
    'attitude': {
        'inertia_kg_m2': [[0.6, 0.02, 0.0], [0.02, 0.7, 0.01], [0.0, 0.01, 0.5]],
        'attitude': [0.1, 0.05, 0.0, 0.99],
        'rates_deg_s': [1.0, -0.5, 0.5],
        'wheels': {'torque_nm': 0.02, 'momentum_nms': 0.5},
    },
    'attitude_control': {'controller': 'attitude_pd'},
    'thrusters': {'table': {'preset': 'corners_24', 'force_n': 0.17, 'arm_m': 0.3}},
}


def turning(folder, **more):
    """Write a scenario whose chaser turns; return its path."""
    return lasting(25.0, folder, 'paper_test', requirements=None, **{**TURNING, **more})


@pytest.mark.parametrize('wheels', rest_at_landing([True, False], quick=0))
def test_it_flies_the_bits_of_the_chain_and_verifies(together, tmp_path, wheels):
    attitude = dict(TURNING['attitude'])
    if not wheels:
        del attitude['wheels']  # the table gives the torque
    path = turning(tmp_path, attitude=attitude)
    run = together(path, '--controller', 'handmade')
    assert_flown(run, fly(load_scenario(path), load_controller('handmade')), 'attitude')
    log = read_run(run)
    assert np.abs(log.values[CHASER_ATTITUDE][:, 3] - 1.0).max() > 1e-3, 'it turned'
    said = yaml.safe_load(log.attachments['scenario.yaml'])['attitude_control']['controller']
    assert said['kind'] == 'attitude_pd', 'the log says what flew, not where it was'


@pytest.mark.every_landing
def test_as_a_process_of_all_that_fly_the_chaser_it_has_the_same_bits(ros, tmp_path):
    path, run = turning(tmp_path), tmp_path / 'run'
    software = ros.node(
        'rpo_bringup', 'flight_software', **{'fuzzy_controller:controller': 'handmade'}
    )
    ros.node('rpo_sim', 'disturbance_injector')
    recorder = ros.node('rpo_log', 'recorder', output=str(run))
    plant = ros.node('rpo_sim', 'plant', scenario=path, wait_for_recorder='true')
    for node in (plant, recorder):
        assert node.wait() == 0, node.output
    assert software.stop() == 0
    assert_flown(run, fly(load_scenario(path), load_controller('handmade')), 'attitude')


def test_a_chaser_that_nobody_steers_gets_nothing(tmp_path):
    chain = Chain.of(load_scenario(turning(tmp_path))).part(Place.STEERING)
    off = chain.links[0].stage.off((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    assert off == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@pytest.mark.every_landing
def test_it_flies_against_the_wall_clock_and_verifies(ros, tmp_path):
    """What acted, in its axes, was commanded; with every answer in its tick it is lockstep."""
    path, others = turning(tmp_path), ('rpo_ctrl attitude_controller', INJECTOR)
    run = processes(ros, path, *others, mode='free_running', real_time_factor=2.0)
    found = verify(run)
    assert found.exit_code == 0, found.sentence()
    assert found.free_running and 'attitude' in found.stages
    log, expected = read_run(run), fly(load_scenario(path), load_controller('handmade'))
    torque = log.values['applied_torque']
    assert np.abs(torque).max() > 1e-3
    if np.array_equal(log.values['applied_body_force'], expected.signals['body_force']):
        np.testing.assert_array_equal(log.states, expected.states)
    flight = flight_of(log)
    np.testing.assert_array_equal(flight.signals[BODY_TORQUE], torque)
    first, last = log.values[CHASER_ATTITUDE][[0, -1]]
    assert apart(last, first)[0] > 0.1, 'it turned'
