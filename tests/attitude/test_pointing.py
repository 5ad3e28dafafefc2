# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Where the chaser shall look, against SciPy's rotations and finite differences."""

from __future__ import annotations

from dataclasses import replace
from math import degrees, radians, sin

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rpo_core.attitude.attitude_kernels import synchronised
from rpo_core.attitude.chaser import Chaser
from rpo_core.attitude.pointing import Pointing, PointingStage, contact_turn, looking
from rpo_core.attitude.target import Target, known_motion
from rpo_core.scenario import scenario as scenarios

MATE = (0.1, -0.5, 0.2, 0.8)
PORT = (0.3, 1.0, -0.2)
SETTINGS = Pointing(
    mate=MATE, docking_axis=(0.2, -1.0, 0.3), port_m=PORT, align_within_m=3.0, most_deg_s=5.0
)
TUMBLE = Target(
    kind='tumble',
    attitude=(0.1, 0.2, -0.3, 0.9),
    rates_deg_s=(0.3, 0.4, 0.85),
    inertia_kg_m2=((120.0, 0.0, 0.0), (0.0, 150.0, 0.0), (0.0, 0.0, 200.0)),
    known_error_deg=(1.0, -2.0, 0.5),
)
APPROACH = scenarios.load_scenario('approach')
TURNING = replace(APPROACH.equipped(TUMBLE), goal_position_m=(0.0, 0.0, 0.0))


def stage(scenario=TURNING, **fields):
    return PointingStage(replace(SETTINGS, **fields), scenario)


def first(made, state, tick=0):
    """Return the reference of a chaser that has looked nowhere before."""
    made.reset()
    return np.array(made.step(tick, tuple(map(float, state)))[0])


def target_of(scenario, tick=0):
    """Return the known attitude of the target; without any, that of LVLH."""
    motion = known_motion(scenario)
    return motion.attitude(tick) if motion else synchronised(scenario.mean_motion_rad_s)


def docked(scenario, tick=0):
    target = target_of(scenario, tick)
    return Rotation.from_quat(target[:4]) * Rotation.from_quat(SETTINGS.mate)


def towards_port(scenario, state, tick=0):
    target = Rotation.from_quat(target_of(scenario, tick)[:4])
    found = target.apply(PORT) - np.array(state[:3])
    return found / np.linalg.norm(found)


@pytest.mark.parametrize('scenario', [APPROACH, TURNING])
def test_near_the_port_the_axes_are_those_of_the_docked_attitude(scenario):
    made = stage(scenario)
    found = first(made, (0.5, 1.2, 0.4, 0.01, -0.1, 0.0), 30)
    target = target_of(scenario, 30)
    assert (docked(scenario, 30).inv() * Rotation.from_quat(found[:4])).magnitude() < 1e-12
    rate = Rotation.from_quat(found[:4]).apply(found[4:])
    assert_allclose(rate, Rotation.from_quat(target[:4]).apply(target[4:]), atol=1e-15)
    if scenario is APPROACH:
        assert target == (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, scenario.mean_motion_rad_s)


places = st.tuples(*[st.floats(-100.0, 100.0)] * 3)
speeds = st.tuples(*[st.floats(-0.3, 0.3)] * 3)


@given(places)
def test_far_away_the_docking_axis_looks_at_the_port_by_the_smallest_turn(place):
    made = stage()
    assume(np.linalg.norm(np.subtract(place, PORT)) > 10.0)
    q = Rotation.from_quat(first(made, (*place, 0.0, 0.0, 0.0))[:4])
    axis = np.array(SETTINGS.docking_axis) / np.linalg.norm(SETTINGS.docking_axis)
    looks = towards_port(TURNING, place)
    assert_allclose(q.apply(axis), looks, atol=1e-9)
    looked = docked(TURNING).apply(axis)
    between = np.arctan2(np.linalg.norm(np.cross(looked, looks)), looked @ looks)
    assert (docked(TURNING).inv() * q).magnitude() == pytest.approx(between, abs=1e-7)


@given(places, st.integers(0, 99))
def test_the_reference_begins_where_the_chaser_looks(place, seed):
    chaser, most = Rotation.random(random_state=seed), SETTINGS.most_deg_s * APPROACH.dt_s
    made = stage(TURNING.equipped(Chaser(inertia_kg_m2=np.eye(3).tolist())))
    inputs = (*place, 0.0, 0.0, 0.0), (*chaser.as_quat().tolist(), 0.0, 0.0, 0.0)
    found = Rotation.from_quat(made.step(0, *inputs)[0][:4])
    assert degrees((chaser.inv() * found).magnitude()) == pytest.approx(most, rel=1e-3)


@given(places, speeds)
def test_the_rate_is_that_of_the_attitude(place, velocity):
    """Central differences, half a tick of flight to each side."""
    made, h = stage(most_deg_s=90.0), APPROACH.dt_s
    before, now, after = (np.array(place) + t * np.array(velocity) for t in (-h, 0.0, h))
    assume(np.linalg.norm(now) > 4.0)
    found = [first(made, (*r, *velocity), 50 + i) for i, r in enumerate((before, now, after))]
    assume(np.linalg.norm(found[1][4:]) < radians(4.0))  # else near the other way
    a, b, c = (Rotation.from_quat(row[:4]) for row in found)
    orbit = Rotation.from_rotvec([0.0, 0.0, 2.0 * h * TURNING.mean_motion_rad_s])
    turned = (b.inv() * orbit * c * a.inv() * b).as_rotvec() / (2.0 * h)
    assert_allclose(turned, found[1][4:], atol=2e-5)


def test_the_reference_turns_no_faster_than_it_may_and_keeps_the_port_in_view():
    """Past the place behind the target where the smallest turn changes its axis; then inwards."""
    own = np.array([0.0, -1.0, 0.0])
    made = stage(APPROACH, mate=(0.0, 0.0, 0.0, 1.0), docking_axis=tuple(own))
    dt, n, most = APPROACH.dt_s, APPROACH.mean_motion_rad_s, SETTINGS.most_deg_s
    path = [(0.4, -20.0, 3.0 - 0.01 * k, 0.0, 0.0, -0.1) for k in range(600)]
    path += [(0.0, 20.0 - 0.01 * k, 2.0, 0.0, -0.1, 0.0) for k in range(1800)]
    rows = np.array([made.step(k, tuple(map(float, s)))[0] for k, s in enumerate(path)])
    q = Rotation.from_quat(rows[:, :4])
    rates = rows[:, 4:] - q.inv().apply([0.0, 0.0, n])
    about = rates @ own
    assert degrees(np.abs(about).max()) == pytest.approx(most, rel=1e-6), 'it was at its limit'
    assert degrees(np.linalg.norm(rates - about[:, None] * own, axis=1).max()) < most + 1e-6
    steps = (q[:-1].inv() * q[1:]).as_rotvec() / dt
    assert degrees(np.linalg.norm(steps, axis=1).max()) < 1.5 * most
    assert_allclose(steps[:599], rates[1:600], atol=3e-4)
    late = slice(1600, -1)  # it has caught up with the other end of the path
    assert_allclose(steps[late], 0.5 * (rates[:-1] + rates[1:])[late], atol=5e-5)
    looks = np.array(PORT) - np.array(path)[:600, :3]
    looks /= np.linalg.norm(looks, axis=1)[:, None]
    assert_allclose(q[:600].apply(own), looks, atol=1e-9)


@given(places, st.floats(0.01, 1.0), st.floats(0.0, 0.05), st.integers(0, 2**32 - 1))
def test_how_fast_the_axis_follows_the_port(place, speed, turns, seed):
    """docs/safety.md, after lemma 8; the corner of all three vectors reaches the bound."""
    random = np.random.default_rng(seed)
    aim = replace(SETTINGS, align_within_m=1.0).aim(APPROACH.dt_s)
    far, port = np.linalg.norm(place), np.linalg.norm(PORT)
    assume(far > 2.0 + port)
    bound = (speed + turns * far) / (far - port)

    def across(place, velocity, turn):
        seen = (*place, *(velocity - np.cross(turn, place)))
        rate = np.array(looking(tuple(map(float, seen)), aim)[1])
        return np.linalg.norm(np.cross(rate, aim.axis))

    velocity, turn = random.normal(size=(2, 3))
    velocity *= speed / np.linalg.norm(velocity)
    turn *= turns / np.linalg.norm(turn)
    assert across(np.array(place), velocity, turn) <= bound * (1.0 + 1e-9) + 1e-12
    ahead = np.array(PORT) / port
    beside = np.cross(ahead, [0.0, 0.0, 1.0])
    beside /= np.linalg.norm(beside)
    turn = -turns * np.cross(ahead, beside)
    assert across(far * ahead, speed * beside, turn) == pytest.approx(bound, rel=1e-6)


def test_about_its_docking_axis_it_settles():
    """From any attitude, on a path on which the port stays where it is."""
    made = stage(APPROACH)
    path = (6.0, 40.0, 5.0, 0.0, 0.0, 0.0)
    wanted = first(made, path)
    made.reset()
    made.m.before = Rotation.random(random_state=3).as_quat().tolist()
    for tick in range(2000):
        (found,) = made.step(tick, path)
    assert_allclose(found[:4], wanted[:4], atol=1e-9)


def test_from_behind_the_target_it_looks_at_the_port():
    made = stage(APPROACH, mate=(0.0, 0.0, 0.0, 1.0), docking_axis=(0.0, -1.0, 0.0))
    behind = (PORT[0], -50.0, PORT[2], 0.0, 0.0, 0.0)
    found = Rotation.from_quat(first(made, behind)[:4])
    assert_allclose(found.apply([0.0, -1.0, 0.0]), [0.0, 1.0, 0.0], atol=1e-9)


@given(st.tuples(*[st.floats(-170.0, 170.0)] * 3), speeds)
def test_angles_at_contact_are_those_of_the_docked_attitude(angles, rate):
    target = (*TUMBLE.attitude, *TUMBLE.rates_rad_s)
    off = Rotation.from_rotvec(angles, degrees=True)
    mated = Rotation.from_quat(target[:4]) * Rotation.from_quat(SETTINGS.mate) * off
    theirs = Rotation.from_quat(target[:4]).apply(target[4:])
    own = mated.inv().apply(theirs) + np.array(rate)
    angle, spin = contact_turn((*mated.as_quat(), *own), target, SETTINGS.mate)
    half, axis = off.magnitude() / 2.0, off.as_rotvec()
    size = np.linalg.norm(axis)
    expected = degrees(2.0 * sin(half)) * np.abs(axis / size if size else axis).max()
    assert angle == pytest.approx(expected, abs=1e-9)
    assert spin == pytest.approx(degrees(np.linalg.norm(rate)), abs=1e-9)


@given(st.tuples(*[st.floats(-9.0, 9.0)] * 3))
def test_the_axis_of_half_a_turn_is_across_the_docking_axis(axis):
    assume(np.linalg.norm(axis) > 0.01)
    aim = replace(SETTINGS, docking_axis=axis).aim(0.1)
    ahead = Rotation.from_quat(aim.mate).apply(np.array(axis) / np.linalg.norm(axis))
    assert_allclose(aim.axis, ahead, atol=1e-12)
    assert np.linalg.norm(aim.aside) == pytest.approx(1.0)
    assert abs(np.dot(aim.aside, ahead)) < 1e-12


def test_without_a_corridor_a_chaser_may_dock_with_any_side():
    scenario = scenarios.load_scenario('approach').equipped(
        Chaser(inertia_kg_m2=np.eye(3).tolist())
    )
    for axis in ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0)):
        assert scenario.equipped(Pointing(docking_axis=axis)).named('pointing').docking_axis == axis
