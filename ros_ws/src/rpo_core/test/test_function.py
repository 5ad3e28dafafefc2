# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A flight as one function, without files."""

from datetime import datetime, timezone

from rpo_core.chain.flight import fly
from rpo_core.control import controller
from rpo_core.files import scenario

SCENARIO = {
    'schema': 'rpo/scenario/1',
    'name': 'function',
    'orbit_radius_m': 6678000.0,
    'mass_kg': 10.0,
    'max_force_n': 0.5,
    'dt_s': 0.1,
    'duration_s': 400.0,
    'initial_position_m': [10.0, 60.0, -40.0],
    'initial_velocity_m_s': [0.0, 0.0, 0.0],
    'epoch': datetime(2026, 1, 1, tzinfo=timezone.utc),
    'disturbance': 'none',
}
CONTROLLER = {
    'schema': 'rpo/controller/1',
    'name': 'pd',
    'kind': 'pd',
    'max_force_n': 0.5,
    'position_gain_n_m': 0.01375,
    'velocity_gain_n_s_m': 0.6734,
    'provenance': {'method': 'by hand'},
}


def test_a_flight_comes_to_the_target():
    """From 72 m to less than 1 m; each force within its limit."""
    flight = fly(scenario.parse(SCENARIO), controller.parse(CONTROLLER))
    assert abs(flight.states[-1][:3]).max() < 1.0
    assert abs(flight.forces_n).max() <= 0.5
