# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Explaining: what is said of a decision is what was decided; warnings where they are due."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from core_oracles import aggregate, grade, mamdani, triangles
from core_strategies import systems
from hypothesis import given
from hypothesis import strategies as st

from rpo_core.control import explain
from rpo_core.control.blend import Cause, Reasons
from rpo_core.control.controller import FuzzyController, load_controller
from rpo_core.control.fuzzy import WORDS, MembershipFunctions
from rpo_core.files.validation import InputError

component = st.floats(-300, 300)


@given(systems(), st.lists(component, min_size=6, max_size=6))
def test_decisions_are_what_is_commanded(system, state):
    controller = FuzzyController('any', system, 70.0, 0.9, 0.5)
    found = explain.decisions(controller, state)
    assert tuple(d.force_n for d in found) == controller.force_n(state[:3], state[3:])
    for decision in found:
        e, v = decision.position_error, decision.velocity_error
        positions, velocities = triangles(system.position), triangles(system.velocity)
        expected = {}
        for i, row in enumerate(WORDS):
            for j, column in enumerate(WORDS):
                strength = min(grade(e, positions[column]), grade(v, velocities[row]))
                if strength > 0:
                    expected[column, row, system.rules.words[i][j]] = strength
        said = {(r.position, r.velocity, r.force): r.strength for r in decision.rules}
        assert said == pytest.approx(expected, abs=1e-12)
        assert decision.output == pytest.approx(mamdani(system, e, v), abs=1e-12)
        for word, strength in zip(WORDS, decision.strengths, strict=True):
            deciding = [r.strength for r in decision.rules if r.force == word and r.decides]
            assert set(deciding) == ({strength} if strength else set())


@given(systems(), component, component)
def test_shares_of_words_make_the_force(system, position, velocity):
    """Shares add up to 1, and share times centroid to the output; each is its part of the area.

    The area of a word: by the definition of the output set, sample by sample, between that of the
    samples where it is clearly the greatest, and where it is the greatest to within rounding.
    """
    decision = explain.decide(FuzzyController('any', system, 70.0, 0.9, 0.5), position, velocity)
    errors = decision.position_error, decision.velocity_error
    shares = [part.share for part in decision.parts.values()]
    samples, heights = aggregate(system, *errors)
    assert sum(shares) == pytest.approx(1.0 if sum(heights) else 0.0, abs=1e-12)
    made = sum(part.share * part.centroid for part in decision.parts.values())
    assert made == pytest.approx(mamdani(system, *errors), abs=1e-12)
    assert made == pytest.approx(decision.output, abs=1e-12)
    for word, strength in zip(WORDS, decision.strengths, strict=True):
        clearly, about = 0.0, 0.0
        for y, height in zip(samples, heights, strict=True):
            own = min(strength, grade(y, triangles(system.force)[word]))
            others = [
                min(other, grade(y, triangles(system.force)[name]))
                for name, other in zip(WORDS, decision.strengths, strict=True)
                if name != word
            ]
            clearly += height if own > max(others) + 1e-12 else 0.0
            about += height if own > 0.0 and own > max(others) - 1e-12 else 0.0
        area = decision.parts[word].share * sum(heights) if word in decision.parts else 0.0
        assert clearly - 1e-9 <= area <= about + 1e-9
        if word in decision.parts:
            assert decision.deciding(word), 'a part has a rule that decides it'


def test_the_strongest_rule_is_not_the_force():
    """Of `allround`: zero is the strongest by far, and makes a fifth of a force of 0.12 N."""
    decision = explain.decide(load_controller('allround'), -11.0, 0.5)
    assert (decision.rules[0].force, decision.rules[0].strength) == (
        'Z',
        pytest.approx(1.0, abs=5e-3),
    )
    assert decision.force_n == pytest.approx(-0.1201, abs=1e-4)
    assert decision.reasons.sentence == (
        '-0.12 N, between small negative and zero (24 % of 0.5 N): '
        '67 % from small negative (-0.234 N), because position error is small positive and '
        'velocity error is large negative; '
        '19 % from zero (0 N), because position error is small positive and velocity error is '
        'small negative; '
        '15 % from small positive (+0.247 N), because position error is large positive and '
        'velocity error is small negative'
    )
    assert (
        explain.reasons(load_controller('allround'), (-11.0, 0, 0, 0.5, 0, 0))[0]
        == decision.reasons
    )


def test_rules_that_tie_decide_together(handmade):
    """At e = v = -0.25 all four rules that fire have the strength 0.5; three command SN."""
    functions = MembershipFunctions(0.5, 0.0, 0.5, 1.0, 0.5)
    system = replace(handmade.system, position=functions, velocity=functions)
    decision = explain.decide(FuzzyController('any', system, 1.0, 1.0, 1.0), 0.25, 0.25)
    tied = {(r.position, r.velocity) for r in decision.deciding('SN')}
    assert tied == {('SN', 'SN'), ('SN', 'Z'), ('Z', 'SN')}
    assert decision.reasons.sentence.count(', or position error is') == 2


def test_without_a_rule_there_is_no_force(handmade):
    bare = replace(handmade.system, position=MembershipFunctions(0.1, 0.5, 0.6, 0.7, 0.8))
    decision = explain.decide(replace(handmade, system=bare), -0.3 * 70.0, 0.0)
    assert (decision.rules, decision.force_n) == ((), 0.0)
    assert decision.reasons.sentence == '0 N: no rule fires'


@pytest.mark.parametrize(
    ('state', 'message'),
    [
        ([1e6, 0, 0, 0, 0, 0], '`x` must be a finite number >= -100000 and <= 100000 m; got'),
        ([0, 0, 0, 0, np.nan, 0], '`vy` must be a finite number'),
    ],
)
def test_states_outside_the_domain_are_refused(handmade, state, message):
    with pytest.raises(InputError, match=message):
        explain.decisions(handmade, state)


def test_causes_are_said_the_greatest_first_and_the_least_together():
    shares = (0.049, 0.05, 0.85, 0.049, 0.002)
    causes = [Cause(s, f'{i} N', f'why {i}') for i, s in enumerate(shares)]
    assert Reasons('+1 N', causes).sentence == (
        '+1 N: 85 % from 2 N, because why 2; 5 % from 1 N, because why 1; 10 % others'
    )
    assert Reasons('0 N').sentence == '0 N'
    said = Reasons('1 N', [causes[2], causes[4]]).sentence
    assert said == '1 N: 85 % from 2 N, because why 2'
