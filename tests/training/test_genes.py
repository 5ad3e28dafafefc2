# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Chromosomes always decode to valid controllers of their space."""

from dataclasses import replace

import numpy as np
import pytest
from core_strategies import functions
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rpo.analysis import rule_base
from rpo.training.genes import RULES, GeneSpace
from rpo_core import files
from rpo_core.control import controller as controllers
from rpo_core.control.controller import load_controller
from rpo_core.control.fuzzy import MembershipFunctions, RuleTable
from rpo_core.files.validation import InputError

SPACES = [
    GeneSpace(rules, scales, (0.3, 3.0), complete=complete)
    for rules in RULES
    for scales in ((70.0, 70.0), (20.0, 200.0))
    for complete in (False, True)
]


@settings(max_examples=30, deadline=None)
@given(st.sampled_from(SPACES), st.data())
def test_every_chromosome_is_a_controller_of_its_space(space, data):
    genes = data.draw(arrays(np.float64, space.size, elements=st.floats(0.0, 1.0)))
    controller = space.decode(genes[None]).controller(0, 'any')
    rules = controller.system.rules
    assert rules.is_transpose_symmetric
    assert rules.is_odd or space.rules == 'free'
    assert rules.is_monotone or space.rules != 'odd-monotone'
    assert files.loads(controllers.dumps(controller), controllers.parse, 'text') == controller
    if space.complete:
        for functions in (controller.system.position, controller.system.velocity):
            grades = functions.grades(np.linspace(-1.0, 1.0, 401))
            assert (grades.max(axis=1) > 0.0).all()


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(SPACES), st.integers(0, 2**32 - 1))
def test_a_controller_encodes_to_itself(space, seed):
    genes = np.random.default_rng(seed).random((1, space.size))
    first = space.decode(genes)
    again = space.decode(space.encode(first.controller(0, 'any'))[None])
    np.testing.assert_array_equal(again.rules, first.rules)
    np.testing.assert_allclose(again.functions, first.functions, atol=2e-4)
    np.testing.assert_allclose(again.scales, first.scales, atol=2e-4)


def test_a_time_scale_slows_the_loop_of_a_law():
    space = GeneSpace('odd', (0.3, 2.0), (0.06, 0.6), 0.006, (0.5, 2.0))
    handmade = replace(load_controller('handmade'), position_scale_m=1.0, velocity_scale_m_s=0.12)
    genes = np.tile(space.encode(handmade), (3, 1))
    assert space.size == GeneSpace('odd', (0.3, 2.0), (0.06, 0.6)).size + 1
    genes[1:, 2] = 0.0, 1.0
    own, fast, slow = space.decode(genes).scales
    np.testing.assert_allclose(own, (1.0, 0.12, 0.006), rtol=1e-12)
    np.testing.assert_allclose(fast, (1.0, 0.24, 0.024), rtol=1e-12)
    np.testing.assert_allclose(slow, (1.0, 0.06, 0.0015), rtol=1e-12)
    assert np.ptp(space.decode(genes).functions, axis=0).max() == 0.0
    with pytest.raises(InputError, match=r'`genes\.time_scale` must be'):
        GeneSpace(time_scale=(2.0, 0.5))


def test_a_controller_outside_the_bounds_is_refused():
    handmade = load_controller('handmade')
    with pytest.raises(InputError, match='outside the bounds'):
        GeneSpace('odd', (20.0, 50.0), (0.3, 3.0)).encode(handmade)
    free = GeneSpace('free').decode(np.random.default_rng(4).random((1, 30))).controller(0, 'free')
    with pytest.raises(InputError, match='are not odd'):
        GeneSpace('odd').encode(free)


def test_the_monotone_tables_are_distinct_and_all_there():
    space = GeneSpace('odd-monotone', (20.0, 200.0), (0.3, 3.0))
    genes = np.full((len(space.rule_tables()), space.size), 0.5)
    genes[:, space.rule_genes] = space.rule_tables()
    tables = {tuple(rules) for rules in space.decode(genes).rules.tolist()}
    drawn = np.random.default_rng(2).random((3000, space.size))
    assert len(tables) == len(genes)
    assert {tuple(rules) for rules in space.decode(drawn).rules.tolist()} == tables
    with pytest.raises(InputError, match='odd-monotone for a race'):
        GeneSpace('odd').rule_tables()


# A rule base examined: every fault has its warning, every rule its share of the square.


@given(functions, st.floats(0, 1))
def test_holes_are_where_no_word_fits(parts, size):
    inside = any(low <= size <= high for low, high in rule_base.holes(parts))
    edge = any(abs(size - foot) < 1e-12 for hole in rule_base.holes(parts) for foot in hole)
    assert edge or inside == (parts.grades(size).max() == 0.0)


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
