# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The plant in lockstep, without ROS."""

from datetime import datetime, timezone

from rpo_core.scenario import scenario
from rpo_core.wire.interfaces import CONTROL_FORCE
from rpo_sim.plant import ACCEPTED, EARLY, LATE, REPEATED, LockstepPlant

SCENARIO = {
    'schema': 'rpo/scenario/1',
    'name': 'function',
    'orbit_radius_m': 6678000.0,
    'mass_kg': 10.0,
    'max_force_n': 0.5,
    'dt_s': 0.1,
    'duration_s': 1.0,
    'initial_position_m': [10.0, 60.0, -40.0],
    'initial_velocity_m_s': [0.0, 0.0, 0.0],
    'epoch': datetime(2026, 1, 1, tzinfo=timezone.utc),
    'disturbance': 'none',
}


def test_the_plant_takes_the_answer_to_its_state_alone():
    """A wrong answer is counted by its kind and changes nothing."""
    plant = LockstepPlant(scenario.parse(SCENARIO), [CONTROL_FORCE])
    first, second = (plant.scenario.stamp_ns(tick) for tick in (0, 1))
    force = (0.1, 0.0, 0.0)
    assert plant.answer(CONTROL_FORCE, second, force) == EARLY
    assert plant.answer(CONTROL_FORCE, first, force) == ACCEPTED
    assert plant.answer(CONTROL_FORCE, first, force) == REPEATED
    plant.advance()
    assert plant.answer(CONTROL_FORCE, first, force) == LATE
    assert plant.tick == 1
    assert plant.state[3] > 0.0
