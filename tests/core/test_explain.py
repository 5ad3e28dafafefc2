# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Explaining: what is said of a decision is what was decided; warnings where they are due."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from core_oracles import grade, mamdani, triangles
from core_strategies import systems
from hypothesis import given
from hypothesis import strategies as st

from rpo_core import explain
from rpo_core.controller import FuzzyController
from rpo_core.fuzzy import WORDS, MembershipFunctions
from rpo_core.validation import InputError

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
        json.dumps(dict(decision.pairs()), allow_nan=False)


def test_the_sentence_of_the_issue(handmade):
    """At 10 m, at rest: e = -1/7 is SN to 5/7, Z to 2/7."""
    decision = explain.decide(handmade, 10.0, 0.0)
    assert decision.sentence == (
        'position error is small negative and velocity error is zero → force small negative, 0.71'
    )
    assert decision.rules[0].strength == pytest.approx(5 / 7)
    assert [rule.force for rule in decision.rules] == ['SN', 'Z', 'LN']
    assert decision.force_n < 0


def test_saturated_errors_are_said(handmade):
    decision = explain.decide(handmade, -500.0, 0.9)
    assert (decision.position_error, decision.velocity_error) == (1.0, -1.0)
    assert decision.position_saturated and not decision.velocity_saturated


def test_without_a_rule_there_is_no_force(handmade):
    bare = replace(handmade.system, position=MembershipFunctions(0.1, 0.5, 0.6, 0.7, 0.8))
    decision = explain.decide(replace(handmade, system=bare), -0.3 * 70.0, 0.0)
    assert (decision.rules, decision.force_n) == ((), 0.0)
    assert decision.sentence == 'no rule fires → no force, 0.00'


@pytest.mark.parametrize(
    ('state', 'message'),
    [
        ([0.0] * 5, '`state` must be 6 numbers'),
        ([1e6, 0, 0, 0, 0, 0], '`x` must be a finite number >= -100000 and <= 100000 m; got'),
        ([0, 0, 0, 0, np.nan, 0], '`vy` must be a finite number'),
    ],
)
def test_states_outside_the_domain_are_refused(handmade, state, message):
    with pytest.raises(InputError, match=message):
        explain.decisions(handmade, state)
