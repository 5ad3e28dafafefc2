# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One more row in the table of interfaces: recorded when somebody publishes it, and replayed."""

import numpy as np
import pytest
from inside import inside
from scenarios import lasting

from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import Interface
from rpo_ctrl.controller_node import ControllerNode
from rpo_log.recorder_node import RecorderNode
from rpo_log.replay_node import ReplayNode
from rpo_log.verify import verify
from rpo_mcap.read.run_log import read_run
from rpo_ros.signals import Outlet, listen
from rpo_sim.plant_node import PlantNode

TOY = 'toy_force'


@pytest.fixture
def toy(monkeypatch):
    """One more row, for this test."""
    monkeypatch.setattr(interfaces, '_TABLE', dict(interfaces._TABLE))
    return interfaces.add(Interface(TOY, interfaces.FORCE_TYPE, 'a toy'))


def test_it_is_recorded_and_replayed(ros_env, tmp_path, toy):
    with inside() as inner:
        outlet = Outlet(inner.user, TOY)

        def answer(stamp_ns, state):
            outlet.publish(stamp_ns, state[:3])

        listen(inner.user, interfaces.RELATIVE_STATE, answer, print)
        inner.start(ControllerNode({'controller': 'handmade'}))
        recorder = inner.start(RecorderNode({'output': str(tmp_path / 'run')}))
        inner.start(PlantNode({'scenario': lasting(2.0, tmp_path), 'wait_for_recorder': True}))
        inner.until(lambda: recorder.done)
    assert recorder.exit_code == 0
    log = read_run(tmp_path / 'run')
    np.testing.assert_array_equal(log.values[TOY], log.states[:, :3])
    assert verify(tmp_path / 'run').exit_code == 0
    heard = []
    with inside() as inner:
        listen(inner.user, TOY, lambda stamp_ns, values: heard.append(values), print)
        replay = inner.start(ReplayNode({'bag': str(tmp_path / 'run'), 'rate': 20.0}))
        inner.until(lambda: replay.done)
        inner.until(lambda: len(heard) >= len(log.ticks))
    np.testing.assert_array_equal(np.array(heard), log.values[TOY])


def test_without_a_publisher_the_run_does_not_have_it(ros_env, tmp_path, toy):
    with inside() as inner:
        inner.start(ControllerNode({'controller': 'handmade'}))
        recorder = inner.start(RecorderNode({'output': str(tmp_path / 'run')}))
        inner.start(PlantNode({'scenario': lasting(2.0, tmp_path), 'wait_for_recorder': True}))
        inner.until(lambda: recorder.done)
    assert recorder.exit_code == 0
    assert TOY not in read_run(tmp_path / 'run').values
