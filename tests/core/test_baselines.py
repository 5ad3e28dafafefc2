# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Baselines of the fuzzy controller: their laws against other ways to compute them, their files."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from core_documents import changed, document, keys, refusal
from core_oracles import exact_step
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_lyapunov

from rpo_core.chain.flight import fly
from rpo_core.control.baselines import Mpc, Pd, PotentialField, sliding_surface
from rpo_core.control.controller import load_controller, load_fuzzy
from rpo_core.files.validation import InputError
from rpo_core.scenario.scenario import load_scenario
from rpo_core.world.disturbance import Disturbance

NAMES = ('pd', 'lqr', 'mpc', 'apf_smc', 'drift')
APPROACH = load_scenario('approach')

states = st.tuples(*[st.floats(-300, 300)] * 3, *[st.floats(-5, 5)] * 3)
starts = st.tuples(*[st.floats(-100, 100)] * 3)


def from_start(position, duration=200.0, **changes):
    return replace(APPROACH, initial_position_m=position, duration_s=duration, **changes)


@pytest.mark.parametrize('name', NAMES)
@settings(max_examples=12)
@given(state=states, tick=st.integers(0, 5000))
def test_forces_are_odd_bit_for_bit_and_within_the_limit(name, state, tick):
    baseline = load(name)
    force = baseline.force_n(state[:3], state[3:], tick)
    mirrored = tuple(-x for x in state)
    assert baseline.force_n(mirrored[:3], mirrored[3:], tick) == tuple(-f for f in force)
    assert max(map(abs, force)) <= baseline.max_force_n
    assert all(type(f) is float and math.isfinite(f) for f in force)


_LOADED = {}


def load(name):
    return _LOADED.setdefault(name, load_controller(name))


def test_pd_flies_the_linear_system_that_it_closes():
    """x+ = (A - B K) x as long as nothing saturates; A and B by the matrix exponential."""
    pd = Pd(name='pd', max_force_n=100.0, position_gain_n_m=0.05, velocity_gain_n_s_m=0.6)
    scenario = from_start((5.0, -8.0, 3.0), 60.0)
    a, b = exact_step(scenario.mean_motion_rad_s, scenario.mass_kg, scenario.dt_s)
    closed = a - b @ np.hstack([0.05 * np.eye(3), 0.6 * np.eye(3)])
    expected = np.linalg.matrix_power(closed, 600) @ np.array(scenario.start)
    np.testing.assert_allclose(fly(scenario, pd).states[-1], expected, rtol=0, atol=1e-10)


def test_lqr_solves_the_riccati_equation_of_its_weights():
    lqr = load('lqr')
    a, b = lqr.model.matrices()
    k = np.array(lqr.gains)
    q = np.diag([lqr.position_weight] * 3 + [lqr.velocity_weight] * 3)
    closed = a - b @ k
    assert np.abs(np.linalg.eigvals(closed)).max() < 1.0
    cost = solve_discrete_lyapunov(closed.T, q + k.T @ k)  # of flying K for ever
    improved = np.linalg.solve(np.eye(3) + b.T @ cost @ b, b.T @ cost @ a)
    np.testing.assert_allclose(k, improved, rtol=0, atol=1e-9 * np.abs(k).max())
    residual = a.T @ cost @ a - cost - a.T @ cost @ b @ improved + q
    assert np.abs(residual).max() < 1e-9 * np.abs(cost).max()


def test_mpc_gains_are_the_first_forces_of_least_norm_plans():
    """The pseudo-inverse of the map from all forces to the final state, tick by tick."""
    model = replace(Mpc(name='m', horizon_s=60.0, least_time_to_go_s=10.0).model, dt_s=1.0)
    mpc = Mpc(name='m', max_force_n=1e3, horizon_s=60.0, least_time_to_go_s=10.0, model=model)
    a, b = model.matrices()
    for tick in (0, 1, 29, 49, 50, 51, 400):
        left = max(60 - tick, 10)
        powers = [np.linalg.matrix_power(a, left - 1 - k) @ b for k in range(left)]
        plan = -np.linalg.pinv(np.hstack(powers)) @ np.linalg.matrix_power(a, left)
        for state in np.eye(6):
            force = mpc.force_n(state[:3], state[3:], tick)
            np.testing.assert_allclose(force, plan[:3] @ state, rtol=1e-7, atol=1e-10)


def test_sliding_surface_is_the_gradient_of_the_potential():
    speed, radius, r = 0.8, 12.0, np.array([30.0, -7.0, 3.0])

    def potential(position):
        return speed * math.sqrt(position @ position + radius * radius)

    steps = 1e-5 * np.eye(3)
    gradient = [(potential(r + h) - potential(r - h)) / 2e-5 for h in steps]
    surface = sliding_surface((*r, 0.1, 0.2, -0.3), speed, radius)
    np.testing.assert_allclose(surface, np.array([0.1, 0.2, -0.3]) + gradient, atol=1e-8)


@settings(max_examples=10)
@given(starts, st.tuples(*[st.floats(-0.03, 0.03)] * 3))
def test_the_sliding_surface_is_reached_and_kept(start, push):
    """Outside the layer |s| falls at (gain - |d|) / m at least; inside it stays."""
    apf = PotentialField(
        name='apf',
        max_force_n=50.0,
        approach_speed_m_s=1.0,
        rounding_radius_m=40.0,
        switching_gain_n=0.2,
        boundary_layer_m_s=0.05,
    )
    flight = fly(from_start(start, 70.0, disturbance=Disturbance(push)), apf)
    surface = np.abs([sliding_surface(tuple(s), 1.0, 40.0) for s in flight.states[::10].tolist()])
    outside = surface[:-1] > 0.05
    falls = (surface[:-1] - surface[1:])[outside]
    least = (0.2 - np.abs(np.broadcast_to(push, surface[:-1].shape))[outside]) / 10.0
    crosses = surface[1:][outside] <= 0.05
    assert (crosses | (falls >= 0.9 * least)).all()
    assert surface[-1].max() <= 0.0501  # 1 m/s at most at 0.017 m/s^2 at least: within 60 s


def test_a_law_that_counts_ticks_refuses_others():
    other = replace(APPROACH, dt_s=0.05)
    with pytest.raises(InputError, match=r'counts ticks of 0\.1 s; .* has 0\.05'):
        fly(other, load('mpc'))
    assert fly(other, load('lqr')).states.shape == (8001, 6)


@pytest.mark.parametrize('name', NAMES)
def test_what_only_a_fuzzy_controller_can_is_refused(name):
    with pytest.raises(InputError, match=f'must be a fuzzy one here; {name} is of kind {name}$'):
        load_fuzzy(name)


@pytest.mark.parametrize('name', NAMES)
def test_numbers_are_within_their_ranges(name):
    shipped = document('controller', name)
    for path in keys(shipped):
        number = shipped['model'][path[1]] if path[0] == 'model' and path[1:] else shipped[path[0]]
        if path[0] == 'provenance' or type(number) is not float:
            continue
        for bad in (-1.0, 1e12):
            message = refusal('controller', changed(shipped, path, bad))
            assert f'`{path[-1]}` must be a finite number' in message and f'got {bad!r}' in message
