# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Lockstep through fault injectors: whatever happens to the messages, the bits stay the same."""

import re

import numpy as np
import pytest
from flights import lasting, one_process
from landing import rest_at_landing
from mcap.reader import make_reader

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.scenario import load_scenario
from rpo_core.world.link import CORRUPTIONS
from rpo_mcap.read.run_log import read_run

CONTROLLER = 'handmade'
FAULTS = {'drop': 0.2, 'freeze': 0.2, 'repeat': 0.2, 'delay': 0.2, 'reorder': 0.2}


def remapped(name, **topics):
    """Return the arguments that name a node and remap its topics."""
    rules = {'__node': name, **topics}
    return ['--ros-args', *(part for pair in rules.items() for part in ('-r', ':='.join(pair)))]


def fly_through(ros, scenario, **faults):
    """Fly with an injector in each direction; return the run's folder and the injectors."""
    output = ros.folder / 'faulty'
    injectors = [
        ros.node(
            'rpo_sim', 'fault_injector', *remapped('faults_of_states'),
            from_topic='relative_state', to_topic='relative_state_faulty', seed=1, **faults,
        ),
        ros.node('rpo_sim', 'fault_injector', *remapped('faults_of_forces'), seed=2, **faults),
    ]  # fmt: skip
    ros.node(
        'rpo_ctrl', 'fuzzy_controller',
        *remapped(
            'fuzzy_controller',
            relative_state='relative_state_faulty', control_force='control_force_raw',
        ),
        controller=CONTROLLER,
    )  # fmt: skip
    for injector in injectors:
        injector.says('faults between')
    recorder = ros.node('rpo_log', 'recorder', output=str(output))
    plant = ros.node(
        'rpo_sim', 'plant', scenario=scenario, wait_for_recorder='true', resend_after_s=0.01
    )
    assert plant.wait() == 0, plant.output
    recorder.wait()
    assert [node.stop() for node in injectors] == [0, 0]
    assert not any('Traceback' in node.output for node in ros.nodes)
    return output, injectors


def messages(folder):
    """Return what was recorded; remapped topics are an attachment, which only one log has."""
    with (folder / 'run.mcap').open('rb') as stream:
        found = make_reader(stream).iter_messages(log_time_order=False)
        return [(channel.topic, message.log_time, message.data) for _, channel, message in found]


def counted(node, kind):
    found = re.search(rf'faults injected:.*\b{kind} (\d+)', node.output)
    return int(found[1]) if found else 0


@pytest.mark.slow
def test_lost_frozen_repeated_delayed_and_reordered_messages_leave_the_same_bytes(ros):
    scenario = lasting(10.0, ros.folder)
    faulty, injectors = fly_through(ros, scenario, **FAULTS)
    for injector in injectors:
        assert all(counted(injector, kind) > 10 for kind in FAULTS), injector.output
    clean = one_process(ros, scenario, '--controller', CONTROLLER)
    assert messages(faulty) == messages(clean)


@pytest.mark.slow
@pytest.mark.parametrize('corruption', ['any', *CORRUPTIONS])
def test_spoilt_messages_change_nothing(ros, corruption):
    scenario = lasting(10.0, ros.folder)
    output, injectors = fly_through(ros, scenario, corrupt=0.3, corruption=corruption)
    kinds = CORRUPTIONS if corruption == 'any' else [corruption]
    for injector in injectors:
        assert all(counted(injector, kind) > 5 for kind in kinds), injector.output
    expected = fly(load_scenario(scenario), load_controller(CONTROLLER))
    np.testing.assert_array_equal(read_run(output).states, expected.states)


BAD = {
    'one topic': ({'to_topic': 'control_force_raw'}, '`to_topic` must differ'),
    'a rate above one': ({'drop': 1.5}, '`drop` must be a finite number'),
    'half a message': ({'delay_messages': 1.5}, '`delay_messages` must be a whole number'),
    'unknown message': ({'from_topic': 'a', 'to_topic': 'b'}, '`message` must be state or force'),
}


@pytest.mark.parametrize('case', rest_at_landing(BAD))
def test_bad_input_is_one_sentence(ros, case):
    parameters, text = BAD[case]
    node = ros.node('rpo_sim', 'fault_injector', **parameters)
    assert node.wait() == 2
    assert text in node.output
    assert 'Traceback' not in node.output
