# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Whole flights: tick by tick, by another implementation, mirrored, and the paper's test."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_oracles import exact_step, mamdani
from core_strategies import odd_rules, smooth_functions, systems
from hypothesis import given, settings
from hypothesis import strategies as st

from rpo_core.chain.chain import Chain
from rpo_core.chain.flight import OpenLoop, fly
from rpo_core.control.controller import FuzzyController, load_controller
from rpo_core.judge import metrics
from rpo_core.kernels import noise
from rpo_core.navigation.sensors import Navigation
from rpo_core.scenario.scenario import load_scenario
from rpo_core.stage import Place
from rpo_core.thrusters.thrusters import Thrusters
from rpo_core.wire.interfaces import RELATIVE_STATE
from rpo_core.world.disturbance import Disturbance


def test_a_flight_is_another_implementations(handmade, paper_test):
    """The matrix exponential and the definition of Mamdani inference, for a minute."""
    short = replace(paper_test, duration_s=60.0, dt_s=0.5)
    a_d, b_d = exact_step(short.mean_motion_rad_s, short.mass_kg, short.dt_s)
    flight = fly(short, handmade)
    state, n = np.array(short.start), short.mean_motion_rad_s
    position_scale, velocity_scale, force_scale = handmade.scales
    for tick in range(short.ticks + 1):
        np.testing.assert_allclose(flight.states[tick], state, rtol=0, atol=1e-10)
        errors = np.clip([-state[:3] / position_scale, -state[3:] / velocity_scale], -1, 1)
        force = [force_scale * mamdani(handmade.system, e, v) for e, v in errors.T]
        np.testing.assert_allclose(flight.forces_n[tick], force, rtol=0, atol=1e-10)
        angle = np.pi * n * tick * 0.5
        push = [-1.1 * np.cos(angle), -2.2 * np.sin(angle) + np.pi / 3, 1.4 * np.cos(angle)]
        state = a_d @ state + b_d @ (np.clip(force, -0.5, 0.5) + 1e-2 * np.array(push))


def mirrored(scenario):
    """Return a scenario with start and disturbance reversed."""
    old = scenario.disturbance
    harmonics = tuple(replace(h, amplitude_n=-h.amplitude_n) for h in old.harmonics)
    return replace(
        scenario,
        initial_position_m=tuple(-r for r in scenario.initial_position_m),
        initial_velocity_m_s=tuple(-v for v in scenario.initial_velocity_m_s),
        disturbance=Disturbance(tuple(-c for c in old.constant_n), harmonics),
    )


starts = st.tuples(*[st.floats(-100, 100)] * 3)


@settings(max_examples=25)
@given(systems(odd_rules, smooth_functions), starts, st.tuples(*[st.floats(-1, 1)] * 3))
def test_any_odd_controller_mirrors_bit_for_bit(system, position, velocity):
    controller = FuzzyController('odd', system, 60.0, 0.9, 0.5)
    scenario = replace(
        load_scenario('paper_test'),
        duration_s=20.0,
        initial_position_m=position,
        initial_velocity_m_s=velocity,
    )
    flight, mirror = fly(scenario, controller), fly(mirrored(scenario), controller)
    np.testing.assert_array_equal(mirror.states, -flight.states)
    np.testing.assert_array_equal(mirror.forces_n, -flight.forces_n)


@settings(max_examples=25)
@given(systems(), starts)
def test_axes_out_of_plane_fly_alone(system, start):
    """In-plane motion, control included, does not know z; nor z the plane."""
    controller = FuzzyController('any', system, 60.0, 0.9, 0.5)
    x, y, z = start
    scenario = replace(load_scenario('quick'), duration_s=20.0, initial_position_m=start)
    both = fly(scenario, controller).states
    plane = fly(replace(scenario, initial_position_m=(x, y, 0.0)), controller).states
    vertical = fly(replace(scenario, initial_position_m=(0.0, 0.0, z)), controller).states
    np.testing.assert_array_equal(both[:, [0, 1, 3, 4]], plane[:, [0, 1, 3, 4]])
    np.testing.assert_array_equal(both[:, [2, 5]], vertical[:, [2, 5]])


def test_a_stage_makes_all_its_outputs(paper_test, handmade, monkeypatch):
    chain = Chain.of(paper_test, handmade)
    chain.part(Place.CONTROLLER, Place.THRUSTERS).warm_up(paper_test.start)
    monkeypatch.setattr(chain.links[0].stage, 'step', lambda *_: ())
    with pytest.raises(ValueError, match='shorter'):
        chain.step(0, {RELATIVE_STATE: paper_test.start})


def holding(goal_m, **changes):
    """Return the scenario `approach` with a goal."""
    return replace(load_scenario('approach'), goal_position_m=goal_m, **changes)


NEAR, ASIDE = (0.0, 10.0, 0.0), (-15.0, 30.0, 20.0)


@pytest.mark.parametrize(
    ('name', 'goal'),
    [
        ('allround', NEAR), ('allround', ASIDE), ('pd', ASIDE), ('lqr', NEAR), ('mpc', ASIDE),
        ('apf_smc', NEAR),
    ],
)  # fmt: skip
def test_every_controller_rests_at_the_goal(name, goal):
    scenario = holding(goal, duration_s=600.0)
    flight = fly(scenario, load_controller(name))
    assert np.abs(flight.states[-1, :3] - goal).max() < 0.01
    assert np.abs(flight.errors[-1]).max() < 0.01
    assert metrics.of_flight(flight).mean_error_norm_m < 0.02
    n, mass = scenario.mean_motion_rad_s, scenario.mass_kg
    hold = np.array([-3.0 * goal[0], 0.0, goal[2]]) * mass * n * n
    np.testing.assert_allclose(flight.forces_n[-1], hold, atol=2e-4)


def test_a_chaser_at_its_goal_stays_there_and_without_the_force_it_does_not():
    goal = (20.0, -30.0, 40.0)
    scenario = holding(goal, initial_position_m=goal)
    still = fly(scenario, load_controller('drift'))  # the force on top alone
    assert np.abs(still.errors).max() < 1e-9
    away = fly(replace(scenario, goal_position_m=(0.0, 0.0, 0.0)), load_controller('drift'))
    assert np.abs(away.states - still.states).max() > 5.0


def test_the_target_as_goal_has_the_same_bits_and_open_loop_forces_are_left_alone(handmade):
    plain = load_scenario('approach')
    assert holding((-0.0, 0.0, 0.0)).goal is None
    flight = fly(holding((0, 0, 0), duration_s=20.0), handmade)
    same = fly(replace(plain, duration_s=20.0), handmade)
    np.testing.assert_array_equal(flight.states, same.states)
    forces = np.zeros((200, 3))
    assert not fly(holding((9.0, 0.0, 9.0), duration_s=20.0), OpenLoop(forces)).forces_n.any()


# Imperfect thrusters and navigation.

QUICK = load_scenario('quick')
MATRIX = ((0.9, 0.1, 0.0), (0.0, 1.1, -0.2), (0.05, 0.0, 1.0))
NAVIGATION = Navigation((0.3, -0.2, 0.1), (0.01, 0.0, -0.02), 0.05, 0.004, (12, 34))


def test_a_flight_is_that_of_textbook_matrices():
    flown = QUICK.equipped(Thrusters(MATRIX, 2), NAVIGATION)
    controller = load_controller('handmade')
    flight = fly(flown, controller)
    a, b = exact_step(flown.mean_motion_rad_s, flown.mass_kg, flown.dt_s)
    state, commands = np.array(flown.start), [np.zeros(3)] * 2
    sigmas = np.repeat([0.05, 0.004], 3)
    bias = np.array([0.3, -0.2, 0.1, 0.01, 0.0, -0.02])
    for tick in range(flown.ticks):
        seen = state + bias + sigmas * noise.six_normals(tick, 12, 34)
        commands.append(np.array(controller.force_n(seen[:3].tolist(), seen[3:].tolist())))
        np.testing.assert_allclose(flight.states[tick], state, rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(flight.forces_n[tick], commands[-1], rtol=1e-7, atol=1e-9)
        told = np.clip(commands[tick], -flown.max_force_n, flown.max_force_n)
        np.testing.assert_allclose(flight.saturated_forces_n[tick], told, rtol=1e-7, atol=1e-9)
        given = np.array(MATRIX) @ told + flown.disturbances_n[tick]
        state = a @ state + b @ given
