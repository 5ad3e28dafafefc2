# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The recorder and the manifests: one that is late, and a controller that has none."""

import time

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from inside import inside
from rosgraph_msgs.msg import Clock
from scenarios import lasting

import rpo_log.recorder_node
from rpo_ctrl.controller_node import ControllerNode
from rpo_log.read.run_log import read_run
from rpo_log.recorder_node import RecorderNode
from rpo_ros import names, qos
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
