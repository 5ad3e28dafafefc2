# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A controller or a thruster switched off and on in flight, a peer lost: recorded, and verified."""

import numpy as np
import pytest
import yaml
from flights import lasting
from inside import inside

from rpo_bringup.monitor_node import MonitorNode
from rpo_core import files
from rpo_core.wire.interfaces import EXERTED_FORCE, EXERTED_TORQUE
from rpo_log.verify import verify
from rpo_mcap.read.run_log import flight_of, read_run
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode
from rpo_sim.plant_node import PlantNode

NODE = '/fuzzy_controller'


def start(inner, folder, duration_s, **options):
    """Start a run; return its recorder when it has begun."""
    path = lasting(duration_s, folder, 'paper_test')
    inner.fly(folder / 'run', path, DisturbanceInjectorNode, real_time_factor=40.0, **options)
    inner.until(lambda: inner.recorder.log is not None and inner.recorder.log.next_tick > 20)
    return inner.recorder


def verified(folder):
    """Return the log of a run that is verified, and what its stages said."""
    found = verify(folder / 'run')
    assert found.exit_code == 0, found.sentence()
    log = read_run(folder / 'run')
    return log, [event.values for event in log.events if event.signal == 'stage_status']


def test_switched_off_and_on_in_flight(inner, tmp_path):
    recorder = start(inner, tmp_path, 60.0)
    for label in ('deactivate', 'activate'):
        at = recorder.log.next_tick
        assert inner.transition(NODE, label)
        inner.until(lambda: recorder.log.next_tick > at + 20)  # noqa: B023
    assert inner.ends() == 0
    log, events = verified(tmp_path)
    assert [event['state'] for event in events] == ['inactive', 'active']
    off, on = (int(event['tick']) for event in events)
    assert off < on and not log.forces_n[off:on].any() and log.forces_n[on:].any()


@pytest.mark.every_landing
def test_a_file_that_is_loaded_while_switched_off_begins_no_run(inner, tmp_path):
    start(inner, tmp_path, 60.0)
    assert inner.transition(NODE, 'deactivate')
    assert inner.set(NODE, controller='handmade')[0]
    assert inner.transition(NODE, 'activate')
    inner.ends()
    _, events = verified(tmp_path)
    assert [event['state'] for event in events] == ['inactive', 'active']
    assert int(events[0]['tick']) > 20


@pytest.mark.every_landing
@pytest.mark.parametrize('lost', [0, 1], ids=['controller', 'disturbance'])
def test_a_plant_that_goes_on_without_a_peer(inner, tmp_path, lost):
    start(inner, tmp_path, 30.0, on_peer_timeout='coast', peer_timeout_s=0.5)
    inner.executor.remove_node(inner.nodes[lost])  # it hears and says nothing more
    assert inner.ends() == 0
    log, _ = verified(tmp_path)
    assert log.complete and log.outcome == 'finished'
    name = ('/control_force', '/disturbance_force')[lost]
    assert name in {topic.name for topic in log.topics}


@pytest.mark.every_landing
def test_a_flight_that_the_monitor_lets_coast_verifies(inner, tmp_path):
    document = yaml.safe_load(files.find('monitor', 'default').read_text())
    document['limits']['range_m'] = 50.0  # the chaser starts farther away
    document['faults']['out_of_range'] = {'count': 30, 'window': 30, 'reaction': 'coast'}
    table = tmp_path / 'table.yaml'
    table.write_text(yaml.safe_dump(document))
    monitor = inner.start(MonitorNode({'table': str(table)}))
    start(inner, tmp_path, 30.0)
    inner.ends()
    assert monitor.reacted['out_of_range'] == 'coast' and not inner.controller.active
    log, (event,) = verified(tmp_path)
    off = int(event['tick'])
    assert log.forces_n[:off].any() and not log.forces_n[off:].any()


# A thruster of a table.

TABLE = {'preset': 'quads_16', 'force_n': 0.25, 'minimum_impulse_bit_n_s': 0.002}


def test_a_thruster_is_switched_in_flight(inner, tmp_path):
    path = lasting(30.0, tmp_path, thrusters={'table': TABLE})
    options = {'real_time_factor': 20.0, 'thruster': 'x-a off'}
    inner.fly(tmp_path / 'run', path, controller='robust', **options)
    inner.reaches(20)
    refused, reason = inner.set('/plant', thruster='x+q off')
    assert not refused and 'must be one of x+a' in reason
    assert inner.set('/plant', thruster='y-a on')[0]
    inner.reaches(inner.plant.tick + 50)
    assert inner.set('/plant', thruster='y-a ready')[0]
    assert inner.ends() == 0
    log, events = verified(tmp_path)
    assert [event['state'] for event in events] == ['x-a off', 'y-a on', 'y-a ready']
    assert int(events[0]['tick']) == 0 < int(events[1]['tick']) < int(events[2]['tick'])
    flight = flight_of(log)
    np.testing.assert_array_equal(flight.thrust.forces_n, log.values[EXERTED_FORCE][:-1])
    assert np.abs(log.values[EXERTED_TORQUE]).max() > 0.0


@pytest.mark.parametrize('table', [{'table': TABLE}, None])
def test_a_switch_that_cannot_be_is_refused_at_the_start(ros_env, tmp_path, table):
    path = lasting(30.0, tmp_path, thrusters=table)
    with inside(), pytest.raises(files.InputError, match='`thruster`: a switch'):
        PlantNode({'scenario': path, 'thruster': 'none off'})
