# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A thruster of a table that is switched in flight: recorded, verified, in the report's figures."""

import numpy as np
import pytest
import yaml
from inside import inside
from scenarios import lasting

from rpo_core import files
from rpo_core.wire.interfaces import EXERTED_FORCE, EXERTED_TORQUE
from rpo_ctrl.controller_node import ControllerNode
from rpo_log.recorder_node import RecorderNode
from rpo_log.verify import verify
from rpo_mcap.read.run_log import flight_of, read_run
from rpo_sim.plant_node import PlantNode

TABLE = {'preset': 'quads_16', 'force_n': 0.25, 'minimum_impulse_bit_n_s': 0.002}


def with_table(folder):
    """Write a scenario with a table of thrusters; return its path."""
    path = lasting(60.0, folder, 'approach')
    document = yaml.safe_load(open(path))  # noqa: SIM115
    path = folder / 'table.yaml'
    path.write_text(yaml.safe_dump({**document, 'thrusters': {'table': TABLE}}))
    return str(path)


def test_a_thruster_is_switched_in_flight(ros_env, tmp_path):
    with inside() as inner:
        inner.start(ControllerNode({'controller': 'robust'}))
        recorder = inner.start(RecorderNode({'output': str(tmp_path / 'run')}))
        options = {'scenario': with_table(tmp_path), 'wait_for_recorder': True}
        inner.start(PlantNode({**options, 'real_time_factor': 20.0, 'thruster': 'x-a off'}))
        inner.until(lambda: recorder.log is not None and recorder.log.next_tick > 20)
        refused, reason = inner.set('/plant', thruster='x+q off')
        assert not refused and 'must be one of x+a' in reason
        assert inner.set('/plant', thruster='y-a on')[0]
        at = recorder.log.next_tick
        inner.until(lambda: recorder.log.next_tick > at + 50)
        assert inner.set('/plant', thruster='y-a ready')[0]
        inner.until(lambda: recorder.done)
    assert recorder.exit_code == 0
    log = read_run(tmp_path / 'run')
    events = [event.values for event in log.events if event.signal == 'stage_status']
    assert [event['state'] for event in events] == ['x-a off', 'y-a on', 'y-a ready']
    assert int(events[0]['tick']) == 0 < int(events[1]['tick']) < int(events[2]['tick'])
    found = verify(tmp_path / 'run')
    assert found.exit_code == 0, found.sentence()
    flight = flight_of(log)
    np.testing.assert_array_equal(flight.thrust.forces_n, log.values[EXERTED_FORCE][:-1])
    assert np.abs(log.values[EXERTED_TORQUE]).max() > 0.0


@pytest.mark.parametrize('table', [True, False])
def test_a_switch_that_cannot_be_is_refused_at_the_start(ros_env, tmp_path, table):
    scenario = with_table(tmp_path) if table else 'approach'
    with inside(), pytest.raises(files.InputError, match='`thruster`: a switch'):
        PlantNode({'scenario': scenario, 'thruster': 'none off'})
