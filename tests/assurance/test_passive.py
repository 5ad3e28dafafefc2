# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Passive safety, beside drifts by the differential equation and by dense samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_oracles import exact_step

from rpo_core.assurance import manoeuvre
from rpo_core.scenario import scenario

N = scenario.load_scenario('paper_test').mean_motion_rad_s
TWO_ORBITS = 4.0 * math.pi / N


def drift(state, t, along):
    """Return the position by the matrix exponential of the differential equation."""
    a, b = exact_step(N, 1.0, t)
    return (a @ state + b[:, 1] * along)[:3]


def test_the_drift_is_that_of_the_differential_equation():
    random = np.random.default_rng(1)
    for _ in range(50):
        state = (*random.uniform(-100, 100, 3), *random.uniform(-0.3, 0.3, 3))
        t, along = random.uniform(0, TWO_ORBITS), random.uniform(-1e-5, 1e-5)
        found = manoeuvre.drifted(state, t, N, along)
        assert found == pytest.approx(drift(state, t, along), abs=1e-6)


@pytest.mark.parametrize('drag', [0.0, 1.2e-6])
def test_no_moment_is_missed(drag):
    """What is clear is clear in 4000 samples of each bound; what is not comes as near as that."""
    random = np.random.default_rng(2)
    clear = 0
    times = np.linspace(0.0, TWO_ORBITS, 4000)
    for _ in range(60):
        state = (*random.uniform(-80, 80, 3), *random.uniform(-0.02, 0.02, 3))
        state = (*state[:4], -2.0 * N * state[0] + random.normal() * 0.01, state[5])
        found = manoeuvre.clear_for(state, 10.0, TWO_ORBITS, N, -drag, drag)
        nearest = min(
            manoeuvre.to_segment(
                manoeuvre.drifted(state, t, N, -drag), manoeuvre.drifted(state, t, N, drag)
            )
            for t in times.tolist()
            if t <= found
        )
        if found == TWO_ORBITS:
            clear += 1
            assert nearest >= 10.0
        else:
            at = manoeuvre.to_segment(
                manoeuvre.drifted(state, found, N, -drag), manoeuvre.drifted(state, found, N, drag)
            )
            assert at <= 10.0 + 2e-3
    assert 0 < clear < 60 or drag


def test_the_moment_of_entry_is_not_passed_over():
    """Across the orbit the bound of the speed is exact: a step too long ends inside, or beyond."""
    for height, speed in ((30.0, 0.5), (45.0, 1.0), (200.0, 2.5)):
        found = manoeuvre.clear_for((0.0, 0.0, height, 0.0, 0.0, -speed), 10.0, 1000.0, N, 0.0, 0.0)
        assert 0.9 * (height - 10.0) / speed < found <= 1.01 * (height - 10.0) / speed


def test_no_drift_is_faster_than_its_bound_and_each_axis_comes_near_it():
    """The swing in the plane is reached along x and along y, not at once: a share of the bound."""
    random, times = np.random.default_rng(4), np.linspace(0.0, TWO_ORBITS, 400)
    steps = [exact_step(N, 1.0, t)[0][3:] for t in times]
    shares = []
    moved = {'x': (0, 1, 0, 1, 0, 0), 'y': (1, 1, 0, 0, 1, 0), 'z': (0, 0, 1, 0, 0, 1)}
    for axis in 'xyz':
        for _ in range(20):
            state = random.normal(size=6) * (80.0, 80.0, 80.0, 0.1, 0.1, 0.1)
            state *= moved[axis]
            speeds = np.array([velocity @ state for velocity in steps])
            bound = manoeuvre.fastest(tuple(state), TWO_ORBITS, N, 0.0)
            most = np.linalg.norm(speeds, axis=1).max()
            assert most <= bound * (1.0 + 1e-9)
            shares.append(most / bound)
    assert min(shares) > 0.85 and min(shares[40:]) > 0.9999
    pushed = [exact_step(N, 1.0, t)[1][3:, 1] * 1e-5 for t in times]
    bound = manoeuvre.fastest((0.0,) * 6, TWO_ORBITS, N, -1e-5)
    assert 0.8 * bound < np.linalg.norm(pushed, axis=1).max() <= bound
