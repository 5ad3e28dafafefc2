# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The monitor in a running system: each fault is injected, and its reaction is seen."""

import math
from pathlib import Path

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry

from rpo_bringup.monitor_node import MonitorNode
from rpo_core import files
from rpo_ctrl.controller_node import ControllerNode
from rpo_ros import conversions, qos
from rpo_sim.plant_node import EXIT_ABORTED, PlantNode

FAST = {'real_time_factor': 20.0}


def table(folder, **rules):
    """Write the shipped table with some rules changed to react at the first sample."""
    document = yaml.safe_load(files.find('monitor', 'default').read_text())
    document['limits']['force_age_s'] = 0.3
    for fault, reaction in rules.items():
        document['faults'][fault] = {'count': 1, 'window': 1, 'reaction': reaction}
    path = folder / 'mine.yaml'
    path.write_text(yaml.safe_dump(document))
    return str(path)


def lie(inner, *values, stamp_ns=1):
    """Publish a state (6,) or a command (3,) that the system should not hear."""
    if len(values) == 6:
        state = conversions.to_odometry(stamp_ns, values)
        inner.publisher(Odometry, 'relative_state').publish(state)
    else:
        force = conversions.to_wrench(conversions.to_stamp(stamp_ns), values)
        inner.publisher(WrenchStamped, 'control_force').publish(force)


def flying(bench, path, **monitor):
    """Start plant, controller and monitor; return them in flight."""
    plant = bench.start(PlantNode(FAST))
    controller = bench.start(ControllerNode())
    watcher = bench.start(MonitorNode({'table': path, **monitor}))
    bench.until(lambda: watcher.phase == 'running')
    return plant, controller, watcher


@pytest.mark.parametrize(
    ('fault', 'state'),
    [
        ('out_of_range', (500.0, 0, 0, 0, 0, 0)),
        ('too_fast', (0, 0, 1.0, 0, 0, 0.5)),
        ('not_finite', (0, 0, 1.0, 0, math.nan, 0)),
    ],
)
def test_a_bad_state_aborts_the_run(inner, tmp_path, capfd, fault, state):
    plant, _, watcher = flying(inner, table(tmp_path, **{fault: 'abort'}))
    lie(inner, *state)
    inner.until(lambda: plant.phase == 'aborted')
    assert plant.exit_code == EXIT_ABORTED
    assert watcher.checker.detected[fault] == 1
    inner.until(lambda: watcher.phase == 'aborted' and watcher.answers == {'abort': 'done'})
    said = capfd.readouterr().err
    assert f'({fault}): abort' in said and 'abort: done by' in said


def test_a_saturated_command_coasts(inner, tmp_path):
    plant, controller, watcher = flying(inner, table(tmp_path, force_saturated='coast'))
    lie(inner, 0.0, 0.9, 0.0)
    inner.until(lambda: not controller.active)
    before = controller.answered_inactive
    inner.until(lambda: controller.answered_inactive > before + 5)
    assert plant.phase == 'running', 'the chaser drifts, the run goes on'
    inner.until(lambda: watcher.checker.detected['controller_inactive'])


def test_a_silent_controller_aborts(inner, tmp_path):
    plant, controller, _ = flying(inner, table(tmp_path, force_stale='abort'))
    inner.executor.remove_node(controller)
    inner.until(lambda: plant.phase == 'aborted')


def test_told_not_to_react_it_warns_only_and_says_so_on_diagnostics(inner, tmp_path):
    heard = {}

    def on_diagnostics(message):
        heard.update({status.name: status for status in message.status})

    inner.user.create_subscription(DiagnosticArray, '/diagnostics', on_diagnostics, qos.DIAGNOSTICS)
    path = table(tmp_path, out_of_range='abort')
    plant, _, _ = flying(inner, path, react=False)
    lie(inner, 500.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    status = inner.until(lambda: (s := heard.get('monitor: health')) and s.level != b'\x00' and s)
    values = {pair.key: pair.value for pair in status.values}
    assert status.level == b'\x01' and values['reaction_out_of_range'] == 'warn'
    assert plant.phase == 'running'
    assert inner.set('/monitor', react=True) == (True, '')


def test_nobody_there_to_react_is_an_error_on_diagnostics(inner, tmp_path):
    watcher = inner.start(MonitorNode({'table': table(tmp_path, out_of_range='abort')}))
    watcher.phase = 'running'
    lie(inner, 500.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    inner.until(lambda: watcher.checker.detected['out_of_range'])
    level, said, _ = watcher._health()
    assert level == b'\x02' and 'no service for abort' in said


def test_a_corridor_is_where_the_target_points(inner, tmp_path):
    document = yaml.safe_load(Path(table(tmp_path, off_corridor='abort')).read_text())
    document['limits'].update(corridor_half_angle_deg=20.0, corridor_axis=[1.0, 0.0, 0.0])
    path = tmp_path / 'cone.yaml'
    path.write_text(yaml.safe_dump(document))
    watcher = inner.start(MonitorNode({'table': str(path)}))
    turned = Odometry()  # its x along y of LVLH
    turned.pose.pose.orientation.z = turned.pose.pose.orientation.w = math.sqrt(0.5)
    inner.publisher(Odometry, 'target_attitude').publish(turned)
    inner.until(lambda: watcher._attitude[2] > 0.0)
    lie(inner, 0.0, 50.0, 0.0, 0.0, 0.0, 0.0)
    inner.until(lambda: watcher._newest_ns == 1)
    assert not watcher.checker.detected['off_corridor']
    lie(inner, 50.0, 0.0, 0.0, 0.0, 0.0, 0.0, stamp_ns=2)
    inner.until(lambda: watcher.checker.detected['off_corridor'] == 1)
