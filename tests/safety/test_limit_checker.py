# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Limits and persistence counters, against a plain count; the shipped table on shipped flights."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from landing import rest_at_landing
from scipy.spatial.transform import Rotation

from rpo_core import files
from rpo_core.chain.flight import fly
from rpo_core.control.controller import load_controller
from rpo_core.files.scenario import load_scenario
from rpo_safety import limit_checker
from rpo_safety.limit_checker import ABORT, LimitChecker, Rule, load_monitor

SHIPPED = load_monitor('default')


def of(count, window):
    return LimitChecker({'too_fast': Rule(count, window, ABORT)})


@given(st.lists(st.booleans(), max_size=60), st.integers(1, 8), st.integers(0, 8))
def test_a_fault_begins_at_n_of_the_last_m_and_again_after_a_whole_window_without(
    samples, count, more
):
    window = count + more
    watched, holds = of(count, window), False
    for end in range(1, len(samples) + 1):
        seen = sum(samples[max(0, end - window) : end])
        begins = not holds and seen >= count
        holds = (holds and seen > 0) or begins
        found = watched.sample({'too_fast': samples[end - 1]})
        assert [d.fault for d in found] == ['too_fast'] * begins
        assert ('too_fast' in watched.holding) == holds


def test_cleared_it_begins_anew():
    watched = of(2, 3)
    assert [bool(watched.sample({'too_fast': True})) for _ in range(3)] == [False, True, False]
    watched.clear(['too_fast'])
    assert [bool(watched.sample({'too_fast': True})) for _ in range(3)] == [False, True, False]
    assert watched.detected == {'too_fast': 2}


@pytest.mark.parametrize(
    ('state', 'faults'),
    [
        ((0, 0, 0, 0, 0, 0), set()),
        ((399, 0, 0, 0, 0, 0), set()),
        ((400, 0, 0, 0, 0, 0), set()),  # at a limit is within it
        ((401, 0, 0, 0, 0, 0), {'out_of_range'}),
        ((0, 0, 0, 0, 0.0999, 0), set()),
        ((0, 0, 0, 0, 0, -0.1001), {'too_fast'}),
        ((0, 10, 0, 0, 3.1001, 0), {'too_fast'}),
        ((0, 10, 0, 0, 3.0999, 0), set()),
        ((math.nan, 0, 0, 0, 0, 0), {'not_finite'}),
        ((0, 0, 0, 0, math.inf, 0), {'not_finite'}),
    ],
)
def test_limits_of_a_state(state, faults):
    found = SHIPPED.limits.faults_of_state(state)
    assert {fault for fault, shown in found.items() if shown} == faults


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 6))
def test_a_corridor_turns_with_the_target(drawn):
    """By the angle between axis and position in the target's axes, as SciPy turns them."""
    turn, place = Rotation.from_rotvec(3.0 * np.array(drawn[:3])), np.array(drawn[3:]) + 1.5
    x, y, z = seen = turn.inv().apply(place)
    angle = np.degrees(np.arctan2(np.hypot(x, z), y))
    for off in (-1e-6, 1e-6):
        limits = replace(SHIPPED.limits, corridor_half_angle_deg=float(angle + off))
        found = limits.faults_of_state([*place.tolist(), 0.0, 0.0, 0.0], turn.as_quat().tolist())
        assert found['off_corridor'] == (off < 0.0), seen


@pytest.mark.parametrize(('degrees', 'off'), [(29.9, False), (30.1, True), (180.0, True)])
def test_the_corridor_is_a_cone_about_its_axis(degrees, off, tmp_path):
    document = yaml.safe_load(files.find('monitor', 'default').read_text())
    document['limits'].update(corridor_half_angle_deg=30.0, corridor_axis=[0, -2.0, 0])
    limits = limit_checker.parse(document).limits
    angle = math.radians(degrees)
    state = (50 * math.sin(angle) * 0.6, -50 * math.cos(angle), 50 * math.sin(angle) * 0.8, 0, 0, 0)
    assert limits.faults_of_state(state)['off_corridor'] is off


def test_limits_of_a_force():
    assert SHIPPED.limits.faults_of_force((0.0, -0.5, 0.1)) == {'force_saturated': True}
    assert SHIPPED.limits.faults_of_force((0.0, -0.49, 0.1)) == {'force_saturated': False}
    assert SHIPPED.limits.faults_of_force((0.0, math.nan, 0.1)) == {'not_finite': True}


@pytest.mark.parametrize('scenario', rest_at_landing(['paper_test', 'approach']))
@pytest.mark.parametrize('controller', rest_at_landing(['trained', 'handmade', 'paper_ga'], 2))
def test_shipped_flights_are_no_fault(scenario, controller):
    flown = fly(load_scenario(scenario), load_controller(controller))
    watched = LimitChecker(SHIPPED.rules)
    for state, force in zip(flown.states.tolist(), flown.forces_n.tolist(), strict=True):
        watched.sample(SHIPPED.limits.faults_of_state(state))
        watched.sample(SHIPPED.limits.faults_of_force(force))
    assert not any(watched.detected.values())
