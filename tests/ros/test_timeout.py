# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Who has been silent, and who has been asleep."""

import signal
import time

import pytest

from rpo_ros.timeout import MOST_STEP_S, Timeout
from tools.node_processes import node_processes


class Clock:
    """A clock that stands until it is moved."""

    now_s = 100.0

    def __call__(self):
        return self.now_s


def after(*steps_s):
    """Return the silence that is found after looks at these intervals."""
    clock = Clock()
    silence = Timeout(clock)
    for step_s in steps_s:
        clock.now_s += step_s
        found = silence.look()
    return found


def test_silence_adds_up():
    assert after(*[0.05] * 100) == pytest.approx(5.0)


def test_a_listener_that_slept_accuses_nobody():
    assert after(0.05, 3600.0) == pytest.approx(0.05 + MOST_STEP_S)


def test_what_is_heard_breaks_it():
    clock = Clock()
    silence = Timeout(clock)
    clock.now_s += 0.2
    silence.look()
    silence.broken()
    clock.now_s += 0.1
    assert silence.look() == pytest.approx(0.1)


@pytest.mark.slow
def test_a_stopped_and_continued_plant_or_recorder_ends_no_run(ros_env, tmp_path):
    """As a laptop that sleeps, or a debugger: longer than any time-out."""
    with node_processes(ros_env, tmp_path) as ros:
        ros.node('rpo_ctrl', 'fuzzy_controller')
        recorder = ros.node('rpo_log', 'recorder', output=f'{tmp_path}/run', plant_timeout_s=2.0)
        plant = ros.node(
            'rpo_sim', 'plant', real_time_factor=40.0, wait_for_recorder='true', peer_timeout_s=2.0
        )
        plant.says('flying')
        for node in (recorder, plant):
            node.process.send_signal(signal.SIGSTOP)
        time.sleep(4.0)
        for node in (plant, recorder):
            node.process.send_signal(signal.SIGCONT)
        assert plant.wait() == 0, plant.output
        assert recorder.wait() == 0, recorder.output
