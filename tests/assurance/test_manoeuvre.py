# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Collision avoidance beside flights by SciPy's matrices, each thruster stuck in turn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_oracles import exact_step
from scipy.integrate import solve_ivp

from rpo_core.assurance import manoeuvre
from rpo_core.assurance.manoeuvre import PathModel
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.scenario import scenario
from rpo_core.world import cw

AROUND = scenario.load_scenario('around')
N, MASS, LIMIT = AROUND.mean_motion_rad_s, 10.0, 0.5
TWO_ORBITS, DRAG, STUCK_S, RADIUS = 4.0 * math.pi / N, 1.2e-6, 30.0, 10.0
ERROR, DONE = 0.0005, 0.0005
WORLD = PathModel(N, MASS, LIMIT, STUCK_S, STUCK_S + 90.0, TWO_ORBITS, DRAG, ERROR, DONE)
STEP = cw.discretise(N, MASS, manoeuvre.STEP_S)
CASES = [(axis, side) for axis in range(3) for side in (1.0, -1.0)]


def moved_by(seconds):
    """Return what states and accelerations from outside, as rows (n, 9), are multiplied by."""
    return np.hstack(exact_step(N, 1.0, seconds)).T


def burnt(states, wanted, stuck, tick_s=0.1):
    """Fly the law to a velocity; return the states (n, 6) after it and the least distances."""
    step = moved_by(tick_s)
    nearest = np.full(len(states), np.inf)
    burning = np.ones(len(states), dtype=bool)
    for tick in range(round(WORLD.burn_s / tick_s)):
        x, v = states[:, :3], states[:, 3:]
        off = np.linalg.norm(wanted - v, axis=1)
        burning &= (tick * tick_s < STUCK_S) | (off > DONE)
        if not burning.any():
            break
        pull = np.column_stack(
            [3 * N * N * x[:, 0] + 2 * N * v[:, 1], -2 * N * v[:, 0], -N * N * x[:, 2]]
        )
        force = np.clip(MASS * (wanted - v - pull), -LIMIT, LIMIT)
        if stuck is not None and tick * tick_s < STUCK_S:
            axis, side = stuck
            force[:, axis] = side * LIMIT + side * np.minimum(side * force[:, axis], 0.0)
        force[~burning] = 0.0
        after = np.concatenate([states, force / MASS], axis=1) @ step
        states = np.where(burning[:, None], after, states)
        nearest = np.minimum(nearest, np.linalg.norm(states[:, :3], axis=1))
    return states, nearest


def test_the_other_thruster_can_only_oppose_one_that_is_stuck():
    for force in (-0.5, -0.2, 0.0, 0.2, 0.5):
        for side in (1.0, -1.0):
            opposed = abs(force) if force * side < 0.0 else 0.0
            assert manoeuvre.with_stuck(force, side, 0.5) == side * (0.5 - opposed)


def drifted(states, along):
    """Return the least distances (n,) of drifts for two orbits, looked at every 4 s.

    along : acceleration (n,) or scalar [m/s2], from outside
    """
    seconds = 4.0
    step = moved_by(seconds)
    push = np.atleast_1d(along)[:, None] * step[7]
    squared = np.full(len(states), np.inf)
    for _ in range(math.ceil(TWO_ORBITS / seconds)):
        squared = np.minimum(squared, np.einsum('ni,ni->n', states[:, :3], states[:, :3]))
        states = states @ step[:6] + push
    return np.sqrt(squared)


def shell(count, least, most, seed):
    """Return states (count, 6) in a shell that can stop before the sphere."""
    random = np.random.default_rng(seed)
    found = []
    while len(found) < count:
        e, u = random.normal(size=(2, 3))
        e, u = e / np.linalg.norm(e), u / np.linalg.norm(u)
        rho = random.uniform(least, most)
        v = u * random.uniform(0.0, min(0.12 + math.sqrt(2 * 0.023 * rho), 0.8))
        closing = -v @ e
        if closing <= 0.0 or closing**2 / (2 * 0.045) <= rho - RADIUS:
            found.append([*(rho * e), *v])
    return np.array(found)


def chosen(states):
    """Return velocities (n, 3) and margins (n,) of the manoeuvres."""
    found = [manoeuvre.choose(tuple(s), RADIUS, STEP, WORLD) for s in states.tolist()]
    return np.array([f.velocity_m_s for f in found]), np.array([f.margin_m for f in found])


def flown(states, wanted):
    """Return the least distance of the paths from each state, whatever is stuck, with drag."""
    worst, ends, drags = [], [], []
    for stuck in (None, *CASES):
        after, nearest = burnt(states, wanted, stuck)
        worst.append(nearest)
        for side in (-1.0, 1.0):
            off = after.copy()
            off[:, 4] += side * ERROR
            for along in (-DRAG, DRAG):
                ends.append(off)
                drags.append(np.full(len(off), along))
    far = drifted(np.concatenate(ends), np.concatenate(drags))
    return np.min([*worst, *far.reshape(len(ends), -1)], axis=0)


def test_it_may_go_along_all_axes_and_diagonals():
    turned = manoeuvre.DIRECTIONS
    assert len({tuple(np.sign(direction)) for direction in turned}) == len(turned) == 26
    assert np.allclose(np.linalg.norm(turned, axis=1), 1.0)


@pytest.mark.parametrize(
    ('y_m', 'vy_m_s', 'error_m_s', 'seconds', 'least_m'),
    [
        (20.0, 0.3, 0.0, 50.0, 20.0),  # it goes away: nearest at once
        (100.0, 0.0, 0.01, 2000.0, 100.0 - 1.5 * 0.01 * 2000.0),
        (100.0, 0.0, 0.01, 9000.0, 100.0 - 4.3 * 0.01 / N),
    ],
)
def test_a_drift_is_looked_at_from_its_first_second(y_m, vy_m_s, error_m_s, seconds, least_m):
    world = WORLD._replace(drift_s=seconds, drag_m_s2=0.0, error_m_s=error_m_s)
    found = manoeuvre.nearest((0.0, y_m, 0.0, 0.0, vy_m_s, 0.0), world, 0.0)
    assert least_m - 2.0 * manoeuvre.TOLERANCE_M <= found <= least_m


@pytest.mark.every_landing
def test_what_is_clear_stays_out_whatever_is_stuck():
    """200 random states and 50 of the shipped plan: no path of a clear manoeuvre enters."""
    flight = fly(AROUND, load_controller('allround'))
    outside = flight.states[np.linalg.norm(flight.positions_m, axis=1) > RADIUS]
    plan = outside[:: len(outside) // 50][:50]
    states = np.concatenate([shell(100, 10.0, 20.0, 1), shell(100, 20.0, 200.0, 2), plan])
    wanted, margins = chosen(states)
    worst = flown(states, wanted)
    clear = margins >= 0.0
    assert (worst[clear] >= RADIUS).all()
    assert clear[100:200].all()  # from 20 m on there is always one
    assert clear[:100].mean() > 0.97
    assert clear[200:].mean() > 0.97
    # the margin is not idle talk: it is what the flights have, to a metre
    assert np.abs(worst[clear] - RADIUS - margins[clear]).max() < 5.0


@pytest.mark.parametrize('along', [-DRAG, DRAG])
def test_two_bodies_with_drag_agree(along):
    """The drift after a manoeuvre by the nonlinear equation: clear too."""
    states = shell(8, 12.0, 60.0, 5)
    wanted, margins = chosen(states)
    after, _ = burnt(states, wanted, CASES[0])
    radius = AROUND.orbit_radius_m
    mu = N * N * radius**3

    def field(_t, s):
        x, y, z, vx, vy, vz = s
        d3 = ((radius + x) ** 2 + y * y + z * z) ** 1.5
        return [
            vx, vy, vz,
            2 * N * vy + N * N * x + mu / radius**2 - mu * (radius + x) / d3,
            -2 * N * vx + N * N * y - mu * y / d3 + along,
            -mu * z / d3,
        ]  # fmt: skip

    times = np.linspace(0.0, TWO_ORBITS, 4000)
    for state, clear in zip(after, margins >= 0.0, strict=True):
        found = solve_ivp(field, (0.0, TWO_ORBITS), state, 'DOP853', times, rtol=1e-10, atol=1e-8)
        assert not clear or np.linalg.norm(found.y[:3], axis=0).min() >= RADIUS
