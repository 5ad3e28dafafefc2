# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A rule base examined: every fault has its warning, every rule its share of the square."""

from dataclasses import replace

from core_strategies import functions
from hypothesis import given
from hypothesis import strategies as st

from rpo_core.control.fuzzy import WORDS, MembershipFunctions, RuleTable
from rpo_judge.analysis import rule_base


@given(functions, st.floats(0, 1))
def test_holes_are_where_no_word_fits(parts, size):
    inside = any(low <= size <= high for low, high in rule_base.holes(parts))
    edge = any(abs(size - foot) < 1e-12 for hole in rule_base.holes(parts) for foot in hole)
    assert edge or inside == (parts.grades(size).max() == 0.0)


def test_shipped_rules_have_no_warnings(handmade):
    assert rule_base.warnings(handmade.system) == ()


def test_every_fault_has_its_warning(handmade):
    def said(**parts):
        return ' | '.join(rule_base.warnings(replace(handmade.system, **parts)))

    codes = handmade.system.rules.codes.copy()
    codes[4, 4] = 3
    assert (
        'as the position error grows from (velocity LP, position SP) to (velocity LP, '
        'position LP), the force falls from LP to SP'
    ) in said(rules=RuleTable.from_codes(codes))
    assert 'no word fits a position error whose size is between 0.2 and 0.3' in said(
        position=MembershipFunctions(0.2, 0.3, 0.4, 0.9, 0.5)
    )
    # SP lies under LP, and the two say the same of a large velocity error: SP never decides.
    nested = said(position=MembershipFunctions(0.5, 0.3, 1.0, 1.0, 0.2))
    assert 'rule (velocity LP, position SP) → LP never decides' in nested
    assert 'position word SP has a vertical edge' in nested
    assert 'force words SN and SP fall between the output samples' in said(
        force=MembershipFunctions(0.1, 0.303, 0.305, 0.307, 0.4)
    )


def test_shares_of_the_square_add_up(handmade):
    found = rule_base.activities(handmade.system)
    assert [(rule.velocity, rule.position) for rule in found] == [
        (row, column) for row in WORDS for column in WORDS
    ]
    assert all(0 < rule.decides <= rule.fires <= 1 for rule in found)
