# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The plant in lockstep, without ROS."""

from rpo_core.scenario.scenario import load_scenario
from rpo_core.wire.interfaces import CONTROL_FORCE
from rpo_sim.plant import ACCEPTED, EARLY, LATE, REPEATED, LockstepPlant


def test_the_plant_takes_the_answer_to_its_state_alone():
    """A wrong answer is counted by its kind and changes nothing."""
    plant = LockstepPlant(load_scenario('approach'), [CONTROL_FORCE])
    first, second = (plant.scenario.stamp_ns(tick) for tick in (0, 1))
    force = (0.1, 0.0, 0.0)
    assert plant.answer(CONTROL_FORCE, second, force) == EARLY
    assert plant.answer(CONTROL_FORCE, first, force) == ACCEPTED
    assert plant.answer(CONTROL_FORCE, first, force) == REPEATED
    plant.advance()
    assert plant.answer(CONTROL_FORCE, first, force) == LATE
    assert plant.tick == 1
    assert plant.state[3] > 0.0
