# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Imperfect thrusters and navigation: an independent flight, files, the perfect ones as a limit."""

import numpy as np
from core_oracles import exact_step

from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files import scenario
from rpo_kernels import noise
from rpo_nav.navigation_errors import Navigation
from rpo_thrusters.thrusters import Thrusters

QUICK = scenario.load_scenario('quick')
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
        given = np.array(MATRIX) @ told + flown.disturbance.force_n(flown.time_s(tick))
        state = a @ state + b @ given


def test_perfect_hardware_flies_as_none():
    controller = load_controller('handmade')
    plain = fly(QUICK, controller)
    perfect = fly(QUICK.equipped(Thrusters(), Navigation()), controller)
    np.testing.assert_array_equal(perfect.states, plain.states)
    np.testing.assert_array_equal(perfect.forces_n, plain.forces_n)
