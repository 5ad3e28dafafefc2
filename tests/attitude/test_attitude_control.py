# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Attitude controllers, against SciPy's Rotation and Riccati solver, and flown."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_continuous_are
from scipy.spatial.transform import Rotation

from rpo_core import files
from rpo_core.attitude.chaser import Chaser, Wheels
from rpo_core.chain.flight import OpenLoop, fly
from rpo_core.control import attitude
from rpo_core.control.attitude import (
    AttitudeControl,
    AttitudeControlStage,
    AttitudeLqr,
    AttitudePd,
    FuzzyAttitude,
    axis_of,
)
from rpo_core.control.attitude_law_kernels import attitude_torque
from rpo_core.control.attitude_limits import AttitudeLimits
from rpo_core.control.controller import dumps, load_fuzzy
from rpo_core.files.validation import InputError
from rpo_core.scenario import scenario as scenarios
from rpo_core.scenario.scenario import load_scenario

J = np.array([[0.6, 0.02, 0.0], [0.02, 0.7, 0.01], [0.0, 0.01, 0.5]])
BASE, DT = load_scenario('paper_test'), 0.1
WHEELS = Wheels(torque_nm=0.01, momentum_nms=0.2)
CHASER = Chaser(inertia_kg_m2=J.tolist(), wheels=WHEELS)
PD = AttitudePd(name='pd', bandwidth_rad_s=0.2, damping=0.9)
FUZZY = FuzzyAttitude(
    name='hand',
    system=load_fuzzy('handmade').system,
    angle_rad=1.0,
    rate_rad_s=0.1,
    torque_nm=0.002,
    moment_kg_m2=0.5,
)
NONE = (0.0, 0.0, 0.0)
NAMES = sorted(files.shipped('attitude_controller'))


def table(controller, chaser=CHASER, **fields):
    return AttitudeControl(controller=controller, **fields).law_of(BASE.equipped(chaser))


def attitude_of(rng, rate=0.05):
    return (*Rotation.random(random_state=rng).as_quat().tolist(), *rng.uniform(-rate, rate, 3))


@pytest.mark.parametrize('seed', range(5))
def test_a_torque_is_that_of_the_matrices(seed):
    rng = np.random.default_rng(seed)
    seen, wanted = attitude_of(rng), attitude_of(rng)
    before, wheels = rng.uniform(-0.05, 0.05, 3), rng.uniform(-0.1, 0.1, 3)
    free = replace(CHASER, wheels=None)
    law = table(PD, free)
    found = attitude_torque(seen, wanted, tuple(before), tuple(wheels), *law)
    q, r = Rotation.from_quat(seen[:4]), Rotation.from_quat(wanted[:4])
    error, rate = r.inv() * q, np.array(seen[4:])
    vector = error.as_quat(canonical=True)[:3]
    back = error.inv().as_matrix()
    off = rate - back @ wanted[4:]
    acceleration = back @ (np.array(wanted[4:]) - before) / DT - np.cross(off, back @ wanted[4:])
    expected = -J @ (0.2**2 * 2.0 * vector + 2.0 * 0.9 * 0.2 * off)
    expected += np.cross(rate, J @ rate + wheels) + J @ acceleration
    assert np.allclose(found, expected, rtol=1e-10, atol=1e-13)
    limited = attitude_torque(seen, wanted, tuple(before), tuple(wheels), *table(PD))
    assert np.allclose(limited, np.clip(expected, -0.01, 0.01), rtol=1e-10)
    plain = table(replace(PD, feed_forward=False), free)
    alone = attitude_torque(seen, wanted, tuple(before), tuple(wheels), *plain)
    assert np.allclose(alone, -J @ (0.08 * vector + 0.36 * off), rtol=1e-10, atol=1e-13)


@pytest.mark.parametrize('seed', range(3))
def test_the_force_is_turned_into_the_axes_of_the_middle_of_the_tick(seed):
    rng = np.random.default_rng(seed)
    seen, force = attitude_of(rng), rng.uniform(-1.0, 1.0, 3)
    stage = AttitudeControlStage(AttitudeControl(controller=PD), BASE.equipped(CHASER))
    found, _ = stage.step(0, tuple(force), seen)
    q = Rotation.from_quat(seen[:4])
    relative = np.array(seen[4:]) - q.inv().apply([0.0, 0.0, BASE.mean_motion_rad_s])
    middle = q * Rotation.from_rotvec(relative * DT / 2.0)
    assert np.allclose(found, middle.inv().apply(force), atol=1e-9)
    assert 0.0 < np.abs(stage.m.wheels_nms).max() <= WHEELS.torque_nm * DT


def test_the_regulator_solves_its_riccati_equation():
    q, r = 3e-4, 0.02
    one = AttitudeLqr(name='lqr', attitude_weight=q, rate_weight=r, feed_forward=False)
    law = table(one)[1]
    gains = np.array([law.attitude, law.rate]).reshape(2, 3, 3)
    a, b = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    k = b.T @ solve_continuous_are(a, b, np.diag([q, r]), np.eye(1))
    for axis in range(3):
        assert np.allclose(gains[:, axis, axis], J[axis, axis] * k[0], rtol=1e-9)
    assert np.count_nonzero(gains) == 6


small = st.floats(-0.3, 0.3)


@given(st.tuples(small, small, small), st.tuples(*[st.floats(-0.2, 0.2)] * 3))
def test_a_fuzzy_torque_is_odd_bit_for_bit(turn, rate):
    law = table(replace(FUZZY, feed_forward=False))
    x, y, z = turn
    w = (1.0 - x * x - y * y - z * z) ** 0.5
    rest = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    one = attitude_torque((x, y, z, w, *rate), rest, NONE, NONE, *law)
    p, q, r = rate
    other = attitude_torque((-x, -y, -z, w, -p, -q, -r), rest, NONE, NONE, *law)
    assert one == tuple(-torque for torque in other)


@pytest.mark.parametrize('controller', [PD, FUZZY])
def test_a_slower_loop_of_a_heavier_chaser_is_similar(controller):
    rng = np.random.default_rng(1)
    seen, wanted = attitude_of(rng), attitude_of(rng)
    free = replace(CHASER, wheels=None)
    heavy = replace(free, inertia_kg_m2=(64.0 * J).tolist())
    one = attitude_torque(seen, wanted, wanted[4:], NONE, *table(controller, free))
    slow = [(*a[:4], *(rate / 4.0 for rate in a[4:])) for a in (seen, wanted)]
    law = table(controller, heavy, time_scale=4.0)
    other = attitude_torque(*slow, slow[1][4:], NONE, *law)
    assert other == tuple(4.0 * torque for torque in one)  # 64 / 4^2


@pytest.mark.parametrize('controller', NAMES)
def test_a_chaser_turns_to_its_reference(controller):
    start = Chaser(
        inertia_kg_m2=J.tolist(),
        attitude=(0.5, -0.7, 0.4, 0.1),
        rates_deg_s=(1.0, -0.5, 0.8),
        wheels=WHEELS,
    )
    base = replace(BASE, duration_s=100.0, requirements=None)
    flown = base.equipped(start, AttitudeControl(controller=controller))
    flight = fly(flown, OpenLoop(np.tile([0.1, 0.0, 0.0], (1001, 1))))
    last = flight.signals['chaser_attitude'][-1]
    assert 2.0 * np.linalg.norm(last[:3]) < np.radians(0.5)
    assert np.allclose(last[4:], [0.0, 0.0, flown.mean_motion_rad_s], atol=np.radians(0.02))
    # What is exerted is what was commanded in LVLH, but for the second order of a tick's turn.
    assert np.allclose(flight.signals['exerted_force'][:-1], [0.1, 0.0, 0.0], atol=1e-5)


def test_a_slew_keeps_its_limit_of_rate():
    start = Chaser(
        inertia_kg_m2=J.tolist(),
        attitude=(0.5, -0.7, 0.4, 0.1),
        wheels=replace(WHEELS, torque_nm=0.05),
    )
    base = replace(BASE, duration_s=100.0, requirements=None)
    limits = AttitudeLimits(rate_deg_s=2.0, angle_deg=5.0)
    rates, flown = [], []
    for own in (None, limits):
        control = AttitudeControl(controller='attitude_pd', time_scale=0.5, limits=own)
        flown.append(base.equipped(start, control))
        flight = fly(flown[-1], OpenLoop(np.zeros((1001, 3))))
        rates.append(np.degrees(np.abs(flight.signals['chaser_attitude'][:, 4:])).max())
        assert np.linalg.norm(flight.signals['chaser_attitude'][-1, :3]) < 0.01
    assert rates[0] > 2.5 and 1.8 < rates[1] <= 2.0
    text = scenarios.dumps(flown[1])
    assert files.loads(text, scenarios.parse, 'text') == flown[1]


@pytest.mark.parametrize('name', NAMES)
def test_a_file_is_read_back_as_it_is_written(name):
    loaded = attitude.load(name)
    assert loaded.name == name
    again = files.loads(attitude.dumps(loaded), attitude.parse, 'text')
    assert again == loaded and again.provenance == loaded.provenance
    scenario = BASE.equipped(CHASER, AttitudeControl(controller=name))
    text = scenarios.dumps(scenario)
    assert files.loads(text, scenarios.parse, 'text') == scenario
    assert text.count(f'kind: {loaded.kind}') == 1


def test_attitude_controllers_are_told_from_other_names_and_files(tmp_path):
    path = tmp_path / 'own.yaml'
    path.write_text(attitude.dumps(PD))
    (tmp_path / 'other.yaml').write_text(dumps(load_fuzzy('handmade')))
    assert attitude.is_one(NAMES[0]) and attitude.is_one(str(path))
    for name in ('handmade', str(tmp_path / 'none.yaml'), str(tmp_path / 'other.yaml')):
        assert not attitude.is_one(name)


@pytest.mark.parametrize(('asked_nms', 'kept_nms'), [(None, 0.2), (0.19, 0.19), (3.0, 0.2)])
def test_wheels_keep_the_smaller_of_their_momentum_and_the_one_asked_for(asked_nms, kept_nms):
    limits = AttitudeLimits(rate_deg_s=0.5, momentum_nms=asked_nms, reference_deg_s2=0.01)
    scenario = BASE.equipped(CHASER, AttitudeControl(controller=PD))
    found = AttitudeControl(controller=PD, limits=limits).kept(scenario)
    assert found.momentum == kept_nms


def test_what_cannot_be_is_refused():
    """In code; of files, in `core/refused.yaml`."""
    with pytest.raises(InputError, match='`provenance` must be a mapping; got 3'):
        replace(PD, provenance=3)
    with pytest.raises(InputError, match='must be fuzzy here; attitude_pd is of kind attitude_pd'):
        axis_of('attitude_pd')
    with pytest.raises(InputError, match='needs section `attitude`'):
        BASE.equipped(AttitudeControl(controller=PD))
