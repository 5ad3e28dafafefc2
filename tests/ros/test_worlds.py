# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The shipped worlds, flown by the nodes: the bits of the core, verified from the log."""

import numpy as np
import pytest
from landing import rest_at_landing

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import overrides, scenario
from rpo_log.verify import verify
from rpo_mcap.read.run_log import read_flight, read_run


@pytest.mark.parametrize(
    ('world', 'more'),
    rest_at_landing(
        [
            ('world_leo', []),
            ('world_leo', ['estimator.compensate=true']),
            ('world_elliptic', []),
            ('world_moon', []),
            ('paper_test_measured', []),
        ]
    ),
)
def test_a_world_flies_the_bits_of_the_core(ros, world, more):
    output = ros.folder / 'run'
    changes = ['duration_s=20.0', *more]
    changed = [word for change in changes for word in ('--set', change)]
    short = [*changed, '--controller', 'pd', '--no-report', '--output', str(output)]
    node = ros.node('rpo_bringup', 'final_approach', '--no-fail', '--scenario', world, *short)
    assert node.wait() == 0, node.output
    verified = verify(output)
    assert verified.exit_code == 0, verified.sentence()
    flown = overrides.load(world, changes)
    flight, logged = fly(flown, load_controller('pd')), read_flight(output)
    np.testing.assert_array_equal(logged.states, flight.states)
    np.testing.assert_array_equal(logged.thrust.forces_n, flight.thrust.forces_n)
    last = 'shaped_force' if 'shaped_force' in flight.signals else 'exerted_force'
    np.testing.assert_array_equal(read_run(output).values[last], flight.signals[last])


@pytest.mark.slow
def test_a_world_flies_against_the_wall_clock(ros):
    output = ros.folder / 'run'
    recorder = ros.node('rpo_log', 'recorder', output=str(output))
    controller = ros.node('rpo_ctrl', 'fuzzy_controller', controller='handmade')
    navigation = ros.node('rpo_nav', 'navigation')
    short = scenario.dumps(overrides.load('world_leo', ['duration_s=20.0']))
    (ros.folder / 'short.yaml').write_text(short)
    plant = ros.node(
        'rpo_sim',
        'plant',
        scenario=str(ros.folder / 'short.yaml'),
        mode='free_running',
        real_time_factor=10.0,
        wait_for_recorder='true',
    )
    assert plant.wait() == 0, plant.output
    assert recorder.wait() == 0, recorder.output
    for node in (controller, navigation):
        assert node.stop() == 0, node.output
    assert verify(output).difference is None


@pytest.mark.every_landing
def test_the_full_chain_flies_as_seven_processes(ros):
    output, flown = ros.folder / 'run', overrides.load('docking_leo', ['duration_s=40.0'])
    (ros.folder / 'short.yaml').write_text(scenario.dumps(flown))
    others = [
        ros.node(package, name)
        for package, name in (
            ('rpo_ctrl', 'fuzzy_controller'),
            ('rpo_sim', 'disturbance_injector'),
            ('rpo_nav', 'navigation'),
            ('rpo_guidance', 'guidance'),
            ('rpo_safety', 'assurance'),
        )
    ]
    recorder = ros.node('rpo_log', 'recorder', output=str(output))
    short = str(ros.folder / 'short.yaml')
    plant = ros.node('rpo_sim', 'plant', scenario=short, wait_for_recorder='true')
    assert plant.wait() == 0, plant.output
    assert recorder.wait() == 0, recorder.output
    for node in others:
        assert node.stop() == 0, node.output
    verified = verify(output)
    assert verified.exit_code == 0, verified.sentence()
    for stage in ('sensors', 'estimator', 'guidance', 'assurance', 'thrusters'):
        assert stage in verified.sentence()
    states = fly(flown, load_controller('allround')).states
    np.testing.assert_array_equal(read_flight(output).states, states)
