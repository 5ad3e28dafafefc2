# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The recorder when it is killed, and when the disk fails it: what is left, and what is said."""

import os
import random
import re
import signal
import subprocess
import time

import numpy as np
import pytest
from inside import inside
from landing import rest_at_landing

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.scenario import load_scenario
from rpo_log.recorder_node import _MOST_TAKEN, RecorderNode
from rpo_mcap.read.run_log import read_run

KILL_BOUND = 0.95
"""Share of the ticks so far that is left after `kill -9`."""


def start(ros, output, **parameters):
    """Start controller, recorder and plant on `approach`; return the last two, in flight."""
    ros.node('rpo_ctrl', 'fuzzy_controller', controller='handmade')
    recorder = ros.node('rpo_log', 'recorder', output=str(output))
    plant = ros.node('rpo_sim', 'plant', wait_for_recorder='true', **parameters)
    plant.says('flying')
    return recorder, plant


def end_in_flight(ros, number, after_s, **parameters):
    """End the recorder by a signal, the plant held still meanwhile; return (ticks flown, log)."""
    output = ros.folder / 'run'
    recorder, plant = start(ros, output, **parameters)
    time.sleep(after_s)
    plant.process.send_signal(signal.SIGSTOP)
    time.sleep(0.3)  # what is on its way arrives
    recorder.process.send_signal(number)
    code = recorder.wait()
    assert code == (-signal.SIGKILL if number == signal.SIGKILL else 0), recorder.output
    plant.process.send_signal(signal.SIGTERM)  # before it runs again: it flies no more ticks
    plant.process.send_signal(signal.SIGCONT)
    plant.wait()
    tick = re.search(r'(?:aborted at tick |finished at )(\d+)', plant.output)
    assert tick, plant.output
    return int(tick[1]), read_run(output)


def check(flown, log, number):
    expected = fly(load_scenario('approach'), load_controller('handmade'))
    count = len(log.ticks)
    if np.isnan(log.states[-1]).any():  # the plant was held between /clock and state
        count -= 1
    np.testing.assert_array_equal(log.states[:count], expected.states[:count])
    least = KILL_BOUND * flown if number == signal.SIGKILL else flown - 1
    assert count >= least, f'{count} of {flown} ticks are left'


@pytest.mark.every_landing
def test_a_plant_waits_for_a_recorder_that_gets_no_processor(ros):
    """At full speed; the log is whole, and the flight goes on when the recorder does."""
    output = ros.folder / 'run'
    recorder, plant = start(ros, output)
    for _ in range(3):
        recorder.process.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        recorder.process.send_signal(signal.SIGCONT)
        time.sleep(0.2)
    assert plant.wait() == 0, plant.output
    assert recorder.wait() == 0, recorder.output
    assert 'does not keep up' not in plant.output
    log = read_run(output)
    check(len(log.ticks), log, signal.SIGKILL)
    assert len(log.ticks) == load_scenario('approach').ticks + 1


@pytest.mark.slow
def test_the_recorder_killed_in_flight_leaves_what_was_flown(ros):
    flown, log = end_in_flight(ros, signal.SIGKILL, after_s=1.5, real_time_factor=40.0)
    check(flown, log, signal.SIGKILL)


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize('trial', rest_at_landing(range(8), quick=0, landing=1))
def test_the_recorder_ended_at_any_moment(ros, number, trial):
    moment = random.Random(1000 * trial + number).uniform(0.05, 4.0)
    flown, log = end_in_flight(ros, number, after_s=moment, real_time_factor=80.0)
    check(flown, log, number)


@pytest.mark.slow
def test_a_full_disk_ends_the_log_not_the_flight(ros):
    if os.geteuid() != 0:
        pytest.skip('a tmpfs can be mounted by root only')
    disk = ros.folder / 'disk'
    disk.mkdir()
    subprocess.run(['mount', '-t', 'tmpfs', '-o', 'size=256k', 'tmpfs', str(disk)], check=True)
    try:
        recorder, plant = start(ros, disk / 'run', real_time_factor=80.0)
        assert plant.wait() == 0, plant.output
        assert recorder.wait() == 1
        assert 'No space left' in recorder.output
        log = read_run(disk / 'run')
        check(len(log.ticks), log, signal.SIGKILL)
        assert len(log.ticks) > 100
    finally:
        subprocess.run(['umount', str(disk)], check=True)


@pytest.mark.every_landing
def test_a_recorder_says_what_it_waits_for_and_is_no_success(ros):
    """It said nothing, and exited 0 with an empty folder."""
    recorder = ros.node('rpo_log', 'recorder', output=str(ros.folder / 'run'))
    recorder.says('waiting for the manifest of the plant on /node_manifest')
    plant = ros.node('rpo_sim', 'plant', scenario='paper_test', wait_for_recorder='true')
    recorder.says('waiting for the manifest of the controller and of the disturbance on')
    ros.node('rpo_ctrl', 'fuzzy_controller', remap={'control_force': 'nobody'})
    ros.node('rpo_sim', 'disturbance_injector')
    plant.says('waiting for control_force')
    recorder.says('waiting for messages on /clock, /control_force')
    assert recorder.stop() == 1, recorder.output
    assert 'nothing was recorded: it waited for messages on /clock' in recorder.output
    assert 'Traceback' not in recorder.output


class Queue:
    """A subscription with messages, each with the time at which it came."""

    msg_type = None

    def __init__(self, *times):
        self.times, self.handle = list(times), self

    def take_message(self, _kind, raw):
        return (b'', {'received_timestamp': self.times.pop(0)}) if raw and self.times else None


def test_messages_are_passed_on_as_they_came_and_a_flood_leaves_time_for_the_rest(
    ros_env, tmp_path, monkeypatch
):
    """Out of the executor: an answer that came before its state may be somebody else's."""
    with inside() as inner:
        recorder = inner.start(RecorderNode({'output': str(tmp_path / 'run')}))
        heard = {made.topic_name for made in recorder.subscriptions}
        assert not heard & {'/relative_state', '/control_force'} and '/run_status' in heard
        flood = Queue(*range(100, 5000))
        queues = {Queue(3, 5): '/control_force', flood: '/clock', Queue(2, 4): '/relative_state'}
        monkeypatch.setattr(recorder, '_queues', queues)
        passed = []
        monkeypatch.setattr(recorder, '_on_raw', lambda name, data: passed.append(name))
        recorder._take()
        assert passed[:4] == ['/relative_state', '/control_force'] * 2
        assert len(passed) == 4 + _MOST_TAKEN
        assert set(passed[4:]) == {'/clock'} and len(flood.times) == 4900 - _MOST_TAKEN
