# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Nodes of somebody else, as docs/foreign has them: flown in lockstep, logged, replayed, verified.

They are processes that import nothing of this stack; ours run in the test's own process.
"""

import os
import runpy
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from flights import lasting
from inside import inside
from landing import rest_at_landing

from rpo_core.wire import interfaces
from rpo_core.wire.interfaces import Interface
from rpo_ctrl.assurance_node import AssuranceNode
from rpo_ctrl.fuzzy_controller_node import ControllerNode
from rpo_ctrl.guidance_node import GuidanceNode
from rpo_ctrl.navigation_node import NavigationNode
from rpo_log import recorder_node
from rpo_log.errors import ExitCode
from rpo_log.read.run_log import read_run
from rpo_log.recorder_node import RecorderNode
from rpo_log.replay_node import ReplayNode
from rpo_log.verify import verify
from rpo_ros.signals import Outlet, listen
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode
from rpo_sim.plant_node import PlantNode

PATIENT = {'plant_timeout_s': 200.0}
"""A plant that gets no processor is not gone."""
FOREIGN = Path(__file__).parents[2] / 'docs' / 'foreign'
BasiliskPlant = runpy.run_path(str(FOREIGN / 'basilisk_plant.py'))['BasiliskPlant']


@pytest.fixture
def foreign(ros_env):
    """Start scripts of docs/foreign."""
    started = []

    def start(script, argument):
        path = FOREIGN / script
        assert 'rpo_' not in path.read_text()
        words = [sys.executable, str(path), argument]
        started.append(subprocess.Popen(words, env={**os.environ, **ros_env}))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()


@pytest.mark.parametrize('script', rest_at_landing(['plant.py', 'paced.py']))
def test_a_plant_of_somebody_else_flies_is_recorded_replayed_and_verified(
    inner, foreign, tmp_path, script, capfd
):
    scenario, folder = lasting(8.0, tmp_path), tmp_path / 'run'
    plant = foreign(script, scenario)
    controller = inner.start(ControllerNode({'controller': 'handmade'}))
    recorder = inner.start(RecorderNode({'output': str(folder), **PATIENT}))
    inner.until(lambda: recorder.done and plant.poll() is not None)
    assert (plant.returncode, recorder.exit_code) == (0, 0)
    assert ('80 ticks, ' in capfd.readouterr().out) == (script == 'paced.py')
    controller.new_run()
    replay = inner.start(ReplayNode({'bag': str(folder), 'drive': True, 'rate': 0.0}))
    inner.until(lambda: replay.done)
    assert (replay.exit_code, replay._played, replay.differences) == (0, 81, 0)
    assert verify(folder).exit_code == ExitCode.DIFFERENT
    found = verify(folder, given=['relative_state'])
    assert (found.exit_code, found.gaps) == (ExitCode.GIVEN, ())
    assert found.sentence().endswith(
        'as computed from what was given, 81 ticks bit for bit; given, not judged: '
        'relative_state (dynamics), figures of run_status; recomputed: controller'
    )


@pytest.mark.every_landing
def test_a_plant_that_waits_for_the_log_does_not_wait_for_ever(
    inner, foreign, tmp_path, monkeypatch
):
    """A node whose topic is recorded, and which this plant does not await, goes in flight."""
    monkeypatch.setattr(recorder_node, '_HELD_S', 0.3)
    monkeypatch.setattr(interfaces, '_TABLE', dict(interfaces._TABLE))
    interfaces.add(Interface('toy_force', interfaces.FORCE_TYPE, 'a toy'))
    toy, answered = Outlet(inner.user, 'toy_force'), set()

    def answer(stamp_ns, state):
        answered.add(stamp_ns)
        if len(answered) < 10:
            toy.publish(stamp_ns, state[:3])

    listen(inner.user, interfaces.RELATIVE_STATE, answer, print)
    plant = foreign('plant.py', lasting(12.0, tmp_path))
    inner.start(ControllerNode({'controller': 'handmade'}))
    recorder = inner.start(RecorderNode({'output': str(tmp_path / 'run'), **PATIENT}))
    inner.until(lambda: recorder.done and plant.poll() is not None)
    assert (plant.returncode, recorder.exit_code) == (0, recorder_node.EXIT_INCOMPLETE)
    gap = f'{121 - 9} messages of /toy_force are missing'
    assert read_run(tmp_path / 'run').gaps == (gap,)


SENSOR = {'kind': 'relative_position', 'noise_floor_m': 0.01}
OTHERS = {
    'controller': ('approach', ['control_force'], 'thrusters, dynamics'),
    'sensor': ('', ['measurement'], 'estimator, controller, thrusters, dynamics'),
    'guidance': ('hold_points', ['reference_state', 'reference_force'],
                 'controller, thrusters, dynamics'),
    'assurance': ('assured', ['assured_force'],
                  'navigation, controller, disturbance, thrusters, dynamics'),
    'disturbance': ('quick', ['disturbance_force'], 'controller, thrusters, dynamics'),
    'estimator': ('', ['navigation_state'], 'sensors, controller, thrusters, dynamics'),
}  # fmt: skip
OURS = {
    'controller': (ControllerNode, {'controller': 'handmade'}),
    'disturbance': (DisturbanceInjectorNode, {}),
    'sensor': (NavigationNode, {'stages': 'sensors'}),
    'estimator': (NavigationNode, {'stages': 'estimator'}),
    'guidance': (GuidanceNode, {}),
    'assurance': (AssuranceNode, {}),
}


@pytest.mark.parametrize('role', rest_at_landing(OTHERS))
def test_verify_names_what_somebody_else_made_and_nothing_else(inner, foreign, tmp_path, role):
    name, given, recomputed = OTHERS[role]
    more = {} if name else {'sensors': {'units': [SENSOR]}, 'estimator': {}}
    scenario = lasting(2.0, tmp_path, name or 'approach', **more)
    foreign('answers.py', role)
    for ours, (node, options) in OURS.items():
        if ours != role:
            inner.start(node(options))
    inner.record_and_fly(tmp_path / 'run', scenario)
    assert inner.ends() == 0
    assert verify(tmp_path / 'run').exit_code != ExitCode.OK
    found = verify(tmp_path / 'run', given=given)
    assert (found.exit_code, found.gaps) == (ExitCode.GIVEN, ()), found.sentence()
    assert [said.partition(' ')[0] for said in found.given] == given
    assert found.sentence().endswith(f'recomputed: {recomputed}')


@pytest.mark.skipif(not find_spec('Basilisk'), reason='Basilisk (layer truth) is not installed')
def test_basilisk_flies_as_the_plant(ros_env, tmp_path):
    """One step a tick, by its own gravity: near the linear motion, but not its bits.

    Its thrusters are open for a multiple of a millisecond: the mean force is 5 mN off at most.
    """
    runs = {}
    kinds = {'ours': PlantNode, 'basilisk': BasiliskPlant, 'thrusters': BasiliskThrusters}
    for name, kind in kinds.items():
        with inside() as inner:
            fly_with(kind, inner, tmp_path / name)
        runs[name] = read_run(tmp_path / name).states
    for name, most_m in (('basilisk', 1e-5), ('thrusters', 0.005 / 10.0 / 2.0 * 4.0**2)):
        apart = np.abs(runs[name] - runs['ours'])[:, :3].max(axis=1)
        assert len(apart) == 41 and 0.0 < apart[-1] < most_m
        assert verify(tmp_path / name).exit_code == ExitCode.DIFFERENT
        found = verify(tmp_path / name, given=['relative_state'])
        assert (found.exit_code, found.gaps) == (ExitCode.GIVEN, ())


class BasiliskThrusters(BasiliskPlant):
    thrusters = True


def fly_with(kind, inner, folder):
    """Fly 4 s of the paper's test with a plant."""
    scenario = lasting(4.0, folder.parent, 'paper_test')
    inner.fly(folder, scenario, DisturbanceInjectorNode, plant=kind)
    inner.ends()
