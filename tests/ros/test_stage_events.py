# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A controller switched off and on in flight, a peer lost: recorded, and verified."""

import pytest
import yaml
from inside import inside
from scenarios import lasting

from rpo_bringup.monitor_node import MonitorNode
from rpo_core import files
from rpo_ctrl.controller_node import ControllerNode
from rpo_log.recorder_node import RecorderNode
from rpo_log.verify import verify
from rpo_mcap.read.run_log import read_run
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode
from rpo_sim.plant_node import PlantNode

NODE = '/fuzzy_controller'


def start(inner, scenario, folder, **options):
    """Start a run; return controller, injector and recorder when it has begun."""
    controller = inner.start(ControllerNode({'controller': 'handmade'}))
    injector = inner.start(DisturbanceInjectorNode({}))
    recorder = inner.start(RecorderNode({'output': str(folder)}))
    inner.start(PlantNode({'scenario': scenario, 'wait_for_recorder': True, **options}))
    inner.until(lambda: recorder.log is not None and recorder.log.next_tick > 20)
    return controller, injector, recorder


def stop(inner, node):
    """Let a node hear and say nothing more, as if it hung."""
    inner.executor.remove_node(node)


def test_switched_off_and_on_in_flight(ros_env, tmp_path):
    with inside() as inner:
        scenario = lasting(60.0, tmp_path, 'paper_test')
        *_, recorder = start(inner, scenario, tmp_path / 'run', real_time_factor=40.0)
        for label in ('deactivate', 'activate'):
            at = recorder.log.next_tick
            assert inner.transition(NODE, label)
            inner.until(lambda: recorder.log.next_tick > at + 20)  # noqa: B023
        inner.until(lambda: recorder.done)
    assert recorder.exit_code == 0
    log = read_run(tmp_path / 'run')
    events = [event for event in log.events if event.signal == 'stage_status']
    assert [event.values['state'] for event in events] == ['inactive', 'active']
    off, on = (int(event.values['tick']) for event in events)
    assert off < on and not log.forces_n[off:on].any() and log.forces_n[on:].any()
    found = verify(tmp_path / 'run')
    assert found.exit_code == 0, found.sentence()


@pytest.mark.every_landing
def test_a_file_that_is_loaded_while_switched_off_begins_no_run(ros_env, tmp_path):
    with inside() as inner:
        scenario = lasting(60.0, tmp_path, 'paper_test')
        *_, recorder = start(inner, scenario, tmp_path / 'run', real_time_factor=40.0)
        assert inner.transition(NODE, 'deactivate')
        assert inner.set(NODE, controller='handmade')[0]
        assert inner.transition(NODE, 'activate')
        inner.until(lambda: recorder.done)
    log = read_run(tmp_path / 'run')
    events = [event.values for event in log.events if event.signal == 'stage_status']
    assert [event['state'] for event in events] == ['inactive', 'active']
    assert int(events[0]['tick']) > 20
    assert verify(tmp_path / 'run').exit_code == 0


@pytest.mark.every_landing
@pytest.mark.parametrize('lost', [0, 1], ids=['controller', 'disturbance'])
def test_a_plant_that_goes_on_without_a_peer(ros_env, tmp_path, lost):
    with inside() as inner:
        scenario = lasting(30.0, tmp_path, 'paper_test')
        options = {'on_peer_timeout': 'coast', 'peer_timeout_s': 0.5, 'real_time_factor': 40.0}
        *peers, recorder = start(inner, scenario, tmp_path / 'run', **options)
        stop(inner, peers[lost])
        inner.until(lambda: recorder.done)
    assert recorder.exit_code == 0
    log = read_run(tmp_path / 'run')
    assert log.complete and log.outcome == 'finished'
    name = ('/control_force', '/disturbance_force')[lost]
    messages = {t.name: int(log.ticks.size) for t in log.topics if not t.is_event}
    assert name in messages
    found = verify(tmp_path / 'run')
    assert found.exit_code == 0, found.sentence()


@pytest.mark.every_landing
def test_a_flight_that_the_monitor_lets_coast_verifies(ros_env, tmp_path):
    document = yaml.safe_load(files.find('monitor', 'default').read_text())
    document['limits']['range_m'] = 50.0  # the chaser starts farther away
    document['faults']['out_of_range'] = {'count': 30, 'window': 30, 'reaction': 'coast'}
    table = tmp_path / 'table.yaml'
    table.write_text(yaml.safe_dump(document))
    with inside() as inner:
        monitor = inner.start(MonitorNode({'table': str(table)}))
        scenario = lasting(30.0, tmp_path, 'paper_test')
        controller, *_, recorder = start(inner, scenario, tmp_path / 'run', real_time_factor=40.0)
        inner.until(lambda: recorder.done)
        assert monitor.reacted['out_of_range'] == 'coast' and not controller.active
    log = read_run(tmp_path / 'run')
    (off,) = (int(e.values['tick']) for e in log.events if e.signal == 'stage_status')
    assert log.forces_n[:off].any() and not log.forces_n[off:].any()
    found = verify(tmp_path / 'run')
    assert found.exit_code == 0, found.sentence()
