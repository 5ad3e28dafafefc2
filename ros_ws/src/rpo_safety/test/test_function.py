# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Runtime assurance, without ROS."""

from datetime import datetime, timezone

from rpo_core.files import scenario
from rpo_safety.assurance import AssuranceStage
from rpo_safety.settings import Assurance

SCENARIO = {
    'schema': 'rpo/scenario/1',
    'name': 'function',
    'orbit_radius_m': 6678000.0,
    'mass_kg': 10.0,
    'max_force_n': 0.5,
    'dt_s': 0.1,
    'duration_s': 1.0,
    'initial_position_m': [0.0, 60.0, 0.0],
    'initial_velocity_m_s': [0.0, 0.0, 0.0],
    'epoch': datetime(2026, 1, 1, tzinfo=timezone.utc),
    'disturbance': 'none',
}


def test_a_command_into_the_zone_becomes_a_brake():
    """Far away it passes; where the chaser could not stop any more, it does not."""
    stage = AssuranceStage(Assurance(keep_out_m=10.0), scenario.parse(SCENARIO))
    towards = (0.0, -0.5, 0.0)
    (force,) = stage.step(0, (0.0, 60.0, 0.0, 0.0, 0.0, 0.0), towards)
    assert force == towards
    (force,) = stage.step(0, (0.0, 11.0, 0.0, 0.0, -0.306, 0.0), towards)
    assert force[1] > 0.3
    assert stage.decision.constraint == 'keep_out'
