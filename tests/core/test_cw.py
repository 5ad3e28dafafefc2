# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Relative motion against the textbook's matrix, quadrature, SciPy and the conserved quantities."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from core_oracles import MP, exact_step, input_matrix, system_matrices, transition_matrix
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from rpo_core.chain.flight import OpenLoop, fly
from rpo_core.kernels import arithmetic
from rpo_core.scenario.scenario import load_scenario
from rpo_core.world import cw

MASS_KG = 10.0
LEO = cw.mean_motion(6.678e6)
GEO = cw.mean_motion(4.2164e7)
EPS = np.finfo(float).eps
NO_FORCE = (0.0, 0.0, 0.0)

numbers = st.floats(-100.0, 100.0)
states = st.tuples(*[numbers] * 3, *[st.floats(-1.0, 1.0)] * 3)
forces = st.tuples(*[st.floats(-0.5, 0.5)] * 3)


def coast(state, step, ticks):
    """Return the states (ticks + 1, 6) of an unforced flight."""
    track = [state]
    for _ in range(ticks):
        track.append(cw.cw_step(track[-1], NO_FORCE, step))
    return np.array(track)


def test_mean_motion_of_the_paper_and_of_kepler():
    assert pytest.approx(1.156909e-3, abs=5e-10) == LEO
    sidereal_day_s = 86164.0905
    assert 2 * math.pi / GEO == pytest.approx(sidereal_day_s, rel=2e-5)


@pytest.mark.parametrize('n', [LEO, GEO])
@pytest.mark.parametrize('dt_s', [1e-6, 0.1, 30.0, 850.0, 1000.0])
def test_discretisation_is_the_textbook_solution_to_the_last_digits(n, dt_s):
    a, b = cw.matrices(cw.discretise(n, MASS_KG, dt_s))
    exact_a = transition_matrix(MP.mpf(n), MP.mpf(dt_s))
    exact_b = input_matrix(MP.mpf(n), MP.mpf(dt_s), MP.mpf(MASS_KG))
    # 4 sin(nt) - 3 nt and its like cancel near nt = 1.28: relative to the larger of the two terms.
    scale_a = np.array([[1, 1, 1, dt_s, dt_s, dt_s]] * 3 + [[n, n, n, 1, 1, 1]] * 3)
    for got, exact, scale in (
        (a, exact_a, scale_a),
        (b, exact_b, np.array([[dt_s**2] * 3] * 3 + [[dt_s] * 3] * 3) / MASS_KG),
    ):
        for index, value in np.ndenumerate(got):
            error = abs(MP.mpf(float(value)) - exact[index])
            assert error <= 4 * EPS * max(abs(exact[index]), scale[index] * min(1, n * dt_s) ** 3)


@pytest.mark.parametrize('dt_s', [0.1, 10.0, 400.0])
def test_discretisation_is_the_matrix_exponential(dt_s):
    a, b = exact_step(LEO, MASS_KG, dt_s)
    got_a, got_b = cw.matrices(cw.discretise(LEO, MASS_KG, dt_s))
    np.testing.assert_allclose(got_a, a, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(got_b, b, rtol=1e-13, atol=1e-13)


def test_step_follows_scipy_under_piecewise_constant_forces():
    a, b = system_matrices(LEO, MASS_KG)
    dt_s = 10.0
    step = cw.discretise(LEO, MASS_KG, dt_s)
    rng = np.random.default_rng(2)
    state = tuple(rng.uniform(-100, 100, 3)) + tuple(rng.uniform(-1, 1, 3))
    reference = np.array(state)
    for force in rng.uniform(-0.5, 0.5, (40, 3)):
        push = b @ force
        reference = solve_ivp(
            lambda _, x, push=push: a @ x + push,
            (0, dt_s),
            reference,
            method='DOP853',
            rtol=1e-10,
            atol=1e-10,
        ).y[:, -1]
        state = cw.cw_step(state, tuple(force), step)
    np.testing.assert_allclose(state[:3], reference[:3], rtol=0, atol=1e-8)
    np.testing.assert_allclose(state[3:], reference[3:], rtol=0, atol=1e-10)


def test_drift_free_ellipse_is_two_to_one_for_fifty_orbits():
    a_m, centre_m, per_orbit = 50.0, 20.0, 720
    step = cw.discretise(LEO, MASS_KG, 2 * math.pi / LEO / per_orbit)
    track = coast((a_m, centre_m, 0.0, 0.0, -2 * LEO * a_m, 0.0), step, 50 * per_orbit)
    x, y = track[:, 0], track[:, 1]
    np.testing.assert_allclose((x / a_m) ** 2 + ((y - centre_m) / (2 * a_m)) ** 2, 1, atol=1e-11)
    quarter = per_orbit // 4  # moves to -y first: clockwise, seen from +z
    np.testing.assert_allclose(track[quarter, :2], (0, centre_m - 2 * a_m), atol=1e-9)
    np.testing.assert_allclose(track[-1], track[0], atol=1e-9)


@given(states, forces, numbers, numbers)
def test_out_of_plane_motion_is_decoupled_bit_for_bit(state, force, other, other_force):
    step = cw.discretise(LEO, MASS_KG, 0.1)
    x, y, z, vx, vy, vz = state
    got = cw.cw_step(state, force, step)
    plane = cw.cw_step((x, y, other, vx, vy, other), (*force[:2], other_force), step)
    vertical = cw.cw_step(
        (other, other, z, other, other, vz), (other_force, other_force, force[2]), step
    )
    assert (got[0], got[1], got[3], got[4]) == (plane[0], plane[1], plane[3], plane[4])
    assert (got[2], got[5]) == (vertical[2], vertical[5])


@given(states)
def test_unforced_motion_conserves_its_constants(state):
    n = LEO
    step = cw.discretise(n, MASS_KG, 5.0)
    x, y, z, vx, vy, vz = coast(state, step, 300).T
    time_s = 5.0 * np.arange(301)
    centre_x = 4 * x + 2 * vy / n
    centre_y = y - 2 * vx / n + 1.5 * n * centre_x[0] * time_s
    in_plane = (3 * x + 2 * vy / n) ** 2 + (vx / n) ** 2
    out_of_plane = z**2 + (vz / n) ** 2
    jacobi = (vx**2 + vy**2 + vz**2) / 2 - 1.5 * (n * x) ** 2 + 0.5 * (n * z) ** 2
    size_m = 100 + 2 / n
    for constant, scale in (
        (centre_x, size_m),
        (centre_y, size_m),
        (in_plane, size_m**2),
        (out_of_plane, size_m**2),
        (jacobi, (n * size_m) ** 2),
    ):
        np.testing.assert_allclose(constant, constant[0], rtol=0, atol=1e-12 * scale)


@given(states, forces, st.floats(0.1, 800.0))
def test_work_of_a_constant_force_is_the_gain_of_energy(state, force, dt_s):
    def energy(s):
        x, _, z, *v = s
        return MASS_KG * (np.dot(v, v) / 2 - 1.5 * (LEO * x) ** 2 + 0.5 * (LEO * z) ** 2)

    after = cw.cw_step(state, force, cw.discretise(LEO, MASS_KG, dt_s))
    work = np.dot(force, np.subtract(after[:3], state[:3]))
    scale = energy(np.abs(after)) + energy(np.abs(state)) + abs(work) + 1e-300
    scale += 30 * MASS_KG * (LEO * max(abs(after[0]), abs(state[0]))) ** 2
    assert energy(after) - energy(state) == pytest.approx(work, abs=1e-12 * scale)


def test_plant_saturates_the_command_and_not_the_disturbance():
    scenario = replace(load_scenario('paper_test'), duration_s=2.0)
    flight = fly(scenario, OpenLoop(np.tile([3.0, -0.5, -7.0], (20, 1))))
    pushed = np.array([0.5, -0.5, -0.5]) + flight.disturbances_n
    assert np.abs(flight.disturbances_n).min(axis=0).any()
    for state, force, after in zip(flight.states, pushed.tolist(), flight.states[1:], strict=False):
        assert cw.cw_step(tuple(state), tuple(force), scenario.step) == tuple(after)


def angles():
    rng = np.random.default_rng(3)
    quarters = rng.integers(-600_000, 600_000, 1500) * (math.pi / 2)
    return np.concatenate(
        [
            rng.uniform(-1e6, 1e6, 2000),
            rng.uniform(-10, 10, 2000),
            10 ** rng.uniform(-12, 0, 1000),
            quarters,
            np.nextafter(quarters, np.inf),
            np.arange(-500, 500) * (math.pi / 4),
            [0.0, -0.0, 999_999.0, -999_999.0],
        ]
    ).tolist()


def test_sine_and_cosine_are_within_two_and_a_half_units_in_the_last_place():
    for angle in angles():
        exact = MP.mpf(angle)
        for got, true in zip(
            arithmetic.sin_cos(angle), (MP.sin(exact), MP.cos(exact)), strict=True
        ):
            assert abs(MP.mpf(got) - true) <= 2.5 * math.ulp(abs(float(true))), angle


@given(st.floats(-1e6, 1e6, exclude_min=True, exclude_max=True))
def test_sine_is_odd_and_cosine_even_bit_for_bit(angle):
    sine, cosine = arithmetic.sin_cos(angle)
    assert arithmetic.sin_cos(-angle) == (-sine, cosine)
