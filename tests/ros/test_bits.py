# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The same flight, bit for bit: the core's function, one process, four processes, any speed."""

import fcntl
import hashlib
import os
from pathlib import Path

import numpy as np
import pytest
import yaml
from landing import rest_at_landing

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import overrides, scenario
from rpo_core.files.scenario import load_scenario
from rpo_log.verify import verify
from rpo_mcap.read.run_log import read_flight, read_run
from tools.node_processes import NodeProcesses, node_processes

SCENARIO = 'paper_test'
CONTROLLER = 'handmade'


def one_process(ros: NodeProcesses, output: str) -> None:
    node = ros.node(
        'rpo_bringup',
        'final_approach',
        '--scenario',
        SCENARIO,
        '--controller',
        CONTROLLER,
        '--output',
        output,
    )
    assert node.wait() == 0, node.output
    assert Path(output, 'report', 'time_histories.png').stat().st_size > 10_000


def four_processes(ros: NodeProcesses, output: str, real_time_factor: float = 0.0) -> None:
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


def first_digest(log: bytes, shared: Path) -> str:
    """Return the digest of the first of these logs in this session, on whatever worker it was."""
    session = os.environ.get('PYTEST_XDIST_TESTRUNUID', str(os.getpid()))
    path = shared / f'bits-{session}.sha256'
    with path.open('a+') as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        first = file.read()
        if not first:
            first = hashlib.sha256(log).hexdigest()
            file.write(first)
        return first


@pytest.mark.slow  # quickly: test_readme compares the logs of the first two ways and verifies them
@pytest.mark.parametrize('way', WAYS)
def test_every_state_and_force_is_that_of_the_core(way, ros_env, tmp_path, tmp_path_factory):
    expected = fly(load_scenario(SCENARIO), load_controller(CONTROLLER))
    compiled = '1' if way == 'four processes' else '0'
    with node_processes({**ros_env, 'RPO_JIT': compiled}, tmp_path) as ros:
        WAYS[way](ros, str(tmp_path / 'run'))
    flown = read_flight(tmp_path / 'run')
    np.testing.assert_array_equal(flown.states, expected.states)
    np.testing.assert_array_equal(flown.forces_n, expected.forces_n)
    np.testing.assert_array_equal(flown.disturbances_n, expected.disturbances_n)
    log = b''.join((tmp_path / 'run' / f).read_bytes() for f in ('run.mcap', 'decisions.mcap'))
    first = first_digest(log, tmp_path_factory.getbasetemp().parent)
    assert hashlib.sha256(log).hexdigest() == first, f'{way}: not the bytes of the first way'
    info = yaml.safe_load((tmp_path / 'run' / 'run_info.yaml').read_text())
    counts = dict(info['messages'])
    assert (counts.pop('/run_status'), counts.pop('/stage_status')) == (2, 0)
    assert set(counts.values()) == {len(expected.states)} and len(counts) == 4
    assert info['faults'] is None


def test_fields_changed_on_the_command_line_fly_the_bits_of_the_core(ros_env, tmp_path):
    changes = ['goal_position_m=[-3,10,2]', 'initial_position_m=[0,80,0]']
    options = [part for change in changes for part in ('--set', change)]
    folder = tmp_path / 'run'
    arguments = ['--scenario', 'quick', '--controller', CONTROLLER, *options, '--no-report']
    with node_processes(ros_env, tmp_path) as ros:
        node = ros.node('rpo_bringup', 'final_approach', *arguments, '--output', str(folder))
        assert node.wait() == 0, node.output
    flown = read_flight(folder)
    flight = fly(overrides.load('quick', changes), load_controller(CONTROLLER))
    assert flown.scenario == flight.scenario and flown.scenario.name == 'quick (changed)'
    np.testing.assert_array_equal(flown.states, flight.states)
    np.testing.assert_array_equal(flown.forces_n, flight.forces_n)
    verified = verify(folder)
    assert verified.exit_code == 0, verified.sentence()


# The shipped worlds, flown by the nodes: the bits of the core, verified from the log.


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
