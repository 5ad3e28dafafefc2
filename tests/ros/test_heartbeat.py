# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Signs of life: plant and recorder name the node of the chain that is gone."""

import time
from pathlib import Path

import yaml
from inside import inside
from scenarios import lasting

from rpo_ctrl.controller_node import ControllerNode
from rpo_log.recorder_node import RecorderNode
from rpo_nav.navigation_node import NavigationNode
from rpo_ros.heartbeat import Pulse, Watch
from rpo_ros.running import FlightNode
from rpo_sim.plant_node import PlantNode


def test_a_node_that_says_nothing_any_more_is_named(ros_env, tmp_path, capfd):
    scenario = tmp_path / 'scenario.yaml'
    document = yaml.safe_load(Path(lasting(60.0, tmp_path)).read_text())
    scenario.write_text(yaml.safe_dump({**document, 'navigation': {'position_noise_m': 0.01}}))
    with inside() as inner:
        navigation = inner.start(NavigationNode({}))
        inner.start(ControllerNode({'controller': 'handmade'}))
        recorder = inner.start(RecorderNode({'output': str(tmp_path / 'run')}))
        options = {'real_time_factor': 10.0, 'peer_timeout_s': 1.5, 'wait_for_recorder': True}
        plant = inner.start(PlantNode({'scenario': str(scenario), **options}))
        inner.until(lambda: plant.tick > 20)
        assert not plant.watch.silent
        inner.executor.remove_node(navigation)
        since_s = time.monotonic()
        inner.until(lambda: plant.watch.silent and recorder._watch.silent)
        assert time.monotonic() - since_s < 1.5, 'test_killed.py holds it to one second'
        assert plant.watch.silent == recorder._watch.silent == {'navigation': 'navigation'}
        assert plant._health()[2]['silent'] == 'navigation'
        inner.until(lambda: recorder.done and plant.done)
    said = capfd.readouterr().err
    assert '[plant]: navigation (navigation) is silent for 0.6 s: gone, or stuck' in said
    assert 'no answer to tick ' in said and 'from control_force; silent: navigation' in said


def test_who_ends_in_order_is_named_at_once_and_may_come_back(ros_env, capfd):
    with inside() as inner:
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
