# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Transfers of least energy, beside NumPy's least norm and a quadratic program of SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from rpo_core.guidance import transfers
from rpo_core.guidance.transfers import Limits
from rpo_core.world import cw

N_RAD_S = cw.mean_motion(6_678_000.0)
STEP = cw.discretise(N_RAD_S, 10.0, 4.0)
BEHIND = (0.0, -120.0, 20.0, 0.02, 0.0, -0.03)
GATE = (0.0, 20.0, 0.0, 0.0, -0.12, 0.0)


def rows_of_all(segments):
    """Return the 6 x 3n matrix from forces to the final state, by powers of the matrices."""
    a, b = cw.matrices(STEP)
    return np.hstack([np.linalg.matrix_power(a, segments - 1 - k) @ b for k in range(segments)])


def test_without_a_sphere_it_is_the_least_norm_of_the_forces():
    segments, start = 100, np.array(BEHIND)
    found = transfers.least_energy(BEHIND, GATE, STEP, segments)
    a, _ = cw.matrices(STEP)
    missing = np.array(GATE) - np.linalg.matrix_power(a, segments) @ start
    forces = np.linalg.lstsq(rows_of_all(segments), missing, rcond=None)[0]
    np.testing.assert_allclose(found.forces.ravel(), forces, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.states[-1], GATE, atol=1e-7)


def test_with_burns_it_coasts_in_between():
    found = transfers.least_energy(BEHIND, GATE, STEP, 100, burn=5)
    assert np.abs(found.forces[5:95]).max() == 0.0
    assert np.abs(found.forces[:5]).max() > 0.0
    np.testing.assert_allclose(found.states[-1], GATE, atol=1e-7)


def test_with_ease_force_is_dearer_where_it_ends():
    """Beside a weighted least norm of NumPy: force k costs 1 / share_k."""
    segments, ease = 100, 20
    found = transfers.least_energy(BEHIND, GATE, STEP, segments, ease=ease)
    shares = np.ones(segments)
    shares[-ease:] = (np.arange(ease)[::-1] + 0.5) / ease
    root = np.repeat(np.sqrt(shares), 3)
    a, _ = cw.matrices(STEP)
    missing = np.array(GATE) - np.linalg.matrix_power(a, segments) @ np.array(BEHIND)
    forces = root * np.linalg.lstsq(rows_of_all(segments) * root, missing, rcond=None)[0]
    np.testing.assert_allclose(found.forces.ravel(), forces, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.states[-1], GATE, atol=1e-7)
    free = transfers.least_energy(BEHIND, GATE, STEP, segments)
    assert np.abs(found.forces[-1]).max() < 0.1 * np.abs(free.forces[-1]).max()


@pytest.mark.parametrize('start', [BEHIND, (0.0, -60.0, 0.0, 0.0, 0.0, 0.0)])
def test_around_the_sphere_it_costs_no_more_than_the_best_that_slsqp_finds(start):
    """Each of few segments; SLSQP starts from our path, and finds nothing better than 1 %."""
    step, segments, radius = cw.discretise(N_RAD_S, 10.0, 20.0), 20, 13.0
    found = transfers.least_energy(start, GATE, step, segments, Limits(radius))
    assert found.violated_m <= transfers.SLACK_M
    a, b = cw.matrices(step)

    def path(forces):
        state, states = np.array(start), []
        for force in forces.reshape(-1, 3):
            state = a @ state + b @ force
            states.append(state)
        return np.array(states)

    best = minimize(
        lambda f: (f * f).sum(),
        found.forces.ravel(),
        jac=lambda f: 2.0 * f,
        constraints=[
            {'type': 'eq', 'fun': lambda f: (path(f)[-1] - GATE) * ([1.0] * 3 + [100.0] * 3)},
            {
                'type': 'ineq',
                'fun': lambda f: (
                    np.linalg.norm(path(f)[:-1, :3], axis=1) - radius + transfers.SLACK_M
                ),
            },
        ],
        options={'maxiter': 60},
    )
    assert (found.forces**2).sum() <= best.fun * 1.01


@pytest.mark.parametrize('seed', range(4))
def test_from_anywhere_around_it_keeps_out(seed):
    rng = np.random.default_rng(seed)
    for _ in range(10):
        direction = rng.normal(size=3)
        position = direction / np.linalg.norm(direction) * rng.uniform(50.0, 200.0)
        start = (*position.tolist(), *rng.uniform(-0.1, 0.1, 3).tolist())
        found = transfers.least_energy(start, GATE, STEP, 100, Limits(13.0))
        assert np.linalg.norm(found.states[:, :3], axis=1).min() >= 12.99
        np.testing.assert_allclose(found.states[-1], GATE, atol=1e-6)


@pytest.mark.parametrize('seed', range(3))
def test_from_anywhere_it_enters_by_the_corridor(seed):
    rng, slope, port = np.random.default_rng(seed), np.tan(np.radians(7.0)), (0.0, 1.0, 0.0)
    zones = Limits(13.0, 110, ((*port, 0.0, 1.0, 0.0),), slope, 19.0)
    for _ in range(5):
        direction = rng.normal(size=3)
        position = direction / np.linalg.norm(direction) * rng.uniform(50.0, 200.0)
        start, end = (*position.tolist(), 0.0, 0.0, 0.0), (*port, 0.0, -0.07, 0.0)
        found = transfers.least_energy(start, end, STEP, 150, zones)
        path = found.states[:, :3]
        assert np.linalg.norm(path[:110], axis=1).min() >= 13.0 - transfers.SLACK_M
        along, across = path[110:150, 1] - 1.0, np.hypot(path[110:150, 0], path[110:150, 2])
        assert along[0] >= 19.0 - transfers.SLACK_M
        assert (across <= slope * along + transfers.SLACK_M).all()


def test_through_the_centre_it_passes_below():
    start = (0.0, -100.0, 0.0, 0.0, 0.0, 0.0)
    found = transfers.least_energy(start, (0.0, 100.0, 0.0, 0.0, 0.0, 0.0), STEP, 100, Limits(13.0))
    nearest = int(np.linalg.norm(found.states[:, :3], axis=1).argmin())
    assert found.violated_m <= transfers.SLACK_M
    assert abs(found.states[nearest, 2]) < 1e-6  # it stays in the plane of the orbit
