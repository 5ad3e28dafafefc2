# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes as people start, stop and abuse them."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flights import lasting
from landing import rest_at_landing

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import DEFAULT_CONTROLLER, scenario
from rpo_core.files.scenario import load_scenario
from rpo_core.judge.requirements import Requirements
from rpo_log.verify import verify
from rpo_mcap.read.run_log import read_flight, read_run

NODES = {
    'plant': ('rpo_sim', {}),
    'disturbance_injector': ('rpo_sim', {}),
    'fuzzy_controller': ('rpo_ctrl', {}),
    'recorder': ('rpo_log', {}),
}


def test_a_controller_waits_for_its_plant_and_they_fly_approach(ros):
    """The README starts them the other way round."""
    controller = ros.node('rpo_ctrl', 'fuzzy_controller')
    controller.says('controlling with')
    plant = ros.node('rpo_sim', 'plant', scenario=lasting(60.0, ros.folder))
    assert plant.wait() == 0, plant.output
    plant.says('finished at 60 s')
    assert controller.stop() == 0
    assert not any('Traceback' in node.output for node in ros.nodes)


@pytest.mark.parametrize(
    'number', [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.slow)]
)
def test_a_signal_ends_every_node_cleanly(ros, number):
    started = [
        (
            ros.node('rpo_sim', 'plant', scenario='paper_test', wait_for_recorder='true'),
            'waiting for',
        ),
        (ros.node('rpo_sim', 'disturbance_injector'), 'disturbing as'),
        (ros.node('rpo_ctrl', 'fuzzy_controller'), 'controlling with'),
        (ros.node('rpo_log', 'recorder', output=str(ros.folder / 'run')), 'recording'),
    ]
    for node, text in started:
        node.says(text)
    for node, _ in started:
        assert node.stop(number) == 0, node.output
        assert 'Traceback' not in node.output


@pytest.mark.parametrize(
    'number', [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_a_signal_in_flight_leaves_a_readable_log(ros, number):
    output = ros.folder / 'run'
    options = ('--scenario', 'paper_test', '--output', str(output), '--real-time-factor', '20')
    node = ros.node('rpo_bringup', 'final_approach', *options)
    node.says('flying')
    assert node.stop(number) == 0, node.output
    assert 'Traceback' not in node.output
    log = read_run(output)
    expected = fly(load_scenario('paper_test'), load_controller(DEFAULT_CONTROLLER))
    count = len(log.ticks)
    np.testing.assert_array_equal(log.states, expected.states[:count])
    assert log.outcome == 'aborted'


BAD = {
    'a set of scenarios': ('plant', {'scenario': 'paper_training'}, ['set of 216']),
    'text for a number': ('plant', {'real_time_factor': 'fast'}, ['`real_time_factor`', 'fast']),
    'a number for a text': ('fuzzy_controller', {'controller': '3'}, ['`controller`', '3']),
    'injector, unknown': ('disturbance_injector', {'scenario': 'nope'}, ["'nope'"]),
}


@pytest.mark.parametrize('case', rest_at_landing(BAD))
def test_bad_input_is_one_sentence_and_nothing_starts(ros, case):
    name, parameters, said = BAD[case]
    node = ros.node(NODES[name][0], name, **parameters)
    assert node.wait() == 2
    lines = [line for line in node.output.splitlines() if line.strip()]
    assert len(lines) == 1, node.output
    assert all(text in lines[0] for text in said), lines[0]
    assert f'[{name}]: ' in lines[0]


def test_a_bad_controller_file_is_named_with_its_field(ros):
    path = ros.folder / 'mine.yaml'
    shipped = Path(__file__).parents[2] / 'ros_ws/src/rpo_ctrl/config/controllers/handmade.yaml'
    path.write_text(
        shipped.read_text().replace('SP: [SN, Z, SP, SP, LP]', 'SP: [SN, Z, SP, XL, LP]')
    )
    node = ros.node('rpo_ctrl', 'fuzzy_controller', controller=str(path))
    assert node.wait() == 2
    assert all(text in node.output for text in (str(path), 'rules.SP[SP]', "'XL'", 'LN, SN, Z'))


def test_an_existing_run_is_not_overwritten(ros):
    output = ros.folder / 'run'
    output.mkdir()
    (output / 'run.mcap').write_bytes(b'precious')
    node = ros.node('rpo_log', 'recorder', output=str(output))
    assert node.wait() == 2
    assert (output / 'run.mcap').read_bytes() == b'precious'
    assert 'overwrite' in node.output


@pytest.mark.every_landing
def test_a_flight_over_an_older_one_verifies_after_its_report(ros):
    """The digests listed the picture of the older flight, which the report draws again."""
    output = ros.folder / 'run'
    (output / 'report').mkdir(parents=True)
    picture = output / 'report' / 'time_histories.png'
    picture.write_bytes(b'of an older flight')
    (output / 'run.mcap').write_bytes(b'an older flight')
    arguments = ['final_approach', '--scenario', 'quick', '--output', str(output)]
    refused = ros.node('rpo_bringup', *arguments)
    assert refused.wait() == 2 and '`--overwrite`' in refused.output
    again = ros.node('rpo_bringup', *arguments, '--overwrite', '--no-report')
    assert again.wait() == 0, again.output
    picture.write_bytes(b'of this flight')
    assert verify(output).exit_code == 0


def test_arguments_that_are_not_parameters_are_refused(ros):
    node = ros.node('rpo_sim', 'plant', 'scenario:=quick')
    assert node.wait() == 2
    assert '--ros-args -p' in node.output


def test_nobody_there_says_who_is_missing(ros):
    node = ros.node('rpo_sim', 'plant', scenario='paper_test', start_timeout_s=0.3)
    assert node.wait() == 3
    assert 'no answer in time from control_force, disturbance_force' in node.output


@pytest.mark.every_landing
@pytest.mark.parametrize(
    ('reaction', 'code'), [pytest.param('abort', 3, marks=pytest.mark.slow), ('coast', 0)]
)
def test_a_controller_killed_in_flight(ros, reaction, code):
    output = ros.folder / 'run'
    controller = ros.node('rpo_ctrl', 'fuzzy_controller')
    recorder = ros.node('rpo_log', 'recorder', output=str(output))
    plant = ros.node(
        'rpo_sim',
        'plant',
        scenario=lasting(20.0, ros.folder),
        real_time_factor=10.0,
        peer_timeout_s=0.5,
        on_peer_timeout=reaction,
        wait_for_recorder='true',
    )
    plant.says('flying')
    controller.process.kill()
    assert plant.wait() == code, plant.output
    assert 'from control_force' in plant.output
    recorder.wait()
    assert read_run(output).outcome == {'abort': 'aborted', 'coast': 'finished'}[reaction]


@pytest.mark.every_landing
def test_a_plant_killed_in_flight_leaves_a_closed_log(ros):
    output = ros.folder / 'run'
    ros.node('rpo_ctrl', 'fuzzy_controller')
    recorder = ros.node('rpo_log', 'recorder', output=str(output), plant_timeout_s=2.0)
    plant = ros.node('rpo_sim', 'plant', real_time_factor=20.0, wait_for_recorder='true')
    plant.says('flying')
    plant.process.kill()
    recorder.says('the plant is gone', 12.0)  # DDS alone would take 20 s
    assert recorder.wait() == 1
    expected = fly(load_scenario('approach'), load_controller(DEFAULT_CONTROLLER))
    states = read_run(output).states
    if np.isnan(states[-1]).any():  # it died between /clock and state
        states = states[:-1]
    np.testing.assert_array_equal(states, expected.states[: len(states)])


STUCK = """
import sys
from rpo_ros import entry_point, running
entry_point.LONGEST_END_S = 0.5
class Stuck(running.FlightNode):
    def __init__(self):
        super().__init__('stuck')
        self.done = True
    def destroy_node(self):
        while True:
            pass
sys.exit(Stuck.main())
"""


@pytest.mark.every_landing
def test_a_node_whose_middleware_does_not_stop_ends_and_says_where_it_was(ros_env):
    """A recorder that had closed its log used the processor for a minute, until it was killed."""
    done = subprocess.run(
        [sys.executable, '-c', STUCK], capture_output=True, text=True, timeout=30,
        env={**os.environ, **ros_env},
    )  # fmt: skip
    assert done.returncode == 1, done
    assert 'in destroy_node' in done.stderr


AT_EXIT = """
import ctypes, sys, types
from rpo_ros import entry_point
entry_point.LONGEST_END_S = 0.5
libc = ctypes.CDLL(None)
libc.__cxa_atexit(libc.pause, None, None)
sys.modules['ended'] = types.SimpleNamespace(main=lambda: 0)
sys.exit(entry_point.start('ended'))
"""


def test_a_process_whose_exit_handlers_do_not_return_ends():
    """Fast DDS was seen to spin in its exit handlers, after the interpreter, for seven minutes."""
    done = subprocess.run([sys.executable, '-c', AT_EXIT], timeout=30)
    assert done.returncode == -signal.SIGALRM


@pytest.mark.every_landing
def test_two_runs_in_two_namespaces_do_not_touch(ros):
    runs = []
    for name in ('alpha', 'beta'):
        options = ('--scenario', 'quick', '--output', f'{ros.folder}/{name}', '--no-report')
        remap = {'__ns': f'/{name}', '/clock': f'/{name}/clock'}
        runs.append(ros.node('rpo_bringup', 'final_approach', *options, remap=remap))
    assert [node.wait() for node in runs] == [0, 0], [node.output for node in runs]
    alpha, beta = (read_flight(ros.folder / name) for name in ('alpha', 'beta'))
    np.testing.assert_array_equal(alpha.states, beta.states)


@pytest.mark.parametrize(
    ('options', 'most_n2s', 'code', 'word'),
    [
        ([], 1e-3, 1, 'MISSED'),
        pytest.param(['--no-report'], 1e-3, 0, '', marks=pytest.mark.every_landing),
        pytest.param(['--no-fail'], 1e-3, 0, 'MISSED', marks=pytest.mark.slow),
        pytest.param([], 1e3, 0, 'holds', marks=pytest.mark.slow),
    ],
)
def test_a_requirement_that_is_missed_is_1(options, most_n2s, code, word, ros):
    """`final_approach` judges the flight that it recorded."""
    judged = replace(load_scenario('quick'), requirements=Requirements(energy_n2s=most_n2s))
    path = ros.folder / 'judged.yaml'
    path.write_text(scenario.dumps(judged))
    words = ('--scenario', str(path), '--output', f'{ros.folder}/run', *options)
    node = ros.node('rpo_bringup', 'final_approach', *words)
    assert node.wait() == code, node.output
    assert word in node.output and ('MISSED' in node.output) == (word == 'MISSED')
