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
from flights import lasting, started
from inside import inside
from landing import rest_at_landing
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import DEFAULT_CONTROLLER
from rpo_core.scenario.scenario import load_scenario
from rpo_log import recorder_node
from rpo_log.errors import ExitCode
from rpo_log.read.run_log import read_run
from rpo_log.recorder_node import _MOST_TAKEN, RecorderNode
from rpo_log.tools.repair import repair
from rpo_log.verify import verify
from rpo_ros.running import new_executor

KILL_BOUND = 0.95
"""Share of the ticks so far that is left after `kill -9`."""


def flying(ros, output, **plant):
    """Start a flight of `approach`; return its recorder and plant."""
    _, recorder, flown = started(ros, output, 'rpo_ctrl fuzzy_controller', **plant).values()
    flown.says('flying')
    return recorder, flown


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize('trial', rest_at_landing(range(8), quick=0, landing=1))
def test_the_recorder_ended_at_any_moment(ros, number, trial):
    """The plant is held still meanwhile."""
    output = ros.folder / 'run'
    recorder, plant = flying(ros, output, real_time_factor=80.0)
    time.sleep(random.Random(1000 * trial + number).uniform(0.05, 4.0))
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
    log = read_run(output)
    check(int(tick[1]), log, number)
    mended = read_run(repair(output).output if log.damage else output)
    np.testing.assert_array_equal(mended.states, log.states)
    assert not mended.damage


def check(flown, log, number):
    expected = fly(load_scenario('approach'), load_controller(DEFAULT_CONTROLLER))
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
    recorder, plant = flying(ros, output)
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
def test_a_full_disk_ends_the_log_not_the_flight(ros):
    if os.geteuid() != 0:
        pytest.skip('a tmpfs can be mounted by root only')
    disk = ros.folder / 'disk'
    disk.mkdir()
    subprocess.run(['mount', '-t', 'tmpfs', '-o', 'size=256k', 'tmpfs', str(disk)], check=True)
    try:
        recorder, plant = flying(ros, disk / 'run', real_time_factor=80.0)
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
        if not raw or not self.times:
            return None
        time_ns = self.times.pop(0)
        return str(time_ns).encode(), {'received_timestamp': time_ns}


@pytest.fixture
def take(inner, tmp_path, monkeypatch):
    """Let a recorder take once, of queues by topic; return what it passed on."""
    passed = []
    recorder = inner.start(RecorderNode({'output': str(tmp_path / 'run')}))
    monkeypatch.setattr(recorder, '_on_raw', lambda name, data: passed.append((name, data)))

    def once(*queues):
        monkeypatch.setattr(recorder, '_queues', {queue: name for name, queue in queues})
        passed.clear()
        recorder._take()
        return [(name, int(data)) for name, data in passed]

    once.recorder = recorder
    return once


def test_messages_are_passed_on_as_they_came_and_a_flood_leaves_time_for_the_rest(take):
    """Out of the executor: an answer that came before its state may be somebody else's."""
    heard = {made.topic_name for made in take.recorder.subscriptions}
    assert not heard & {'/relative_state', '/control_force'} and '/run_status' in heard
    flood = Queue(*range(100, 5000))
    passed = take(('force', Queue(3, 5)), ('clock', flood), ('state', Queue(2, 4)))
    assert passed[:4] == [('state', 2), ('force', 3), ('state', 4), ('force', 5)]
    assert passed[4:] == [('clock', 100 + i) for i in range(_MOST_TAKEN)]
    assert len(flood.times) == 4900 - _MOST_TAKEN


def test_a_topic_with_more_messages_than_are_taken_at_once_holds_up_the_others(take, monkeypatch):
    """Two publish a topic while the recorder is stopped: the other topics ran ahead of it."""
    monkeypatch.setattr(recorder_node, '_MOST_TAKEN', 10)
    forces, states = Queue(*range(1, 41)), Queue(*range(2, 42, 2))
    passed = [message for _ in range(8) for message in take(('force', forces), ('state', states))]
    assert [time_ns for _, time_ns in passed] == sorted([*range(1, 41), *range(2, 42, 2)])


def test_of_messages_that_came_at_one_time_the_state_is_first(take):
    """A middleware that does not say when: a force far ahead of its state is ignored."""
    passed = take(('force', Queue(0, 0)), ('state', Queue(0, 0)))
    assert [name for name, _ in passed] == ['state', 'state', 'force', 'force']


def test_a_topic_stays_in_order_where_the_clock_of_the_machine_is_set_back(take):
    passed = take(('force', Queue(100, 101, 51, 52)), ('state', Queue(99, 100, 50, 51)))
    for name, order in (('force', [100, 101, 51, 52]), ('state', [99, 100, 50, 51])):
        assert [time_ns for topic, time_ns in passed if topic == name] == order


def test_a_recorder_that_hears_nothing_looks_less_often(take):
    """It used 7 % of a core to look into empty queues."""
    timer = take.recorder._taking
    for _ in range(100):
        take(('state', Queue()))
    assert (timer.timer_period_ns, take.recorder.rest_s) == (20_000_000, 0.02)
    take(('state', Queue(1)))
    assert (timer.timer_period_ns, take.recorder.rest_s) == (2_000_000, 0.005)


@pytest.mark.parametrize(
    ('executor', 'names'),
    [
        (new_executor, ['-r', '__ns:=/clockwork']),
        (MultiThreadedExecutor, ['-r', 'relative_state:=/relative_clock/state']),
        (SingleThreadedExecutor, []),
    ],
)
def test_a_flight_is_recorded_under_any_executor_and_any_names(ros_env, tmp_path, executor, names):
    """A plant whose topics had `clock` in their names was gone for the recorder."""
    with inside(names, executor) as inner:
        inner.fly(tmp_path / 'run', lasting(2.0, tmp_path))
        assert inner.ends() == 0
    assert verify(tmp_path / 'run').exit_code == ExitCode.OK
    assert len(read_run(tmp_path / 'run').ticks) == 21
