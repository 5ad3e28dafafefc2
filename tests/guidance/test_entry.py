# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""When a plan meets a target that turns, and how fast a turn the thrusters can follow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from invoking import invoke

from rpo_core.assurance.settings import Assurance
from rpo_core.attitude.target import Target, motion_of
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_core.guidance import entry
from rpo_core.guidance.guidance import Guidance, nominal
from rpo_core.guidance.legs import Resting, Straight, Turning, Vehicle
from rpo_core.judge.verdicts import verdicts
from rpo_core.scenario import scenario as scenarios

SHIPPED = scenarios.load_scenario('tumbling_port')
# Assurance refuses a corridor long before thrusters cannot follow it.
PORT = replace(SHIPPED, sections=tuple(s for s in SHIPPED.sections if type(s) is not Assurance))
PLAN = PORT.section(Guidance)
LONG = ((60.0, 0.0, 0.0), (0.0, 150.0, 10.0), (0.0, 10.0, 180.0))


def energy(settings):
    """Return the energy of a plan to the end of its last leg, tick by tick."""
    found = nominal(settings, PORT)
    ends = next(c.tick for c in found.changes if c.phase == 'arrived')
    return float((np.array(found.forces[:ends]) ** 2).sum()) * PORT.dt_s


@pytest.fixture(scope='module')
def found():
    return entry.entries(PLAN, PORT)


def test_the_entry_that_is_chosen_needs_less_than_a_grid_of_others(found):
    best = energy(found[0].settings)
    assert found[0].energy_n2s == pytest.approx(best, rel=1e-12)
    assert [e.energy_n2s for e in found] == sorted(e.energy_n2s for e in found)
    tried = []
    for duration_s in (220.0, 265.0, 284.0, 293.3):
        for speed in (0.075, 0.12):
            way, line = PLAN.legs
            way = replace(way, duration_s=duration_s, arrive_m_s=(0.0, -speed, 0.0))
            legs = (way, replace(line, speed_m_s=speed))
            tried.append(energy(replace(PLAN, legs=legs)))
    assert best <= 1.001 * min(tried) and max(tried) > 2.0 * best


def test_the_shipped_plan_is_the_one_that_is_chosen(found):
    assert found[0].settings == PLAN


def test_tried_are_entries_by_the_last_transfer_that_can_be_legs():
    """None whose line gains speed, or whose corridor begins before it."""
    way, line = PLAN.legs
    before, slower = replace(way, name='before'), replace(line, end_speed_m_s=0.06)
    legs = before, replace(way, corridor_s=40.0), slower
    tried = [(i, *one.legs) for i, one in entry._others(replace(PLAN, legs=legs), PORT)]
    assert {(i, first) for i, first, *_ in tried} == {(1, before)}
    assert [(x.duration_s, x.corridor_s, x.arrive_m_s[1], y.speed_m_s) for *_, x, y in tried] == [
        (float(s), 40.0 * share, -round(0.075 * share, 6), round(0.075 * share, 6))
        for share in (1.0, 1.5, 2.0)
        for s in range(5, 470, 5)
        if s > 40.0 * share
    ]


def test_a_plan_that_cannot_be_flown_has_no_entry():
    weak = replace(PLAN, force_share=0.01)
    with pytest.raises(InputError, match='no moment was found at which the plan of tumbling_port'):
        entry.entries(weak, replace(PORT, duration_s=40.0))


VEHICLE = Vehicle(
    PORT.mean_motion_rad_s, PORT.mass_kg, PORT.dt_s, PLAN.force_share * PORT.max_force_n, PORT.step
)


def line_of(target):
    """Return the largest force of an axis on the shipped line in."""
    line, start = PLAN.legs[1], (*PLAN.legs[0].to_m, *PLAN.legs[0].arrive_m_s)
    args = (start, line.to_m, VEHICLE, line.speed_m_s, line.end_speed_m_s)
    return largest(Turning(motion_of(target, PORT), 0, VEHICLE, Straight, *args))


def largest(leg):
    rows = np.empty((leg.ticks or 1800, 9))
    leg.fill(rows)
    return np.abs(rows[:, 6:]).max()


ROOT = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1)
AXIS = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda a: np.linalg.norm(a) > 0.1)


@hypothesis_settings(max_examples=30)
@given(ROOT, AXIS, st.booleans())
def test_just_below_the_largest_rate_no_line_needs_more_than_there_is(attitude, axis, tumbles):
    unit = np.array(axis) / np.linalg.norm(axis)
    if tumbles:
        one = Target(kind='tumble', rates_deg_s=tuple(unit), inertia_kg_m2=LONG)
    else:
        one = Target(kind='spin', axis=axis, rate_deg_s=1.0)
    rate, _, _ = entry.most_turn(PLAN, PORT.equipped(one))
    share = 0.999 * rate / one.fastest_rad_s
    fast = (
        replace(one, attitude=attitude, rates_deg_s=tuple(share * unit))
        if tumbles
        else replace(one, attitude=attitude, rate_deg_s=share)
    )
    assert line_of(fast) <= VEHICLE.limit_n


def test_a_spin_across_a_hold_needs_all_of_it():
    slow = Target(kind='spin', axis=(0.0, 0.0, 1.0), rate_deg_s=1.0)
    way, line = PLAN.legs
    held = replace(PLAN, legs=(way, replace(line, speed_m_s=1e-6, end_speed_m_s=0.0)))
    rate, _, _ = entry.most_turn(held, PORT.equipped(slow, held))
    for share, least, most in ((0.999, 0.99, 1.0), (1.01, 1.01, 1.03)):
        target = replace(slow, rate_deg_s=float(np.degrees(share * rate)))
        leg = Turning(motion_of(target, PORT), 0, VEHICLE, Resting, way.to_m, VEHICLE)
        assert least < largest(leg) / VEHICLE.limit_n < most


def test_just_below_the_largest_rate_a_chaser_docks():
    slow = Target(kind='spin', axis=(0.0, 0.0, 1.0), rate_deg_s=1.0)
    rate, far_m, fast = entry.most_turn(PLAN, PORT.equipped(slow))
    assert (far_m, fast) == (14.0, 0.075)
    # W^2 L + 2 W v + 2 n^2 L = 0.03 m/s^2
    n = PORT.mean_motion_rad_s
    assert rate**2 * 14.0 + 2.0 * rate * 0.075 + 28.0 * n * n == pytest.approx(0.03, rel=1e-12)
    way, line = PLAN.legs
    quick = replace(PLAN, legs=(replace(way, duration_s=350.0), line))
    spin = replace(slow, rate_deg_s=float(0.99 * np.degrees(rate)))
    flown = replace(PORT, duration_s=525.0, sections=()).equipped(spin, quick)
    assert all(v.holds for v in verdicts(fly(flown, load_controller('allround'))))


def test_the_command_writes_a_scenario_that_docks(tmp_path, monkeypatch):
    monkeypatch.setattr(entry, 'STEP_S', 145)
    path = tmp_path / 'sooner.yaml'
    printed = invoke('plan', 'tumbling_port', '--entry', path)
    assert printed.exit_code == 0, printed.output
    said = ' '.join(printed.output.split())
    assert '290 - 0.075 463.4 0.4843' in said and 'chosen' in said
    assert 'at most 2.095 deg/s' in said
    flight = fly(scenarios.load_scenario(path), load_controller('allround'))
    assert all(v.holds for v in verdicts(flight))
