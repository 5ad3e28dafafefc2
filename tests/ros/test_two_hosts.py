# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Plant on one host, controller on another: who finds whom, a cut link, a healed one, a bad one."""

import time

import numpy as np
import pytest
from flights import lasting
from links import ADDRESSES, LinkError, hosts

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.scenario.scenario import load_scenario
from rpo_log.read.run_log import read_run

pytestmark = pytest.mark.slow

SUBNET = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET'}
LOCALHOST = {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
PEERS = {
    host: {**LOCALHOST, 'ROS_STATIC_PEERS': ADDRESSES[other]}
    for host, other in (('plant', 'controller'), ('controller', 'plant'))
}


class Two:
    """A flight whose controller is on another host."""

    def __init__(self, ros, network):
        self.ros, self.network = ros, network

    def on(self, host, variables, package, executable, **parameters):
        """Start a node on a host, with some variables of its own."""
        before = dict(self.ros.env)
        self.ros.env.update(variables)
        self.ros.prefix = self.network.on(host)
        node = self.ros.node(package, executable, **parameters)
        self.ros.env, self.ros.prefix = before, []
        return node

    def controller(self, variables=SUBNET):
        parameters = {'controller': 'handmade'}
        return self.on('controller', variables, 'rpo_ctrl', 'fuzzy_controller', **parameters)

    def plant(self, variables=SUBNET, **parameters):
        return self.on('plant', variables, 'rpo_sim', 'plant', **parameters)

    def scenario(self, duration_s):
        return lasting(duration_s, self.ros.folder)


@pytest.fixture
def two(ros):
    with hosts() as network:
        yield Two(ros, network)
        for node in ros.nodes:
            node.discard()


@pytest.fixture
def joined(two):
    try:
        two.network.join()
    except LinkError as error:
        pytest.skip(str(error))
    return two


@pytest.mark.parametrize('outsider', [SUBNET, PEERS['controller']])
def test_by_default_nobody_outside_commands_the_chaser(joined, outsider):
    joined.controller(outsider)
    plant = joined.plant(LOCALHOST, start_timeout_s=8.0)
    assert plant.wait() == 3, plant.output
    assert 'no answer in time from control_force' in plant.output


@pytest.mark.parametrize('ways', [(SUBNET, SUBNET), (PEERS['plant'], PEERS['controller'])])
def test_opened_they_find_each_other_and_fly(joined, ways):
    controller = joined.controller(ways[1])
    plant = joined.plant(ways[0], scenario=joined.scenario(20.0), start_timeout_s=30.0)
    assert plant.wait() == 0, plant.output
    assert controller.stop() == 0
    assert not any('Traceback' in node.output for node in joined.ros.nodes)


def test_a_cut_link_in_free_running_is_zero_force_and_a_healed_one_is_flown(joined):
    joined.controller()
    plant = joined.plant(scenario=joined.scenario(60.0), mode='free_running', stale_after_ticks=5)
    plant.says('flying')
    cut_s = time.monotonic()
    joined.network.cut()
    plant.says('from control_force: zero')
    assert time.monotonic() - cut_s < 0.1 * 7 + 3.0
    time.sleep(3.0)
    joined.network.heal()
    plant.says('forces are back')
    assert plant.wait(90.0) == 0, plant.output


@pytest.mark.parametrize(('reaction', 'code'), [('abort', 3), ('coast', 0)])
def test_a_cut_link_in_lockstep(joined, reaction, code):
    joined.controller()
    plant = joined.plant(
        scenario=joined.scenario(20.0), real_time_factor=5.0, peer_timeout_s=1.0,
        on_peer_timeout=reaction,
    )  # fmt: skip
    plant.says('flying')
    joined.network.cut()
    plant.says('from control_force')
    assert plant.wait() == code, plant.output


def recorded(two, duration_s, **parameters):
    """Start a flight that is recorded on the plant's host; return plant, recorder, expected."""
    scenario = two.scenario(duration_s)
    two.controller()
    recorder = two.on('plant', SUBNET, 'rpo_log', 'recorder', output=str(two.ros.folder / 'run'))
    plant = two.plant(scenario=scenario, wait_for_recorder='true', **parameters)
    expected = fly(load_scenario(scenario), load_controller('handmade'))
    return plant, recorder, expected.states


def test_lockstep_waits_for_a_link_that_heals_in_time_and_the_bits_are_the_same(joined):
    plant, recorder, expected = recorded(joined, 40.0, real_time_factor=10.0, peer_timeout_s=20.0)
    plant.says('flying')
    time.sleep(0.5)
    joined.network.cut()
    time.sleep(3.0)
    assert plant.process.poll() is None
    joined.network.heal()
    assert plant.wait() == 0, plant.output
    assert recorder.wait() == 0, recorder.output
    np.testing.assert_array_equal(read_run(joined.ros.folder / 'run').states, expected)


@pytest.fixture
def badly_joined(two):
    """Both hosts, on a link that loses a tenth and delays by 20 ms."""
    try:
        with two.network.relay(0.1, 0.02):
            yield two
    except LinkError as error:
        pytest.skip(str(error))


def test_a_link_that_loses_a_tenth_and_delays_by_20_ms_changes_no_bit_in_lockstep(badly_joined):
    two = badly_joined
    plant, recorder, expected = recorded(two, 20.0)
    assert plant.wait(120.0) == 0, plant.output
    assert recorder.wait() == 0, recorder.output
    np.testing.assert_array_equal(read_run(two.ros.folder / 'run').states, expected)


def test_the_same_link_in_free_running_still_flies(badly_joined):
    two = badly_joined
    plant, recorder, expected = recorded(two, 40.0, mode='free_running', real_time_factor=2.0)
    assert plant.wait(90.0) == 0, plant.output
    assert recorder.wait() == 0, recorder.output
    states = read_run(two.ros.folder / 'run').states
    assert np.abs(states[-1, :3] - expected[-1, :3]).max() < 1.0  # of some metres flown
