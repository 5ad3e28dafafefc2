# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The recorder and the manifests: one that is late, and a controller that has none."""

import time

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from inside import inside
from rosgraph_msgs.msg import Clock
from scenarios import lasting

import rpo_log.recorder_node
from rpo_core import files
from rpo_ctrl.controller_node import ControllerNode
from rpo_log.recorder_node import RecorderNode
from rpo_log.verify import verify
from rpo_mcap.read.run_log import read_run
from rpo_ros import health, names, qos
from rpo_sim.plant_node import PlantNode

LATE = 'late_manifest'
ASIDE = ['-r', f'fuzzy_controller:{names.NODE_MANIFEST}:={LATE}']
"""The controller's manifest goes elsewhere, from where the test may pass it on."""


@pytest.fixture
def two_seconds(tmp_path):
    return lasting(2.0, tmp_path)


def start(inner, scenario, folder):
    """Start controller, plant and recorder; return the last."""
    inner.start(ControllerNode({'controller': 'handmade'}))
    recorder = inner.start(RecorderNode({'output': str(folder)}))
    inner.start(PlantNode({'scenario': scenario, 'wait_for_recorder': True}))
    return recorder


def test_a_late_manifest_is_waited_for_however_much_is_heard_before(ros_env, tmp_path, two_seconds):
    with inside(ASIDE) as inner:
        held = []
        inner.user.create_subscription(DiagnosticStatus, LATE, held.append, qos.LATCHED)
        onward = inner.user.create_publisher(DiagnosticStatus, names.NODE_MANIFEST, qos.LATCHED)
        clock = inner.user.create_publisher(Clock, names.CLOCK, qos.CLOCK)
        recorder = start(inner, two_seconds, tmp_path / 'run')
        inner.until(lambda: held and clock.get_subscription_count())
        for _ in range(500):
            clock.publish(Clock())
            inner.executor.spin_once(timeout_sec=0.0)
        inner.until(lambda: recorder._health()[2]['backlog'] > 450)
        after = time.monotonic() + 0.2
        inner.until(lambda: time.monotonic() > after)
        assert recorder.log is None
        onward.publish(held[0])
        inner.until(lambda: recorder.done)
    assert recorder.exit_code == 0
    assert set(read_run(tmp_path / 'run').attachments) == {
        'controller.yaml', 'parameters.yaml', 'scenario.yaml',
    }  # fmt: skip


def test_a_controller_without_a_manifest_is_recorded_in_the_end(
    ros_env, tmp_path, two_seconds, monkeypatch
):
    monkeypatch.setattr(rpo_log.recorder_node, 'MANIFEST_PATIENCE_S', 0.2)
    with inside(ASIDE) as inner:
        recorder = start(inner, two_seconds, tmp_path / 'run')
        inner.until(lambda: recorder.done)
    log = read_run(tmp_path / 'run')
    assert len(log.ticks) == 21
    assert set(log.attachments) == {'parameters.yaml', 'scenario.yaml'}


# fmt: off
ODD_NAMES = [
    '[draft] one', '@x', 'a: b', '2026-02-30', '2026-01-01', '1e3', 'true', '', '{a', '- b', "it's",
    '"quoted"', '*', '&a', '!tag', '#1', '%', 'null', 'é', 'a\tb', 'yes', '0x10',
]
# fmt: on


@pytest.mark.parametrize('name', ODD_NAMES)
def test_a_name_is_read_back_as_what_it_was(name):
    assert yaml.safe_load(health.as_yaml(name)) == name


def test_plain_names_stay_plain():
    assert [health.as_yaml(v) for v in ('paper_test', 2, True)] == ['paper_test', '2', 'True']


def test_a_controller_of_an_odd_name_is_recorded(ros_env, tmp_path, two_seconds):
    text = files.find('controller', 'handmade').read_text()
    path = tmp_path / 'mine.yaml'
    path.write_text(text.replace('name: handmade', 'name: "[draft] one: @x"'))
    with inside() as inner:
        inner.start(ControllerNode({'controller': str(path)}))
        recorder = inner.start(RecorderNode({'output': str(tmp_path / 'run')}))
        inner.start(PlantNode({'scenario': two_seconds, 'wait_for_recorder': True}))
        inner.until(lambda: recorder.done)
    assert recorder.exit_code == 0
    attached = yaml.safe_load(read_run(tmp_path / 'run').attachments['parameters.yaml'])
    assert attached['fuzzy_controller']['controller'] == '[draft] one: @x'
    assert verify(tmp_path / 'run').exit_code == 0
