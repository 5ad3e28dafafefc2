# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Signs of life: who has been silent or asleep, and which node of the chain is gone."""

import signal
import time

import pytest
from flights import lasting

from rpo_ctrl.navigation_node import NavigationNode
from rpo_ros.heartbeat import MOST_STEP_S, Pulse, Timeout, Watch
from rpo_ros.running import FlightNode


def test_a_node_that_says_nothing_any_more_is_named(inner, tmp_path, capfd):
    path = lasting(60.0, tmp_path, navigation={'position_noise_m': 0.01})
    inner.fly(tmp_path / 'run', path, NavigationNode, real_time_factor=10.0, peer_timeout_s=1.5)
    navigation, plant, recorder = inner.nodes[1], inner.plant, inner.recorder
    inner.reaches(20)
    assert not plant.watch.silent
    inner.executor.remove_node(navigation)
    since_s = time.monotonic()
    inner.until(lambda: plant.watch.silent and recorder._watch.silent)
    assert time.monotonic() - since_s < 1.5, 'test_killed.py holds it to one second'
    assert plant.watch.silent == recorder._watch.silent == {'navigation': 'navigation'}
    assert plant._health()[2]['silent'] == 'navigation'
    inner.ends()
    said = capfd.readouterr().err
    assert '[plant]: navigation (navigation) is silent for 0.6 s: gone, or stuck' in said
    assert 'no answer to tick ' in said and 'from control_force; silent: navigation' in said


def test_who_ends_in_order_is_named_at_once_and_may_come_back(inner, capfd):
    stages, flies = ['guidance'], [True]
    node, other = inner.start(FlightNode('plant')), inner.start(FlightNode('mine'))
    watch, pulse = Watch(node, lambda: flies[0]), Pulse(other, lambda: stages)
    inner.until(lambda: watch._heard)
    pulse.beat('gone')
    inner.until(lambda: watch.silent == {'mine': 'guidance'})
    inner.until(lambda: not watch.silent)  # it beats again
    stages.clear()  # without a stage it says nothing, and before the flight nobody is missed
    flies.clear(), flies.append(False)
    inner.until(lambda: not watch._heard)
    assert not watch.silent
    said = capfd.readouterr().err
    assert 'mine (guidance) has ended' in said and 'mine is back' in said


def test_silence_adds_up_is_broken_and_a_listener_that_slept_accuses_nobody():
    now_s = [100.0]
    silence = Timeout(lambda: now_s[0])

    def after(*steps_s):
        for step_s in steps_s:
            now_s[0] += step_s
            found = silence.look()
        return found

    assert after(*[0.05] * 100) == pytest.approx(5.0)
    silence.broken()
    assert after(0.1) == pytest.approx(0.1)
    silence.broken()
    assert after(0.05, 3600.0) == pytest.approx(0.05 + MOST_STEP_S)


@pytest.mark.slow
def test_a_stopped_and_continued_plant_or_recorder_ends_no_run(ros, tmp_path):
    """As a laptop that sleeps, or a debugger: longer than any time-out."""
    ros.node('rpo_ctrl', 'fuzzy_controller')
    recorder = ros.node('rpo_log', 'recorder', output=f'{tmp_path}/run', plant_timeout_s=2.0)
    options = {'real_time_factor': 40.0, 'wait_for_recorder': 'true', 'peer_timeout_s': 2.0}
    plant = ros.node('rpo_sim', 'plant', **options)
    plant.says('flying')
    for node in (recorder, plant):
        node.process.send_signal(signal.SIGSTOP)
    time.sleep(4.0)
    for node in (plant, recorder):
        node.process.send_signal(signal.SIGCONT)
    for node in (plant, recorder):
        assert node.wait() == 0, node.output
