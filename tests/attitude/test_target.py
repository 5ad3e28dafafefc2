# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How the target turns, against SciPy's integrator and rotations, closed form and conservation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from rpo_core.attitude.target import (
    Target,
    TargetStage,
    in_lvlh,
    motion_of,
    quaternion,
)
from rpo_core.chain.flight import OpenLoop, fly
from rpo_core.files.validation import InputError
from rpo_core.scenario import scenario as scenarios

INERTIA = ((10.0, 0.5, 0.0), (0.5, 14.0, 0.3), (0.0, 0.3, 20.0))
TUMBLE = Target(
    kind='tumble',
    attitude=(0.1, 0.2, -0.3, 0.9),
    rates_deg_s=(3.5, 9.3, 6.0),  # 11.6 deg/s together
    inertia_kg_m2=INERTIA,
)
APPROACH = replace(scenarios.load_scenario('approach'), duration_s=400.0)


def quaternions(motion, ticks):
    return Rotation.from_quat([motion.attitude(tick)[:4] for tick in ticks])


def test_a_tumble_is_that_of_another_integrator():
    n, inertia = APPROACH.mean_motion_rad_s, np.array(INERTIA)
    motion = motion_of(TUMBLE, APPROACH)

    def change(_t, y):
        # Inertial space: the matrix of the attitude, and Euler's equation.
        turned, rate = y[:9].reshape(3, 3), y[9:]
        cross = np.cross(np.eye(3), rate)
        return [
            *(turned @ cross).ravel(),
            *np.linalg.solve(inertia, np.cross(inertia @ rate, rate)),
        ]

    begin = [*Rotation.from_quat(TUMBLE.attitude).as_matrix().ravel(), *TUMBLE.rates_rad_s]
    end = solve_ivp(change, (0.0, 400.0), begin, 'DOP853', rtol=1e-13, atol=1e-15).y[:, -1]
    orbit = Rotation.from_rotvec([0.0, 0.0, -n * 400.0])
    theirs = orbit * Rotation.from_matrix(end[:9].reshape(3, 3))
    ours = motion.attitude(4000)
    assert (theirs.inv() * Rotation.from_quat(ours[:4])).magnitude() < 1e-10
    assert_allclose(ours[4:], end[9:], atol=1e-12)


@pytest.mark.parametrize('ticks', [20_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
def test_energy_and_momentum_of_a_tumble_stay(ticks):
    motion, inertia = motion_of(TUMBLE, APPROACH), np.array(INERTIA)
    n = APPROACH.mean_motion_rad_s
    every = range(0, ticks + 1, ticks // 100)
    rates = np.array([motion.attitude(tick)[4:] for tick in every])
    momenta = rates @ inertia
    energy = (rates * momenta).sum(axis=1)
    assert_allclose(energy, energy[0], rtol=1e-12)
    back = Rotation.from_rotvec([[0.0, 0.0, n * tick * APPROACH.dt_s] for tick in every])
    inertial = (back * quaternions(motion, every)).apply(momenta)
    assert_allclose(
        inertial, inertial[:1].repeat(len(rates), 0), atol=1e-10 * np.abs(momenta).max()
    )


def test_a_spin_turns_about_its_axis_and_a_fixed_target_not_at_all():
    n = APPROACH.mean_motion_rad_s
    spin = Target(kind='spin', axis=(0.0, 3.0, 4.0), rate_deg_s=2.0)
    turned = Rotation.from_rotvec(np.radians(2.0) * 400.0 * np.array([0.0, 0.6, 0.8]))
    theirs = Rotation.from_rotvec([0.0, 0.0, -n * 400.0]) * turned
    assert (theirs.inv() * quaternions(motion_of(spin, APPROACH), [4000])[0]).magnitude() < 1e-11
    fixed = replace(spin, kind='fixed', axis=(0.0, 0.0, 1.0), rate_deg_s=0.0, attitude=(1, 0, 0, 1))
    motion = motion_of(fixed, APPROACH)
    assert motion.attitude(0) == motion.attitude(4000)
    assert_allclose(motion.attitude(9)[4:], [0.0, n, 0.0], atol=1e-18)  # x by a right angle: y' = z
    assert motion.frame(4000)[9:] == (0.0,) * 6


@given(
    st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.tuples(*[st.floats(-5.0, 5.0)] * 3),
    st.tuples(*[st.floats(-100.0, 100.0)] * 6),
)
def test_what_the_target_sees_is_the_motion_between_two_ticks(attitude, rates, state):
    """Positions seen a short time apart: their difference is the velocity seen between."""
    target = replace(TUMBLE, attitude=attitude, rates_deg_s=rates)
    short = replace(APPROACH, dt_s=1e-3, duration_s=0.1)
    x, v = np.array(state[:3]), np.array(state[3:])
    states = np.array([[*(x + k * 1e-3 * v), *v] for k in range(3)])
    seen = target.seen(states, short)
    q = quaternions(motion_of(target, short), range(3))
    assert_allclose(q.inv().apply(states[:, :3]), seen[:, :3], atol=1e-11)
    between = (seen[2, :3] - seen[0, :3]) / 2e-3
    assert_allclose(between, seen[1, 3:], atol=1e-4)


def test_what_is_known_of_the_target_is_turned_by_its_error_all_the_time():
    target = replace(TUMBLE, known_error_deg=(2.0, -1.0, 0.5))
    truth, known = motion_of(target, APPROACH), motion_of(target.known, APPROACH)
    ticks = range(0, 4001, 400)
    off = quaternions(truth, ticks).inv() * quaternions(known, ticks)
    assert_allclose(np.degrees(off.as_rotvec()), [[2.0, -1.0, 0.5]] * 11, atol=1e-9)
    turned = off[0].inv().apply([truth.attitude(tick)[4:] for tick in ticks])
    assert_allclose([known.attitude(tick)[4:] for tick in ticks], turned, atol=1e-13)
    assert TUMBLE.known is TUMBLE


def test_the_attitude_is_a_signal_with_w_of_one_sign():
    scenario = replace(APPROACH, duration_s=60.0).equipped(TUMBLE)
    flight = fly(scenario, OpenLoop(np.zeros((1, 3))))
    q = flight.signals['target_attitude']
    assert q.shape == (601, 7) and (q[:, 3] >= 0.0).all() and (np.diff(q[:, 3]) != 0.0).any()
    first = TargetStage(TUMBLE, scenario).step(0)[0]
    assert_allclose(first, q[0], rtol=0.0, atol=0.0)
    assert fly(replace(APPROACH, duration_s=60.0), OpenLoop(np.zeros((1, 3)))).states.tobytes() == (
        flight.states.tobytes()
    )


def test_where_the_target_turns_a_goal_is_in_its_axes():
    with pytest.raises(InputError, match='`goal_position_m` is in the axes of `target`'):
        replace(APPROACH, goal_position_m=(0.0, 5.0, 0.0)).equipped(TUMBLE)


def test_a_corridor_is_drawn_where_the_target_sees_it():
    zones = scenarios.load_scenario('docking').zones
    frame = motion_of(TUMBLE, APPROACH).frame(1234)
    zone = zones.zone({'hold': (3.0, 20.0, -1.0)})
    turned = in_lvlh(zone, frame)
    points = np.random.default_rng(1).uniform(-15.0, 15.0, (200, 3))
    seen = Rotation.from_quat(motion_of(TUMBLE, APPROACH).attitude(1234)[:4]).inv().apply(points)
    assert_allclose(turned.depths_m(points), zone.depths_m(seen), atol=1e-12)
    assert 0 < np.count_nonzero(zone.depths_m(seen)) < 200
    assert_allclose(np.linalg.norm(turned.points_m['hold']), np.sqrt(410.0))


def test_the_largest_are_those_of_the_frames():
    motion = motion_of(TUMBLE, APPROACH)
    frames = [motion.frame(tick) for tick in range(300)]
    turns = [max(abs(frame[i]) for frame in frames) for i in range(9, 15)]
    rows = [frame[i : i + 3] for frame in frames for i in (0, 3, 6)]
    spread = max(abs(x) + abs(y) + abs(z) for x, y, z in rows)
    assert motion.largest(300).tolist() == [*turns, spread]


@given(
    st.lists(st.floats(-10.0, 10.0), min_size=4, max_size=4).filter(
        lambda q: max(map(abs, q)) > 1e-3
    )
)
def test_a_quaternion_that_is_written_is_read_with_its_bits(q):
    """Else the log of a flight would fly another one: one in three changed."""
    read = Target(kind='fixed', attitude=q)
    assert Target(kind='fixed', attitude=read.attitude) == read
    assert np.linalg.norm(read.attitude) == pytest.approx(1.0, abs=1e-15)


def test_a_plate_is_a_body_and_a_line_is_none():
    def solid(*moments):
        return Target(kind='tumble', inertia_kg_m2=tuple(map(tuple, np.diag(moments).tolist())))

    assert solid(1.0, 2.0, 3.0).inertia_kg_m2[2] == (0.0, 0.0, 3.0)
    for moments in ((0.0, 1.0, 1.0), (1.0, 2.0, 3.001), (-1.0, 2.0, 2.0)):
        with pytest.raises(InputError, match='its principal moments > 0 and none above the sum'):
            solid(*moments)


def test_a_quaternion_of_any_length_but_none_is_an_attitude():
    """From a millionth on, with its sign such that w >= 0."""
    for size in (1.01e-6, 1.0, 999.0):
        found = quaternion('attitude', [0.6 * size, 0.0, 0.0, -0.8 * size])
        assert_allclose(found, (-0.6, 0.0, 0.0, 0.8), rtol=1e-14)
    with pytest.raises(InputError, match='`attitude` must be a quaternion with a length'):
        quaternion('attitude', [0.0, 0.99e-6, 0.0, 0.0])
