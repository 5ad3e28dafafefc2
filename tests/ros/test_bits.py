# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The same flight, bit for bit: the core's function, one process, four processes, any speed."""

import numpy as np
import pytest
from processes import Flight, flight

from rpo_core import closed_loop
from rpo_core.controller import load_controller
from rpo_core.scenario import load_scenario
from rpo_log.reader import read_flight

SCENARIO = 'paper_test'
CONTROLLER = 'handmade'


def one_process(ros: Flight, output: str) -> None:
    node = ros.node(
        'rpo_bringup',
        'final_approach',
        '--scenario',
        SCENARIO,
        '--controller',
        CONTROLLER,
        '--output',
        output,
        '--no-report',
    )
    assert node.wait() == 0, node.output


def four_processes(ros: Flight, output: str, real_time_factor: float = 0.0) -> None:
    controller = ros.node('rpo_ctrl', 'fuzzy_controller', controller=CONTROLLER)
    injector = ros.node('rpo_sim', 'disturbance_injector', scenario=SCENARIO)
    recorder = ros.node('rpo_log', 'recorder', output=output)
    plant = ros.node(
        'rpo_sim',
        'plant',
        scenario=SCENARIO,
        wait_for_recorder='true',
        real_time_factor=real_time_factor,
    )
    assert plant.wait() == 0, plant.output
    assert recorder.wait() == 0, recorder.output
    assert controller.stop() == 0, controller.output
    assert injector.stop() == 0, injector.output


WAYS = {
    'one process': one_process,
    'four processes': four_processes,
    'four processes, 20 x real time': lambda ros, output: four_processes(ros, output, 20.0),
}


@pytest.fixture(scope='module')
def logs() -> dict[str, bytes]:
    return {}


@pytest.mark.timeout(120)
@pytest.mark.parametrize('way', WAYS)
def test_every_state_and_force_is_that_of_the_core(way, logs, ros_env, tmp_path):
    expected = closed_loop.fly(load_scenario(SCENARIO), load_controller(CONTROLLER))
    with flight(ros_env, tmp_path) as ros:
        WAYS[way](ros, str(tmp_path / 'run'))
    flown = read_flight(tmp_path / 'run')
    np.testing.assert_array_equal(flown.states, expected.states)
    np.testing.assert_array_equal(flown.forces_n, expected.forces_n)
    np.testing.assert_array_equal(flown.disturbances_n, expected.disturbances_n)
    logs[way] = (tmp_path / 'run' / 'run.mcap').read_bytes()
    assert logs[way] == next(iter(logs.values())), f'{way}: not the bytes of {next(iter(logs))}'
