# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Relative motion against the textbook's matrix, quadrature, SciPy and the conserved quantities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_oracles import MP, exact_step, input_matrix, transition_matrix
from hypothesis import given
from hypothesis import strategies as st

from rpo_core.world import cw
from rpo_kernels import kernels

MASS_KG = 10.0
LEO = cw.mean_motion(6.678e6)
GEO = cw.mean_motion(4.2164e7)
EPS = np.finfo(float).eps
numbers = st.floats(-100.0, 100.0)
states = st.tuples(*[numbers] * 3, *[st.floats(-1.0, 1.0)] * 3)
forces = st.tuples(*[st.floats(-0.5, 0.5)] * 3)


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


def test_step_is_the_matrices():
    step = cw.discretise(LEO, MASS_KG, 7.0)
    a, b = cw.matrices(step)
    rng = np.random.default_rng(1)
    for state, force in zip(rng.normal(size=(50, 6)), rng.normal(size=(50, 3)), strict=True):
        got = kernels.cw_step(tuple(state), tuple(force), step)
        np.testing.assert_allclose(got, a @ state + b @ force, rtol=1e-13, atol=1e-14)


@given(states, forces, numbers, numbers)
def test_out_of_plane_motion_is_decoupled_bit_for_bit(state, force, other, other_force):
    step = cw.discretise(LEO, MASS_KG, 0.1)
    x, y, z, vx, vy, vz = state
    got = kernels.cw_step(state, force, step)
    plane = kernels.cw_step((x, y, other, vx, vy, other), (*force[:2], other_force), step)
    vertical = kernels.cw_step(
        (other, other, z, other, other, vz), (other_force, other_force, force[2]), step
    )
    assert (got[0], got[1], got[3], got[4]) == (plane[0], plane[1], plane[3], plane[4])
    assert (got[2], got[5]) == (vertical[2], vertical[5])


@given(states, forces)
def test_plant_saturates_the_command_and_not_the_disturbance(state, disturbance):
    step = cw.discretise(LEO, MASS_KG, 0.1)
    flown = kernels.plant_step(state, (3.0, -0.5, -7.0), disturbance, 0.5, step)
    total = (0.5 + disturbance[0], -0.5 + disturbance[1], -0.5 + disturbance[2])
    assert flown == kernels.cw_step(state, total, step)


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
        for got, true in zip(kernels.sin_cos(angle), (MP.sin(exact), MP.cos(exact)), strict=True):
            assert abs(MP.mpf(got) - true) <= 2.5 * math.ulp(abs(float(true))), angle


@given(st.floats(-1e6, 1e6, exclude_min=True, exclude_max=True))
def test_sine_is_odd_and_cosine_even_bit_for_bit(angle):
    sine, cosine = kernels.sin_cos(angle)
    assert kernels.sin_cos(-angle) == (-sine, cosine)


def test_stumpff_functions_are_exact_where_differences_cancel():
    rng = np.random.default_rng(4)
    for angle in [
        0.0,
        1.0,
        math.nextafter(1.0, 2.0),
        *10 ** rng.uniform(-9, 0, 300),
        *rng.uniform(1, 6, 300),
    ]:
        a = MP.mpf(float(angle))
        exact = (
            (MP.cos(a), MP.sin(a) / a, (1 - MP.cos(a)) / a**2, (a - MP.sin(a)) / a**3)
            if a
            else (1, 1, MP.mpf(1) / 2, MP.mpf(1) / 6)
        )
        bound = EPS if angle <= 1.0 else 3 * EPS  # beyond 1 they are plain differences
        for got, true in zip(cw.stumpff(float(angle)), exact, strict=True):
            assert abs(MP.mpf(got) - true) <= bound, angle
