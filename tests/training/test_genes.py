# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Chromosomes always decode to valid controllers of their space."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rpo_core import files
from rpo_core.control import controller as controllers
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError
from rpo_montecarlo.engine.population import population_of
from rpo_training.genes import RULES, GeneSpace

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


def test_the_rule_spaces_have_the_papers_sizes():
    assert [GeneSpace(rules).size for rules in RULES] == [15 + 15, 15 + 6, 15 + 6]
    assert GeneSpace('free', (20.0, 200.0), (0.3, 3.0)).size == 32


def test_each_rule_of_each_space_can_take_each_word():
    rng = np.random.default_rng(0)
    for rules, words in (('free', range(5)), ('odd', range(5)), ('odd-monotone', range(3))):
        space = GeneSpace(rules)
        tables = space.decode(rng.random((4000, space.size))).rules.reshape(-1, 5, 5)
        for row, column in ((0, 0), (1, 0), (3, 0), (2, 1)):
            assert set(tables[:, row, column]) == set(words)


def test_a_controller_outside_the_bounds_is_refused():
    handmade = load_controller('handmade')
    with pytest.raises(InputError, match='outside the bounds'):
        GeneSpace('odd', (20.0, 50.0), (0.3, 3.0)).encode(handmade)
    free = GeneSpace('free').decode(np.random.default_rng(4).random((1, 30))).controller(0, 'free')
    with pytest.raises(InputError, match='are not odd'):
        GeneSpace('odd').encode(free)


@pytest.mark.parametrize('bounds', [(100.0, 50.0), (0.0, 1.0), (-1.0, 1.0), (1.0,), ('a', 'b')])
def test_impossible_bounds_are_refused(bounds):
    with pytest.raises(InputError, match='position_scale_m'):
        GeneSpace('free', bounds)


def test_a_population_is_read_from_controllers():
    population = population_of(load_controller('handmade'))
    assert population.controller(0, 'handmade') == load_controller('handmade')


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
