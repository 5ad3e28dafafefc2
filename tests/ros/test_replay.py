# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Replay: the logged bytes on the topics again, and a live controller held against a log."""

import re
from functools import partial

import pytest
import yaml
from inside import inside
from log_parts import write_bag
from rosbags.rosbag2 import StoragePlugin

import rpo_core.files
from rpo_core.wire import interfaces
from rpo_ctrl.fuzzy_controller_node import ControllerNode
from rpo_log import replay_node
from rpo_log.read.stream import RunReader
from rpo_log.replay_node import ReplayNode
from rpo_ros import qos
from rpo_ros.signals import message_class
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode


@pytest.fixture
def run_folder(ros_env, tmp_path_factory):
    """A run of the scenario `quick`, flown by the first test that asks for it."""
    folder = tmp_path_factory.getbasetemp() / 'replayed'
    if not folder.exists():
        with inside() as found:
            found.fly(folder, 'quick', DisturbanceInjectorNode, controller='allround')
            assert found.ends() == 0
    return folder


def logged(folder):
    """Return topic -> messages as hex, but for events."""
    found = {}
    for message in RunReader(folder).messages():
        if message.topic.signal != 'run_status':
            found.setdefault(message.topic.name, []).append(message.data.hex())
    return found


def test_the_logged_bytes_are_published_again(run_folder, inner, capfd, monkeypatch):
    monkeypatch.setattr(replay_node, '_PATIENCE_S', 30.0)
    expected, heard = logged(run_folder), {}
    for name in expected:
        row = interfaces.row_of(name[1:])
        take = partial(lambda name, data: heard.setdefault(name, []).append(data.hex()), name)
        inner.user.create_subscription(message_class(row.type), name, take, qos.RECORDING, raw=True)
    replay = inner.start(ReplayNode({'bag': str(run_folder), 'rate': 5.0}))
    inner.until(lambda: replay.done)
    inner.until(lambda: heard == expected)
    assert replay.exit_code == 0 and '51 ticks replayed' in capfd.readouterr().err


@pytest.fixture
def bag(run_folder, tmp_path):
    """The same run as another recorder writes it: sqlite3, of a namespace, wall-clock times."""
    messages = [(m.topic.name, m.tick, m.data) for m in RunReader(run_folder).messages()]
    return write_bag(tmp_path / 'bag', messages, '/a', StoragePlugin.SQLITE3)


@pytest.fixture
def replay(run_folder, inner):
    """Return a function that begins to replay that run, driving a controller."""

    def begin(**parameters):
        asked = {'bag': str(run_folder), 'drive': True, 'rate': 0.0, **parameters}
        return inner.start(ReplayNode(asked))

    return begin


def test_the_same_controller_answers_as_logged(bag, replay, inner, monkeypatch, capfd):
    """It was silent from tick 0 to its end, and while no controller was there."""
    monkeypatch.setattr(replay_node, '_SAY_EVERY_S', 0.1)
    node = replay(bag=str(bag), rate=5.0)
    said = []
    inner.until(lambda: said.append(capfd.readouterr().err) or 'waiting for control_f' in said[-1])
    inner.start(ControllerNode())
    inner.until(lambda: node.done)
    said = capfd.readouterr().err
    assert node.exit_code == 0 and '51 ticks replayed; 0 answers differ from the log' in said
    assert re.search(r'tick \d+ of 50', said)


def test_another_controller_is_found_out(replay, inner, tmp_path, capfd):
    path = rpo_core.files.shipped('controller')['allround']
    document = yaml.safe_load(path.read_text())
    document['scales']['position_m'] *= 1.0 + 1e-12
    other = tmp_path / 'other.yaml'
    other.write_text(yaml.safe_dump(document))
    inner.start(ControllerNode({'controller': str(other)}))
    node = replay()
    inner.until(lambda: node.done)
    assert node.exit_code == 1 and 'tick 0: logged' in capfd.readouterr().err


def test_no_controller_is_said_and_not_waited_for_for_ever(replay, inner, capfd):
    node = replay(answer_timeout_s=0.3)
    inner.until(lambda: node.done)
    assert node.exit_code == 3 and 'no answer' in capfd.readouterr().err
