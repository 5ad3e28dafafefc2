# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The lockstep state machine without ROS: stamps decide, nothing else does."""

import math

import numpy as np
import pytest

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.scenario import Scenario, load_scenario
from rpo_sim import lockstep
from rpo_sim.lockstep import LockstepPlant

ANSWERS = ('control_force', 'disturbance_force')


@pytest.fixture
def scenario() -> Scenario:
    return load_scenario('quick')


def test_steps_only_when_every_answer_is_in(scenario):
    plant = LockstepPlant(scenario, ANSWERS)
    assert plant.missing == list(ANSWERS)
    assert plant.answer('control_force', plant.stamp_ns, (0.1, 0.0, 0.0)) == lockstep.ACCEPTED
    assert plant.missing == ['disturbance_force']
    assert plant.answer('disturbance_force', plant.stamp_ns, (0.0, 0.0, 0.0)) == lockstep.ACCEPTED
    before = plant.state
    plant.advance()
    assert plant.tick == 1
    assert plant.state != before
    assert plant.missing == list(ANSWERS)


@pytest.mark.parametrize(
    ('shift', 'kind'),
    [(-1, lockstep.LATE), (1, lockstep.EARLY), (1_000_000, lockstep.FOREIGN)],
)
def test_an_answer_of_another_tick_changes_nothing(scenario, shift, kind):
    plant = LockstepPlant(scenario, ['control_force'])
    plant.answer('control_force', plant.stamp_ns, (0.1, 0.2, 0.3))
    plant.advance()
    before = plant.state
    assert plant.answer('control_force', scenario.stamp_ns(1 + shift), (9.0, 9.0, 9.0)) == kind
    assert plant.missing == ['control_force']
    assert plant.state == before
    assert plant.ignored == {kind: 1}


def test_a_stamp_between_ticks_is_foreign(scenario):
    plant = LockstepPlant(scenario, ['control_force'])
    assert plant.answer('control_force', plant.stamp_ns + 1, (0.0,) * 3) == lockstep.FOREIGN


def test_the_first_of_two_answers_counts(scenario):
    def state_after(*forces):
        plant = LockstepPlant(scenario, ['control_force'])
        kinds = [plant.answer('control_force', plant.stamp_ns, force) for force in forces]
        plant.advance()
        return kinds, plant.state

    once = state_after((0.1, 0.2, 0.3))
    twice = state_after((0.1, 0.2, 0.3), (0.4, 0.4, 0.4))
    assert twice[0] == [lockstep.ACCEPTED, lockstep.REPEATED]
    assert twice[1] == once[1]


def test_thrusters_saturate_in_the_plant(scenario):
    limit = scenario.max_force_n

    def state_after(force):
        plant = LockstepPlant(scenario, ['control_force'])
        plant.answer('control_force', plant.stamp_ns, force)
        plant.advance()
        return plant.state, plant.saturated_ticks

    assert state_after((7.0, -7.0, 0.1)) == (state_after((limit, -limit, 0.1))[0], 1)


def test_a_dropped_peer_counts_as_zero_force(scenario):
    plant = LockstepPlant(scenario, ANSWERS)
    plant.answer('disturbance_force', plant.stamp_ns, (0.01, 0.0, 0.0))
    assert plant.drop_missing() == ['control_force']
    plant.advance()
    drifting = LockstepPlant(scenario, ANSWERS)
    drifting.answer('disturbance_force', drifting.stamp_ns, (0.01, 0.0, 0.0))
    drifting.answer('control_force', drifting.stamp_ns, (0.0, 0.0, 0.0))
    drifting.advance()
    assert plant.state == drifting.state
    assert plant.answer('control_force', plant.stamp_ns, (0.1,) * 3) == lockstep.DROPPED


def test_driven_by_the_controller_it_is_the_core_closed_loop_bit_for_bit():
    scenario = load_scenario('paper_test')
    controller = load_controller('handmade')
    expected = fly(scenario, controller)
    plant = LockstepPlant(scenario, ANSWERS)
    for tick in range(scenario.ticks + 1):
        force = controller.force_n(plant.state[:3], plant.state[3:])
        disturbance = scenario.disturbance.force_n(scenario.time_s(tick))
        assert plant.state == tuple(expected.states[tick])
        assert force == tuple(expected.forces_n[tick])
        plant.answer('control_force', plant.stamp_ns, force)
        plant.answer('disturbance_force', plant.stamp_ns, disturbance)
        if not plant.finished:
            plant.advance()
    assert plant.finished
    applied = expected.saturated_forces_n
    energy = float(np.sum(applied**2) * scenario.dt_s)
    assert math.isclose(plant.figures()['energy_n2s'], energy, rel_tol=1e-12)
