# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Baselines on ROS 2: the bits of the core, in one process and in four; what they refuse."""

import numpy as np
import pytest

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.scenario import load_scenario
from rpo_log.verify import ExitCode, verify
from rpo_mcap.read.run_log import read_flight
from tools.node_processes import node_processes


def assert_flown(folder, scenario, controller):
    expected = fly(load_scenario(scenario), load_controller(controller))
    flown = read_flight(folder)
    np.testing.assert_array_equal(flown.states, expected.states)
    np.testing.assert_array_equal(flown.forces_n, expected.forces_n)
    assert verify(folder).exit_code == ExitCode.OK


def one_process(ros_env, folder, scenario, controller):
    options = ('--scenario', scenario, '--controller', controller, '--no-report')
    with node_processes(ros_env, folder) as ros:
        node = ros.node('rpo_bringup', 'final_approach', *options, '--output', str(folder / 'run'))
        assert node.wait() == 0, node.output
    assert_flown(folder / 'run', scenario, controller)


@pytest.mark.every_landing
def test_a_law_that_counts_ticks_flies_the_bits_of_the_core(ros_env, tmp_path):
    one_process(ros_env, tmp_path, 'quick', 'mpc')


@pytest.mark.slow
@pytest.mark.parametrize('controller', ['pd', 'lqr', 'mpc', 'apf_smc', 'drift'])
def test_every_baseline_flies_the_bits_of_the_core(controller, ros_env, tmp_path):
    one_process(ros_env, tmp_path, 'paper_test', controller)


@pytest.mark.slow
@pytest.mark.parametrize('compiled', ['0', '1'])
def test_four_processes_fly_the_bits_of_the_core(compiled, ros_env, tmp_path):
    with node_processes({**ros_env, 'RPO_JIT': compiled}, tmp_path) as ros:
        controller = ros.node(
            'rpo_ctrl', 'rival_controller', controller='mpc', scenario='paper_test'
        )
        injector = ros.node('rpo_sim', 'disturbance_injector', scenario='paper_test')
        recorder = ros.node('rpo_log', 'recorder', output=str(tmp_path / 'run'))
        plant = ros.node('rpo_sim', 'plant', scenario='paper_test', wait_for_recorder='true')
        assert plant.wait(120.0) == 0, plant.output
        assert recorder.wait() == 0, recorder.output
        assert controller.stop() == 0, controller.output
        assert injector.stop() == 0, injector.output
    assert_flown(tmp_path / 'run', 'paper_test', 'mpc')


@pytest.mark.slow
@pytest.mark.parametrize(
    ('node', 'parameters', 'said'),
    [
        (
            'rival_controller',
            {'controller': 'mpc', 'scenario': 'none'},
            '`scenario` must be one of',
        ),
    ],
)
def test_the_wrong_scenario_is_refused_in_a_sentence(node, parameters, said, ros_env, tmp_path):
    with node_processes(ros_env, tmp_path) as ros:
        started = ros.node('rpo_ctrl', node, **parameters)
        assert started.wait() == 2
        assert said in started.output and 'Traceback' not in started.output
        assert len(started.output.strip().splitlines()) == 1
