# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A thruster switched in flight, a peer lost: recorded, and verified."""

import numpy as np
import pytest
from flights import lasting, told, verified

from rpo_core import files
from rpo_core.wire.interfaces import EXERTED_FORCE, EXERTED_TORQUE
from rpo_log.read.run_log import flight_of
from rpo_sim.disturbance_injector_node import DisturbanceInjectorNode
from rpo_sim.plant_node import PlantNode


def start(inner, folder, duration_s, **options):
    """Start a run, and wait until it has begun."""
    path = lasting(duration_s, folder, 'paper_test')
    inner.fly(folder / 'run', path, DisturbanceInjectorNode, real_time_factor=40.0, **options)
    inner.until(lambda: inner.recorder.log is not None and inner.recorder.log.next_tick > 20)


@pytest.mark.every_landing
@pytest.mark.parametrize('lost', [0, 1], ids=['controller', 'disturbance'])
def test_a_plant_that_goes_on_without_a_peer(inner, tmp_path, lost):
    start(inner, tmp_path, 30.0, on_peer_timeout='coast', peer_timeout_s=0.5)
    inner.executor.remove_node(inner.nodes[lost])  # it hears and says nothing more
    assert inner.ends() == 0
    log = verified(tmp_path / 'run')
    assert log.complete and log.outcome == 'finished'
    name = ('/control_force', '/disturbance_force')[lost]
    assert name in {topic.name for topic in log.topics}


# A thruster of a table.

TABLE = {'preset': 'quads_16', 'force_n': 0.25, 'minimum_impulse_bit_n_s': 0.002}


def test_a_thruster_is_switched_in_flight(inner, tmp_path):
    path = lasting(30.0, tmp_path, thrusters={'table': TABLE})
    options = {'real_time_factor': 20.0, 'thruster': 'x-a off'}
    inner.fly(tmp_path / 'run', path, controller='allround', **options)
    inner.reaches(20)
    refused, reason = inner.set('/plant', thruster='x+q off')
    assert not refused and 'must be one of x+a' in reason
    assert inner.set('/plant', thruster='y-a on')[0]
    inner.reaches(inner.plant.tick + 50)
    assert inner.set('/plant', thruster='y-a ready')[0]
    assert inner.ends() == 0
    log = verified(tmp_path / 'run')
    _, states, ticks = zip(*told(log), strict=True)
    assert states == ('x-a off', 'y-a on', 'y-a ready')
    assert 0 == ticks[0] < ticks[1] < ticks[2]
    flight = flight_of(log)
    np.testing.assert_array_equal(flight.thrust.forces_n, log.values[EXERTED_FORCE][:-1])
    assert np.abs(log.values[EXERTED_TORQUE]).max() > 0.0


@pytest.mark.parametrize('table', [{'table': TABLE}, None])
def test_a_switch_that_cannot_be_is_refused_at_the_start(inner, tmp_path, table):
    path = lasting(30.0, tmp_path, thrusters=table)
    with pytest.raises(files.InputError, match='`thruster`: a switch'):
        PlantNode({'scenario': path, 'thruster': 'none off'})
