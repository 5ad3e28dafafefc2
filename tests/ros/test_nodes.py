# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The nodes as people start, stop and abuse them."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from flights import lasting
from landing import rest_at_landing

from rpo_bringup import final_approach
from rpo_core import files
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import DEFAULT_CONTROLLER
from rpo_core.scenario.scenario import load_scenario
from rpo_ctrl.fuzzy_controller_node import ControllerNode
from rpo_log.read.run_log import flight_of, read_run
from rpo_log.recorder_node import RecorderNode
from rpo_log.replay_node import ReplayNode
from rpo_log.verify import verify
from rpo_ros.entry_point import start_node
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode
from rpo_sim.fault_injector_node import FaultInjectorNode
from rpo_sim.plant_node import PlantNode

ROOT = Path(__file__).resolve().parents[2]
FLIGHT = 'run', 'rpo_bringup', 'final_approach'
OURS = sys.executable, str(ROOT / 'ros_ws' / 'underlay' / 'bin' / 'ros2'), *FLIGHT
STOCK = str(ROOT / 'tests' / 'system' / 'stock' / 'ros2'), *FLIGHT


@pytest.mark.parametrize(
    ('command', 'number', 'to_all'),
    rest_at_landing(
        [
            (OURS, signal.SIGINT, True),
            (OURS, signal.SIGINT, False),
            (STOCK, signal.SIGINT, True),
        ]
    ),
)
def test_a_signal_in_flight_leaves_a_readable_log(ros, command, number, to_all):
    """The exit code is 130, so that a shell does not go on behind `&&`."""
    output = ros.folder / 'run'
    options = ('--scenario', 'paper_test', '--output', str(output), '--real-time-factor', '20')
    node = ros.node('rpo_bringup', 'final_approach', *options, command=command)
    node.says('flying')
    node.send(number) if to_all else node.process.send_signal(number)
    assert node.wait() == 130, node.output
    assert 'Traceback' not in node.output
    log = read_run(output)
    assert not log.damage and (output / 'metadata.yaml').exists()
    expected = fly(load_scenario('paper_test'), load_controller(DEFAULT_CONTROLLER))
    np.testing.assert_array_equal(log.states, expected.states[: len(log.ticks)])
    assert log.outcome == 'aborted'


@pytest.mark.every_landing
def test_nohup_lets_a_flight_go_on(ros):
    output = ros.folder / 'run'
    options = ('--scenario', lasting(20.0, ros.folder), '--output', str(output), '--no-report')
    begin = ('nohup', *OURS)
    node = ros.node('rpo_bringup', 'final_approach', *options, command=begin)
    node.says('flying')
    assert node.stop(signal.SIGHUP) == 0, node.output
    assert read_run(output).complete


BEFORE = """
import os, signal, sys, types
from rpo_ros import entry_point
sys.modules['early'] = types.SimpleNamespace(main=lambda: os.kill(os.getpid(), signal.SIGHUP))
entry_point.start('early', int(sys.argv[1]))
"""


@pytest.mark.parametrize('code', [0, 130])
def test_a_signal_before_a_command_has_begun_has_the_code_of_one_after(code):
    assert subprocess.run([sys.executable, '-c', BEFORE, str(code)], timeout=30).returncode == code


BAD = {
    'a set of scenarios': (PlantNode, {'scenario': 'paper_training'}, ['set of 216']),
    'injector, unknown': (DisturbanceInjectorNode, {'scenario': 'nope'}, ["'nope'"]),
    'a field of a file': (
        ControllerNode,
        {'controller': 'mine.yaml'},
        ['mine.yaml', 'rules.SP[SP]', "'XL'", 'LN, SN, Z'],
    ),
    'an existing run': (RecorderNode, {'output': 'run'}, ['overwrite']),
    'no home': (RecorderNode, {'output': '~nosuchuser/x'}, ['`output`', 'no such home folder']),
    'no folder': (
        RecorderNode,
        {'output': '/dev/null'},
        ['/dev/null: cannot hold a log: File exists (parameter `output`)'],
    ),
    'below no folder': (
        RecorderNode,
        {'output': '/dev/null/x'},
        ['Not a directory (parameter `output`)'],
    ),
    'no such file': (ControllerNode, {'controller': 'no.yaml'}, ['no file']),
    'no table of thrusters': (PlantNode, {'thruster': 'none off'}, ['`thruster`: a switch']),
    'no such thruster': (
        PlantNode,
        {'scenario': 'tumbling_docking', 'thruster': 'none off'},
        ['`thruster`: a switch'],
    ),
    'no log': (ReplayNode, {'bag': '.'}, ['holds no run.mcap']),
    'one topic': (
        FaultInjectorNode,
        {'from_topic': '/control_force', 'to_topic': 'control_force'},
        ['`to_topic` must differ'],
    ),
    'unknown message': (
        FaultInjectorNode,
        {'from_topic': 'a', 'to_topic': 'b'},
        ['`message` must be state or force'],
    ),
}


@pytest.mark.parametrize('case', BAD)
def test_bad_input_is_one_sentence_and_nothing_starts(command, case, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shipped = files.shipped('controller')['handmade'].read_text()
    wrong = shipped.replace('SP: [SN, Z, SP, SP, LP]', 'SP: [SN, Z, SP, XL, LP]')
    (tmp_path / 'mine.yaml').write_text(wrong)
    (tmp_path / 'run').mkdir()
    (tmp_path / 'run' / 'run.mcap').write_bytes(b'precious')
    kind, parameters, said = BAD[case]
    code, output = command(kind.main, **parameters)
    assert code == 2
    (line,) = output.splitlines()
    assert all(text in line for text in said) and ']: ' in line
    assert (tmp_path / 'run' / 'run.mcap').read_bytes() == b'precious'


def test_arguments_that_are_not_parameters_or_have_a_wrong_value_are_refused(command):
    code, said = command(lambda: start_node('rpo_sim.plant_node'), 'scenario:=quick')
    assert code == 2 and '--ros-args -p' in said
    code, said = command(final_approach.main, '--start-timeout-s', -1)
    assert code == 2 and '`start_timeout_s`' in said and '-1' in said


def test_nobody_there_says_who_is_missing(command):
    code, said = command(PlantNode.main, scenario='paper_test', start_timeout_s=0.3)
    assert code == 3
    assert 'no answer in time from control_force, disturbance_force' in said
    roles = [line.split('nobody publishes ')[1] for line in said.splitlines() if 'nobody' in line]
    assert roles == [
        '/control_force: start `ros2 run rpo_ctrl fuzzy_controller`',
        '/disturbance_force: start `ros2 run rpo_sim disturbance_injector`',
    ]


@pytest.mark.every_landing
def test_a_flight_over_an_older_one_verifies_after_its_report(command, tmp_path):
    """The digests listed the picture of the older flight, which the report draws again."""
    output = tmp_path / 'run'
    (output / 'report').mkdir(parents=True)
    picture = output / 'report' / 'time_histories.png'
    picture.write_bytes(b'of an older flight')
    (output / 'run.mcap').write_bytes(b'an older flight')
    words = ('--scenario', 'quick', '--output', output)
    code, said = command(final_approach.main, *words)
    assert code == 2 and '`--overwrite`' in said
    code, said = command(final_approach.main, *words, '--overwrite', '--no-report')
    assert code == 0, said
    picture.write_bytes(b'of this flight')
    assert verify(output).exit_code == 0


@pytest.mark.parametrize(
    ('options', 'changes', 'code', 'word'),
    rest_at_landing(
        [
            ([], {'requirements': {'energy_n2s': 1e-3}}, 1, 'MISSED'),
            (['--no-report', '--no-fail'], {'zones': {'keep_out_m': 1000.0}}, 0, 'MISSED'),
            (['--no-report'], {'zones': {'keep_out_m': 1000.0}}, 1, 'MISSED'),
            (['--no-report'], {'requirements': {'energy_n2s': 1e-3}}, 0, ''),
            (['--no-fail'], {'requirements': {'energy_n2s': 1e-3}}, 0, 'MISSED'),
            ([], {'requirements': {'energy_n2s': 1e3}}, 0, 'holds'),
        ],
        quick=2,
    ),
)
def test_what_is_missed_is_1(options, changes, code, word, command, tmp_path):
    """`final_approach` judges the flight that it recorded; a zone without a report too."""
    path = lasting(5.0, tmp_path, 'quick', **changes)
    words = ('--scenario', path, '--output', tmp_path / 'run', *options)
    found, said = command(final_approach.main, *words)
    assert found == code, said
    assert word in said and ('MISSED' in said) == (word == 'MISSED')


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
    alpha, beta = (flight_of(read_run(ros.folder / name)) for name in ('alpha', 'beta'))
    np.testing.assert_array_equal(alpha.states, beta.states)
