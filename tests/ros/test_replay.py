# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Replay: the logged bytes on the topics again, and a live controller held against a log."""

import re
import time
from functools import partial

import pytest
import yaml
from inside import inside
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from std_srvs.srv import SetBool

import rpo_core.files
from rpo_core.wire import interfaces
from rpo_ctrl.controller_node import ControllerNode
from rpo_log.replay_node import ReplayNode
from rpo_mcap.read.stream import RunReader
from rpo_ros import qos
from rpo_ros.signals import message_class
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('replayed') / 'run'


@pytest.fixture
def run_folder(folder, ros_env):
    """A run of the scenario `quick`, flown by the first test that asks for it."""
    if not folder.exists():
        with inside() as inner:
            inner.fly(folder, 'quick', DisturbanceInjectorNode, controller='allround')
            assert inner.ends() == 0
    return folder


def logged(folder, first, last):
    """Return topic -> messages as hex, of the ticks first..last."""
    found = {}
    for message in RunReader(folder).messages():
        if first <= message.tick <= last and message.topic.signal != 'run_status':
            found.setdefault(message.topic.name, []).append(message.data.hex())
    return found


def test_the_logged_bytes_are_published_again(ros_env, run_folder, capfd):
    expected, heard = logged(run_folder, 10, 20), {}
    with inside() as inner:
        for name in expected:
            row = interfaces.row_of(name[1:])
            take = partial(lambda name, data: heard.setdefault(name, []).append(data.hex()), name)
            inner.user.create_subscription(
                message_class(row.type), name, take, qos.RECORDING, raw=True
            )
        asked = {'bag': str(run_folder), 'rate': 2.0, 'start_s': 1.0, 'end_s': 2.0, 'delay_s': 30.0}
        replay = inner.start(ReplayNode(asked))
        inner.until(lambda: replay.done)
        inner.until(lambda: heard == expected)
    assert replay.exit_code == 0 and '11 ticks replayed' in capfd.readouterr().err


@pytest.fixture
def bag(run_folder, tmp_path):
    """The same run as another recorder writes it: sqlite3, of a namespace, wall-clock times."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer(tmp_path / 'bag', version=8, storage_plugin=StoragePlugin.SQLITE3) as bag:
        known = {}
        for number, (topic, _, data) in enumerate(RunReader(run_folder).messages()):
            if topic.signal not in known:
                name = '/a' + topic.name if topic.signal != 'clock' else topic.name
                known[topic.signal] = bag.add_connection(name, topic.type, typestore=store)
            bag.write(known[topic.signal], 10**18 + number, data)
    return tmp_path / 'bag'


@pytest.mark.every_landing
def test_the_same_controller_answers_as_logged(ros, bag):
    """It was silent from tick 0 to its end, and while no controller was there."""
    node = ros.node('rpo_log', 'replay', bag=bag, drive='true', rate=1.0)
    node.says('waiting for control_force')
    ros.node('rpo_ctrl', 'fuzzy_controller')
    assert node.wait() == 0, node.output
    assert re.search(r'tick \d+ of 50', node.output)
    node.says('51 ticks replayed; 0 answers differ from the log')


@pytest.mark.every_landing
def test_a_plain_replay_says_how_far_it_is(ros, run_folder):
    node = ros.node('rpo_log', 'replay', bag=run_folder, rate=1.0, delay_s=2.5)
    node.says('waiting for listeners')
    assert node.wait() == 0, node.output
    assert re.search(r'tick \d+ of 50', node.output)


def test_a_long_pause_times_out_no_controller(ros, run_folder):
    with inside() as inner:
        inner.start(ControllerNode({'scenario': 'quick'}))
        asked = {'bag': str(run_folder), 'drive': True, 'rate': 5.0, 'answer_timeout_s': 1.0}
        node = inner.start(ReplayNode(asked))
        inner.until(lambda: node._played > 1)
        inner.call(SetBool, '/replay/pause', SetBool.Request(data=True))
        end = time.monotonic() + 1.2
        inner.until(lambda: time.monotonic() > end)
        inner.call(SetBool, '/replay/pause', SetBool.Request(data=False))
        inner.until(lambda: node.done)
    assert node.exit_code == 0 and node.differences == 0


@pytest.mark.every_landing
def test_another_controller_is_found_out(ros, run_folder):
    path = rpo_core.files.shipped('controller')['handmade']
    document = yaml.safe_load(path.read_text())
    document['scales']['position_m'] *= 1.0 + 1e-12
    other = ros.folder / 'other.yaml'
    other.write_text(yaml.safe_dump(document))
    ros.node('rpo_ctrl', 'fuzzy_controller', controller=other)
    node = ros.node('rpo_log', 'replay', bag=run_folder, drive='true', rate=0.0)
    assert node.wait() == 1, node.output
    node.says('tick 0: logged')


@pytest.mark.every_landing
def test_no_controller_is_said_and_not_waited_for_for_ever(ros, run_folder):
    node = ros.node(
        'rpo_log', 'replay', bag=run_folder, drive='true', rate=0.0, answer_timeout_s=1.0
    )
    assert node.wait() == 3
    assert 'no answer' in node.output


def test_a_folder_without_a_log_is_refused(ros):
    node = ros.node('rpo_log', 'replay', bag=ros.folder)
    assert node.wait() == 2
    assert 'holds no run.mcap' in node.output
