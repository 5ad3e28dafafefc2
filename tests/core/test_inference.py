# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Mamdani inference against its definition, and the properties it has and has not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from core_oracles import grade, mamdani, triangles
from core_strategies import (
    free_rules,
    functions,
    odd_rules,
    symmetric_rules,
    systems,
    unit,
)
from hypothesis import given
from hypothesis import strategies as st

from rpo_core.control.fuzzy import WORDS, FuzzySystem, MembershipFunctions, RuleTable
from rpo_core.files.validation import InputError

TEXTBOOK = MembershipFunctions(0.5, 0.0, 0.5, 1.0, 0.5)
"""Five triangles half as wide as the range: grades add to 1 everywhere."""


@given(functions, unit)
def test_grades_are_the_triangles_of_the_definition(part, x):
    expected = [grade(x, triangle) for triangle in triangles(part).values()]
    np.testing.assert_array_equal(part.grades(x), expected)


@given(systems(samples=st.integers(1, 300).map(lambda half: 2 * half + 1)), unit, unit)
def test_output_is_the_definition_for_any_number_of_samples(system, e, v):
    assert system.output(e, v) == pytest.approx(mamdani(system, e, v), abs=1e-14)


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
