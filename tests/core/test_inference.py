# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Mamdani inference against its definition, and the properties it has and has not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_oracles import aggregate, grade, mamdani, steepest, triangles
from core_strategies import (
    free_rules,
    functions,
    odd_rules,
    smooth_functions,
    symmetric_rules,
    systems,
    unit,
)
from hypothesis import assume, given
from hypothesis import strategies as st

from rpo_core.control.fuzzy import WORDS, FuzzySystem, MembershipFunctions, RuleTable
from rpo_core.files.validation import InputError
from rpo_kernels import kernels

TEXTBOOK = MembershipFunctions(0.5, 0.0, 0.5, 1.0, 0.5)
"""Five triangles half as wide as the range: grades add to 1 everywhere."""


def strengths(system, e, v):
    """Return the strength of each output word."""
    t = system.tables
    grades = kernels.memberships(e, t.position), kernels.memberships(v, t.velocity)
    return kernels.fire_rules(*grades, t.rules)


@given(functions, unit)
def test_grades_are_the_triangles_of_the_definition(part, x):
    expected = [grade(x, triangle) for triangle in triangles(part).values()]
    np.testing.assert_array_equal(part.grades(x), expected)


def test_grades_keep_the_shape_of_their_argument():
    assert TEXTBOOK.grades(0.25).shape == (5,)
    assert TEXTBOOK.grades(np.zeros((3, 2))).shape == (3, 2, 5)
    np.testing.assert_array_equal(TEXTBOOK.grades([0.25])[0], (0, 0, 0.5, 0.5, 0))


@given(systems(samples=st.integers(1, 300).map(lambda half: 2 * half + 1)), unit, unit)
def test_output_is_the_definition_for_any_number_of_samples(system, e, v):
    assert system.output(e, v) == pytest.approx(mamdani(system, e, v), abs=1e-14)


def test_one_rule_by_hand():
    """e = 0.75, v = 1: SP and LP fire at 0.5; both say LP, clipped at 0.5.

    Samples 0.52 .. 0.74 have 0.04 .. 0.48, samples 0.76 .. 1.00 have 0.5. The area is
    0.04 (1 + .. + 12) + 13 / 2 = 9.62, the moment 0.04 (0.5 * 78 + 0.02 * 650) + 11.44 / 2 = 7.8.
    """
    rules = RuleTable((('Z',) * 5,) * 4 + (('Z', 'Z', 'Z', 'LP', 'LP'),))
    system = FuzzySystem(TEXTBOOK, TEXTBOOK, TEXTBOOK, rules)
    assert system.output(0.75, 1.0) == pytest.approx(7.8 / 9.62, abs=1e-14)


@given(systems(), unit, unit)
def test_output_is_bounded_by_the_words_that_fire(system, e, v):
    force = system.output(e, v)
    assert -1.0 <= force <= 1.0
    fired = [
        triangles(system.force)[word]
        for word, strength in zip(WORDS, strengths(system, e, v), strict=True)
        if strength > 0.0
    ]
    assume(fired)
    assume(force != 0.0)  # also where no sample lies under the words that fire
    left, right = min(feet[0] for feet in fired), max(feet[2] for feet in fired)
    assert max(left, -1.0) - 1e-15 <= force <= min(right, 1.0) + 1e-15


def test_full_output_is_out_of_reach_but_for_the_crudest_sampling():
    """The clipped LP triangle has its centroid inside: the field's |f| < f_max."""
    rules = RuleTable((('LP',) * 5,) * 5)
    fine = FuzzySystem(TEXTBOOK, TEXTBOOK, TEXTBOOK, rules)
    assert fine.output(1, 1) == pytest.approx((0.5 + 2) / 3, abs=0.01)
    crude = FuzzySystem(TEXTBOOK, TEXTBOOK, TEXTBOOK, rules, samples=3)
    assert crude.output(1, 1) == 1.0


@given(systems(odd_rules), unit, unit)
def test_odd_rules_give_an_odd_output_bit_for_bit(system, e, v):
    assert system.rules.is_odd
    assert system.output(-e, -v) == -system.output(e, v)


@given(functions, functions, symmetric_rules, unit, unit)
def test_transpose_symmetric_rules_let_equal_inputs_be_exchanged(part, force, rules, e, v):
    assert rules.is_transpose_symmetric
    system = FuzzySystem(part, part, force, rules)
    assert system.output(e, v) == system.output(v, e)


@given(systems(), st.floats(1.0, 1e300), unit)
def test_inputs_saturate(system, far, other):
    for sign in (1, -1):
        assert system.output(sign * far, other) == system.output(sign, other)
        assert system.output(other, sign * far) == system.output(other, sign)


gapped = st.builds(
    lambda z, left, right: MembershipFunctions(z, left, (left + right) / 2, right, right + 0.05),
    st.floats(0.01, 0.2),
    st.floats(0.25, 0.4),
    st.floats(0.5, 0.9),
)
"""Nothing covers [z, left]; Z ends before SP begins."""


@given(systems(parts=gapped), st.sampled_from([-1, 1]), unit)
def test_no_rule_fires_gives_zero(system, sign, other):
    gap = (system.position.z_half_width + system.position.sp_left) / 2
    assert system.output(sign * gap, other) == 0.0


def test_words_between_two_samples_give_zero():
    sliver = MembershipFunctions(0.1, 0.501, 0.505, 0.509, 0.9)
    rules = RuleTable((('SP',) * 5,) * 5)
    coarse = FuzzySystem(TEXTBOOK, TEXTBOOK, sliver, rules)
    assert strengths(coarse, 1.0, 1.0) == (0, 0, 0, 1, 0)
    assert coarse.output(1, 1) == 0.0
    fine = FuzzySystem(TEXTBOOK, TEXTBOOK, sliver, rules, samples=10_001)
    assert fine.output(1, 1) == pytest.approx(0.505, abs=1e-4)


@given(systems(parts=smooth_functions), unit, unit, st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
def test_output_is_continuous_where_rules_fire(system, e, v, de, dv):
    """|df| <= sum_i |y_i - f| |d mu_i| / A: with no slope above L, mu_i changes by at most L |d|.

    Exact for any two points, with the larger area A of the two; so along any line on which the area
    does not vanish the output is Lipschitz.
    """
    other = (max(-1, min(1, e + de)), max(-1, min(1, v + dv)))
    samples, near = aggregate(system, e, v)
    _, far = aggregate(system, *other)
    area = max(math.fsum(near), math.fsum(far))
    assume(min(math.fsum(near), math.fsum(far)) > 0.0)
    slope = max(steepest(system.position), steepest(system.velocity))
    change = slope * max(abs(other[0] - e), abs(other[1] - v))
    bound = math.fsum(abs(y) + 1.0 for y in samples) * change / area
    assert abs(system.output(*other) - system.output(e, v)) <= bound + 1e-14


def test_output_leaps_where_the_last_rule_stops_firing():
    """What a gap between words costs; the reason to keep them overlapping."""
    part = MembershipFunctions(0.2, 0.3, 0.4, 0.5, 0.4)
    rules = RuleTable((('LN', 'LN', 'LP', 'LP', 'LP'),) * 5)
    system = FuzzySystem(part, TEXTBOOK, TEXTBOOK, rules)
    assert system.output(0.2 - 1e-9, 0) > 0.7 and system.output(0.2, 0) == 0.0


def test_monotone_rules_do_not_make_the_force_quite_monotone(handmade):
    """Between two peaks the centroid of clipped triangles may dip; nobody may claim otherwise."""
    assert handmade.system.rules.is_monotone
    points = np.linspace(-1, 1, 81)
    surface = np.array([[handmade.system.output(e, v) for e in points] for v in points])
    assert np.diff(surface, axis=1).min() < 0.0
    assert np.diff(surface, axis=1).min() > -0.02


@given(functions, functions, functions, symmetric_rules)
def test_vector_round_trip(position, velocity, force, rules):
    system = FuzzySystem(position, velocity, force, rules)
    vector = system.to_vector()
    assert vector.shape == (30,)
    again = FuzzySystem.from_vector(vector)
    assert again == system
    np.testing.assert_array_equal(again.to_vector(), vector)


def test_vector_has_the_order_of_the_paper():
    p = [0.01 * i for i in range(1, 16)]
    p[1:4], p[6:9], p[11:14] = (0.1, 0.2, 0.3), (0.4, 0.5, 0.6), (0.7, 0.8, 0.9)
    rules = [1, 2, 3, 4, 5, 1, 2, 3, 4, 1, 2, 3, 1, 2, 1]  # p16-p30, column by column
    system = FuzzySystem.from_vector([*p, *rules])
    assert system.position == MembershipFunctions(0.01, 0.1, 0.2, 0.3, 0.05)
    assert system.velocity == MembershipFunctions(0.06, 0.4, 0.5, 0.6, 0.10)
    assert system.force == MembershipFunctions(0.11, 0.7, 0.8, 0.9, 0.15)
    assert system.rules.words == (
        ('LN', 'SN', 'Z', 'SP', 'LP'),
        ('SN', 'LN', 'SN', 'Z', 'SP'),
        ('Z', 'SN', 'LN', 'SN', 'Z'),
        ('SP', 'Z', 'SN', 'LN', 'SN'),
        ('LP', 'SP', 'Z', 'SN', 'LN'),
    )


@given(free_rules)
def test_table_flags_are_what_they_say(rules):
    cells = [(i, j) for i in range(5) for j in range(5)]
    code = {(i, j): WORDS.index(rules.words[i][j]) for i, j in cells}
    assert rules.is_transpose_symmetric == all(code[i, j] == code[j, i] for i, j in cells)
    assert rules.is_odd == all(code[i, j] + code[4 - i, 4 - j] == 4 for i, j in cells)
    rising = [code[i, j] <= code[i, j + 1] for i, j in cells if j < 4]
    rising += [code[i, j] <= code[i + 1, j] for i, j in cells if i < 4]
    assert rules.is_monotone == all(rising)


def test_a_table_must_rise_along_both_errors():
    rising = np.tile(np.arange(5), (5, 1))
    assert RuleTable.from_codes(rising).is_monotone
    assert RuleTable.from_codes(rising.T).is_monotone
    assert not RuleTable.from_codes(rising[:, ::-1]).is_monotone
    assert not RuleTable.from_codes(rising.T[::-1]).is_monotone


@given(*[st.floats(-300, 300)] * 3, *[st.floats(-3, 3)] * 3)
def test_controller_scales_and_saturates_each_axis(handmade, x, y, z, vx, vy, vz):
    position_scale, velocity_scale, force_scale = handmade.scales
    forces = handmade.force_n((x, y, z), (vx, vy, vz))
    for force, r, v in zip(forces, (x, y, z), (vx, vy, vz), strict=True):
        e, de = np.clip([-r / position_scale, -v / velocity_scale], -1, 1)
        assert force == pytest.approx(force_scale * mamdani(handmade.system, e, de), abs=1e-14)


GOOD = [0.5, 0.0, 0.5, 1.0, 0.5] * 3 + [3.0] * 15


@pytest.mark.parametrize(
    ('index', 'value', 'words'),
    [
        (0, 0.0, ['p1-p5 (position)', '`z_half_width`', '> 0', 'got 0.0']),
        (0, math.nan, ['p1-p5 (position)', '`z_half_width`', 'finite', 'got nan']),
        (6, 1.1, ['p6-p10 (velocity)', '`sp_left`', '<= 1', 'got 1.1']),
        (8, 0.4, ['p6-p10 (velocity)', 'ascend', 'got 0.0, 0.5, 0.4']),
        (14, 1.0, ['p11-p15 (force)', '`lp_left`', '< 1', 'got 1.0']),
        (15, 0.0, ['`p16`', '1, 2, 3, 4 or 5', 'got 0.0']),
        (29, 2.5, ['`p30`', '1, 2, 3, 4 or 5', 'got 2.5']),
        (20, math.nan, ['`p21`', 'got nan']),
    ],
)
def test_bad_vectors_are_named(index, value, words):
    p = list(GOOD)
    p[index] = value
    with pytest.raises(InputError) as error:
        FuzzySystem.from_vector(p)
    assert all(word in str(error.value) for word in words), error.value


def test_bad_shapes_are_named():
    for length in (0, 29, 31):
        with pytest.raises(InputError, match=f'`p` must have 30 elements; got {length}'):
            FuzzySystem.from_vector([0.5] * length)
    with pytest.raises(InputError, match='5 rows of 5 words'):
        RuleTable((('Z',) * 5,) * 4)
    with pytest.raises(InputError, match=r'`rules.SP\[LN\]` must be one of LN, SN, Z, SP, LP'):
        RuleTable((('Z',) * 5,) * 3 + (('PL',) + ('Z',) * 4,) + (('Z',) * 5,))
    for codes in (
        np.full((5, 4), 2),
        np.full((5, 5), -1),
        np.full((5, 5), 5),
        np.full((5, 5), 1.5),
    ):
        with pytest.raises(InputError, match='`codes` must be'):
            RuleTable.from_codes(codes)
    for samples in (1, 100, 101.0, 200_001, True):
        with pytest.raises(InputError, match='`samples`'):
            FuzzySystem(TEXTBOOK, TEXTBOOK, TEXTBOOK, RuleTable((('Z',) * 5,) * 5), samples)
    free = RuleTable((('LN', 'LP', 'Z', 'Z', 'Z'),) + (('Z',) * 5,) * 4)
    with pytest.raises(InputError, match='transpose-symmetric'):
        FuzzySystem(TEXTBOOK, TEXTBOOK, TEXTBOOK, free).to_vector()
