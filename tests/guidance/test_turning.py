# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Legs in the axes of a target that turns: closed forms, SciPy's integrator, bits, commands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from landing import rest_at_landing
from numpy.testing import assert_allclose, assert_array_equal
from references import N_RAD_S, VEHICLE, assert_bits_of_the_stage, follow, stage_of
from scipy.integrate import solve_ivp

from rpo_core.attitude.target import Target, motion_of
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_core.guidance import guidance
from rpo_core.guidance.guidance import Guidance, Leg
from rpo_core.guidance.legs import FlyingAround, Resting, Straight, Turning
from rpo_core.judge.verdicts import verdicts
from rpo_core.scenario import scenario as scenarios
from rpo_core.world import cw

SHIPPED = scenarios.load_scenario('tumbling_port')
MOUTH = Leg(
    name='to_the_mouth', kind='transfer', frame='target', to_m=(0.0, 18.0, 0.0),
    arrive_m_s=(0.0, -0.1, 0.0), duration_s=400.0,
)  # fmt: skip
IN = Leg(
    name='in', kind='straight', frame='target', to_m=(0.0, 1.0, 0.0), speed_m_s=0.1,
    end_speed_m_s=0.075,
)  # fmt: skip
PORT = replace(
    SHIPPED,
    duration_s=576.0,
    sections=(SHIPPED.target, replace(SHIPPED.section(Guidance), legs=(MOUTH, IN))),
)
ROUND = ((120.0, 0.0, 0.0), (0.0, 150.0, 10.0), (0.0, 10.0, 200.0))

LEGS = {
    'rest': (Resting, (3.0, 15.0, -2.0), VEHICLE),
    'line': (Straight, (0.0, 18.0, 0.0, 0.0, -0.1, 0.0), (1.0, 1.0, 0.0), VEHICLE, 0.1, 0.05),
    'arc': (FlyingAround, (0.0, 18.0, 0.0, 0.0, 0.0, 0.0), (15.0, 0.0, 3.0), VEHICLE, 0.3),
}


def tumble(rates=(0.3, 0.4, 0.85)):
    return Target(kind='tumble', rates_deg_s=rates, inertia_kg_m2=ROUND)


def leg_of(name, target, since=0):
    return Turning(motion_of(target, PORT), since, VEHICLE, *LEGS[name])


def test_at_rest_beside_a_spinning_target_the_force_is_that_of_the_circle():
    """It turns at W - n about LVLH's z: m (-(W - n)^2 r - what CW adds)."""
    motion = motion_of(Target(kind='spin', rate_deg_s=2.0), PORT)
    rate, length = np.radians(2.0) - N_RAD_S, 15.0
    leg = Turning(motion, 100, VEHICLE, Resting, (0.0, length, 0.0), VEHICLE)
    for tick in (0, 1, 700):
        state, force = leg.at(tick)
        for angle, moment in ((rate * (100 + tick) * 0.1, 0), (rate * (100.5 + tick) * 0.1, 1)):
            r = length * np.array([-np.sin(angle), np.cos(angle), 0.0])
            v = rate * length * np.array([-np.cos(angle), -np.sin(angle), 0.0])
            if moment == 0:
                assert_allclose(state, [*r, *v], atol=1e-11)
        pull = np.array([3.0 * N_RAD_S**2 * r[0] + 2.0 * N_RAD_S * v[1], -2.0 * N_RAD_S * v[0], 0])
        assert_allclose(force, 10.0 * (-(rate**2) * r - pull), atol=1e-12)


@pytest.mark.parametrize('name', LEGS)
def test_forces_of_the_reference_alone_keep_a_chaser_on_it_for_minutes(name):
    """SciPy integrates Clohessy and Wiltshire under the held forces; nothing closes the loop."""
    leg = leg_of(name, tumble(), since=37)
    rows = np.empty((1501, 9))
    leg.fill(rows)
    n, m, worst, state = N_RAD_S, 10.0, 0.0, rows[0, :6]
    for k in range(0, 1500):
        fx, fy, fz = rows[k, 6:]

        def change(_t, s, fx=fx, fy=fy, fz=fz):
            ax = 3.0 * n * n * s[0] + 2.0 * n * s[4] + fx / m
            return [*s[3:], ax, -2.0 * n * s[3] + fy / m, -n * n * s[2] + fz / m]

        state = solve_ivp(change, (0.0, 0.1), state, 'DOP853', rtol=1e-10, atol=1e-12).y[:, -1]
        worst = max(worst, float(np.abs(state[:3] - rows[k + 1, :3]).max()))
    # the acceleration of a line or an arc changes at once, within a tick
    assert worst < (1e-4 if name == 'rest' else 0.05)


@hypothesis_settings(max_examples=15)
@given(
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    st.sampled_from(sorted(LEGS)),
    st.integers(0, 900),
)
def test_filled_rows_have_the_bits_of_each_tick(rates, name, since):
    leg = leg_of(name, tumble(rates), since)
    rows = np.empty((40, 9))
    leg.fill(rows)
    assert_array_equal(rows, [(*s, *f) for s, f in map(leg.at, range(40))])
    again = np.empty((40, 9))
    leg_of(name, tumble(rates), since).fill(again)
    assert again.tobytes() == rows.tobytes()


@pytest.mark.parametrize('name', LEGS)
def test_a_reference_is_the_derivative_of_itself(name):
    leg = leg_of(name, tumble())
    states = np.array([leg.at(tick)[0] for tick in range(600)])
    moved = (states[2:, :3] - states[:-2, :3]) / 0.2
    slow = np.abs(moved - states[1:-1, 3:])
    assert slow.max() < 5e-4  # a change of acceleration within a tick
    assert np.median(slow) < 2e-6


def test_a_target_that_is_fixed_has_the_legs_of_lvlh():
    own = PORT.section(Guidance)
    corridor_s = replace(MOUTH, to_m=(0.0, 1.0, 0.0), corridor_s=80.0)
    for legs in (own.legs, (corridor_s,)):
        plain = replace(PORT, sections=(replace(own, legs=legs),))
        fixed = plain.equipped(Target(kind='fixed'))
        ours = stage_of(fixed).rows(PORT.start, PORT.ticks)
        assert_array_equal(ours, stage_of(plain).rows(PORT.start, PORT.ticks))


def test_a_transfer_stays_in_a_corridor_that_turns():
    """The zones are looked at at each tick, in the axes of the target."""
    leg = replace(MOUTH, to_m=(0.0, 1.0, 0.0), arrive_m_s=(0.0, -0.07, 0.0), corridor_s=100.0)
    own = PORT.section(Guidance)
    entering = replace(own, legs=(leg,), corridor=replace(own.corridor, from_m=13.0))
    found = PORT.equipped(entering)
    guidance.check(entering, found)
    seen = found.seen(stage_of(found).rows(PORT.start, 4000)[:, :6])
    across, along = np.hypot(seen[3000:-1, 0], seen[3000:-1, 2]), seen[3000:-1, 1] - 1.0
    assert (across <= np.tan(np.radians(10.0)) * along + 0.01).all()
    assert_allclose(seen[4000], [0.0, 1.0, 0.0, 0.0, -0.07, 0.0], atol=1e-11)
    with pytest.raises(InputError, match='`guidance` must keep out of the sphere'):
        straight = replace(entering, legs=(replace(leg, corridor_s=None),))
        guidance.check(straight, PORT.equipped(straight))


@pytest.mark.parametrize('controller', rest_at_landing(['allround', 'pd']))
def test_docks_at_a_port_that_tumbles(controller):
    flight = fly(SHIPPED, load_controller(controller))
    judged = verdicts(flight)
    assert len(judged) == 5 and all(v.holds for v in judged), judged
    seen = flight.errors
    contact = int(np.argmax((seen[:, 1] <= 0.0) & (np.linalg.norm(seen[:, :3], axis=1) < 0.1)))
    assert contact == pytest.approx(4635, abs=5) and not flight.forces_n[contact:].any()
    assert np.abs(seen[contact, [3, 5]]).max() < 1e-3


def test_the_table_of_a_plan_has_the_bits_of_the_stage():
    last, rows = assert_bits_of_the_stage(PORT.section(Guidance), PORT)
    assert last == 4000
    seen = PORT.seen(rows[:, :6])
    assert_allclose(seen[4000], [0.0, 18.0, 0.0, 0.0, -0.1, 0.0], atol=1e-12)
    assert_allclose(seen[4000:5700, [0, 2, 3, 5]], 0.0, atol=1e-12)


def test_guidance_that_knows_a_wrong_attitude_flies_to_where_it_takes_the_port_for():
    wrong = PORT.equipped(replace(PORT.target, known_error_deg=(2.0, 0.0, 0.0)))
    rows = stage_of(wrong).rows(PORT.start, PORT.ticks)
    seen = wrong.seen(rows[:, :6])[4500]
    y, z = seen[1], seen[2]
    assert np.degrees(np.arctan2(z, y)) == pytest.approx(2.0, abs=1e-9)


def test_hold_stops_in_the_axes_of_the_target_and_go_goes_on():
    stage, references = follow(PORT, 5900, {4600: 'hold', 4900: 'go'})
    assert [c.phase for c in stage.changes[:4]] == ['to_the_mouth', 'in', 'stopped', 'in']
    seen = PORT.seen(references)
    assert_allclose(seen[4800:4900], seen[4800:4801].repeat(100, 0), atol=1e-11)
    assert_allclose(seen[4800, 3:], 0.0, atol=1e-12)
    assert seen[5800, 1] < seen[5000, 1] < seen[4800, 1]


def test_a_hold_of_the_plan_is_in_the_axes_of_the_leg_before():
    own = PORT.section(Guidance)
    held = Leg(name='hold', kind='hold', dwell_s=20.0)
    legs = (own.legs[0], replace(own.legs[1], to_m=(0.0, 15.0, 0.0), end_speed_m_s=0.0), held)
    own = replace(own, legs=legs, retreat_m=(0.0, 40.0, 0.0))
    assert own.zones(PORT).points_m == {'hold': (0.0, 15.0, 0.0)}  # the retreat does not turn
    stage, references = follow(PORT.equipped(own), 5000)
    begin = next(c.tick for c in stage.changes if c.phase == 'hold')
    assert_allclose(
        PORT.seen(references)[begin:, :3], [[0.0, 15.0, 0.0]] * (5000 - begin), atol=1e-12
    )


@pytest.mark.parametrize('moment', [4100, 5000, 5500, 5690])
def test_an_abort_out_of_the_corridor_comes_no_nearer_and_then_drifts_away(moment):
    stage, references = follow(PORT, moment + 4500, {moment: 'abort'})
    assert [c.phase for c in stage.changes[-2:]] == ['aborting', 'drifting']
    distance = np.linalg.norm(references[moment:, :3], axis=1)
    # 0.1 m/s is stopped in 0.33 m by half of the force that guidance may use
    assert distance.min() > min(distance[0], 13.0) - 0.36
    step, state = cw.discretise(N_RAD_S, PORT.mass_kg, 10.0), tuple(references[-1])
    for _ in range(round(0.2 * np.pi / N_RAD_S)):
        state = cw.cw_step(state, (0.0, 0.0, 0.0), step)
        assert np.linalg.norm(state[:3]) > 30.0


def test_go_after_a_retreat_meets_the_target_again():
    away = PORT.equipped(replace(PORT.section(Guidance), retreat_m=(0.0, -40.0, 0.0)))
    long = replace(away, duration_s=1600.0)
    stage, references = follow(long, 14800, {5000: 'retreat', 9000: 'go'})
    phases = ['to_the_mouth', 'in', 'retreating', 'to_the_mouth', 'in', 'arrived', 'docked']
    assert [c.phase for c in stage.changes] == phases
    jumps = np.abs(np.diff(references[:, 3:], axis=0)).max()
    assert jumps < 0.1 * 0.3 / 10.0  # nowhere faster than by the force that guidance may use


def test_off_it_follows_the_chaser_itself_and_commands_nothing():
    state = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    assert stage_of(PORT).off(state) == (state, (0.0, 0.0, 0.0))
