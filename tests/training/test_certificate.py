# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The certificate: enclosures that hold, claims that hold, broken controllers that fail truly."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from core_oracles import mamdani
from core_strategies import functions, smooth_functions, systems
from hypothesis import given, settings
from hypothesis import strategies as st

from rpo.proof import surface
from rpo.proof.certificate import PROVEN, REFUTED, certify
from rpo.proof.surface import Boxes
from rpo.training.config import load_start
from rpo_core.control.fuzzy import MembershipFunctions, RuleTable


def one_box(system, data, widest=0.3):
    """Draw a box without a breakpoint in its inside, and three points in it."""
    edges = []
    for part in (system.position, system.velocity):
        points = surface.breakpoints(part)
        cell = data.draw(st.integers(0, len(points) - 2))
        low, high = points[cell], points[cell + 1]
        start = data.draw(st.floats(0, 1)) * (high - low) + low
        edges += [min(start, high), min(start + data.draw(st.floats(0, widest)), high)]
    e_low, e_high, v_low, v_high = edges
    shares = data.draw(st.lists(st.tuples(*[st.floats(0, 1)] * 2), min_size=3, max_size=3))
    inside = [
        (
            min(max(e_low + a * (e_high - e_low), e_low), e_high),
            min(max(v_low + b * (v_high - v_low), v_low), v_high),
        )
        for a, b in [(0, 0), (1, 1), *shares]
    ]
    return Boxes(*(np.array([edge]) for edge in edges)), inside


@settings(max_examples=40)
@given(systems(parts=functions, samples=st.sampled_from([3, 11, 101])), st.data())
def test_the_kernel_stays_within_the_enclosure(system, data):
    box, inside = one_box(system, data)
    found = surface.enclose(system, box)
    for point in inside:
        assert found.low[0] <= system.output(*point) <= found.high[0]


@settings(max_examples=40)
@given(systems(parts=smooth_functions), st.data())
def test_difference_quotients_stay_within_the_slopes(system, data):
    box, inside = one_box(system, data)
    found = surface.enclose(system, box)
    for (e, v), (e2, v2) in pairwise(inside):
        for low, high, start, end, along in (
            (found.e_slope_low, found.e_slope_high, (e, v), (e2, v), e2 - e),
            (found.v_slope_low, found.v_slope_high, (e, v), (e, v2), v2 - v),
        ):
            change = system.output(*end) - system.output(*start)
            ends = sorted([low[0] * along, high[0] * along]) if along else [0.0, 0.0]
            assert ends[0] - 1e-12 <= change <= ends[1] + 1e-12


@settings(max_examples=40)
@given(systems(parts=functions), st.lists(st.tuples(*[st.floats(-1, 1)] * 2), min_size=1))
def test_values_are_the_kernels(system, points):
    e, v = np.array(points).T
    expected = [system.output(*point) for point in points]
    margin = 2 * surface.rounding(system)
    np.testing.assert_allclose(surface.values(system, e, v), expected, rtol=0, atol=margin)


@settings(max_examples=20)
@given(systems(parts=functions, samples=st.sampled_from([3, 101, 1001])), st.data())
def test_the_kernel_is_within_the_stated_rounding(system, data):
    """Against sums without rounding of the same grades, which are themselves right to 3 u."""
    e, v = (data.draw(st.floats(-1, 1)) for _ in 'ev')
    assert abs(system.output(e, v) - mamdani(system, e, v)) <= 2 * surface.rounding(system)


def claims(system, **options):
    return {claim.name: claim for claim in certify(system, **options).claims}


@pytest.fixture(scope='module')
def trained():
    return load_start('trained').system


@pytest.fixture(scope='module')
def proven(trained):
    return claims(trained)


@pytest.mark.slow
def test_the_trained_controller_is_certified(proven):
    assert {claim.verdict for claim in proven.values()} == {PROVEN}


@pytest.mark.slow
def test_bounds_hold_on_random_lines(trained, proven):
    """Steps of every size, along either error, against the independent inference."""
    rng = np.random.default_rng(3)
    for name, axis in (('position error', 0), ('velocity error', 1)):
        slope = proven[f'slope in {name}'].bound
        fall = proven[f'monotone in {name}'].bound
        for _ in range(150):
            start = rng.uniform(-1, 1, 2)
            end = start.copy()
            end[axis] = min(start[axis] + 10 ** rng.uniform(-5, 0.3), 1.0)
            rise = mamdani(trained, *end) - mamdani(trained, *start)
            assert -fall <= rise and abs(rise) <= slope * (end[axis] - start[axis]) + 1e-12


@pytest.mark.slow
def test_witnesses_are_near_the_bounds_and_true(trained, proven):
    for name, axis in (('position error', 0), ('velocity error', 1)):
        for kind in ('slope in', 'monotone in'):
            claim = proven[f'{kind} {name}']
            first, second = claim.points
            assert first.output == trained.output(*first[:2])
            change = mamdani(trained, *second[:2]) - mamdani(trained, *first[:2])
            step = second[axis] - first[axis]
            figure = abs(change) / step if kind == 'slope in' else -change
            assert step > 0 and figure == pytest.approx(claim.found, rel=1e-5)
            assert claim.found <= claim.bound <= 1.5 * claim.found


def examined(system):
    return system, certify(system, most_boxes=4000)


def changed(system, **codes):
    """Return the system with other rules: `r20=3` is row 2, column 0, SP."""
    table = system.rules.codes.copy()
    for name, code in codes.items():
        table[int(name[1]), int(name[2])] = code
    return replace(system, rules=RuleTable.from_codes(table))


def refuted(found, name):
    """Return a claim, after its counterexample was checked by the independent inference."""
    system, certificate = found
    (claim,) = (claim for claim in certificate.claims if claim.name == name)
    assert not certificate.holds
    assert claim.verdict == REFUTED
    for point in claim.points:
        assert point.output == pytest.approx(mamdani(system, *point[:2]), abs=1e-12)
    return claim


@pytest.mark.slow
def test_a_rule_that_pushes_away_is_found(handmade):
    found = examined(changed(handmade.system, r23=1, r21=3))  # at rest: SP -> SN, SN -> SP
    assert found[0].rules.is_odd
    (point,) = refuted(found, 'pull').points
    assert point.velocity_error == 0.0 and point.position_error * point.output <= 0.0
    first, second = refuted(found, 'monotone in position error').points
    assert first.velocity_error == second.velocity_error
    assert first.position_error < second.position_error
    assert first.output - second.output > 0.1


@pytest.mark.slow
def test_a_table_that_is_not_odd_is_found(handmade):
    first, second = refuted(examined(changed(handmade.system, r44=3)), 'oddness').points
    assert (first.position_error, first.velocity_error) == (
        -second.position_error,
        -second.velocity_error,
    )
    assert first.output != -second.output


@pytest.mark.slow
def test_a_push_at_the_target_is_found(handmade):
    (point,) = refuted(examined(changed(handmade.system, r22=3)), 'equilibrium').points
    assert point[:2] == (0.0, 0.0) and point.output > 0.1


@pytest.mark.slow
@pytest.mark.parametrize(
    ('part', 'name'),
    [
        ({'position': MembershipFunctions(0.2, 0.3, 0.4, 0.6, 0.5)}, 'position error'),  # a hole
        ({'velocity': MembershipFunctions(0.45, 0.3, 0.3, 0.9, 0.4)}, 'velocity error'),  # an edge
    ],
)
def test_a_jump_is_found(handmade, part, name):
    first, second = refuted(examined(replace(handmade.system, **part)), f'slope in {name}').points
    apart = np.abs(np.subtract(first[:2], second[:2]))
    assert apart.sum() <= np.spacing(1.0) and abs(first.output - second.output) > 0.1
