# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Controller files: the shipped ones load, round-trip, and every field refuses what it should."""

from __future__ import annotations

from core_documents import MISSING, changed, document
from core_strategies import odd_rules, systems
from hypothesis import given, settings
from hypothesis import strategies as st

from rpo_core import files
from rpo_core.control import controller
from rpo_core.control.controller import FuzzyController, dumps, load_controller

HANDMADE = document('controller', 'handmade')


def test_shipped_controllers_load_and_round_trip():
    names = files.shipped('controller')
    assert 'handmade' in names
    for name in names:
        loaded = load_controller(name)
        assert loaded.name == name
        again = files.loads(dumps(loaded), controller.parse, 'again')
        assert again == loaded
        assert (again.description, again.provenance) == (loaded.description, loaded.provenance)


positive = st.floats(1e-6, 1e6)


@settings(max_examples=10)
@given(systems(odd_rules), positive, positive, positive, st.text(max_size=20), st.integers())
def test_any_controller_round_trips_bit_for_bit(system, position, velocity, force, note, seed):
    built = FuzzyController(
        'mine', system, position, velocity, force, provenance={'note': note, 'seed': seed}
    )
    again = files.loads(dumps(built), controller.parse, 'again')
    assert again == built and again.provenance == built.provenance


def test_provenance_may_hold_one_list_twice(handmade):
    """Plain PyYAML would write an alias, which the reader refuses."""
    figures = [1.0, 2.0]
    document = controller.to_document(handmade)
    document['provenance'] = {'first': figures, 'second': figures, 'deep': {'third': figures}}
    loaded = files.loads(dumps(controller.parse(document)), controller.parse, 'again')
    assert loaded.provenance == document['provenance']


def test_the_rule_table_is_written_as_a_table(handmade):
    lines = dumps(handmade).splitlines()
    assert '  LN: [LN, LN, LN, SN, Z]' in lines and '  LP: [Z, SP, LP, LP, LP]' in lines


def test_what_may_be_missing_is_empty():
    for key, empty in (('description', ''), ('provenance', {})):
        assert getattr(controller.parse(changed(HANDMADE, (key,), MISSING)), key) == empty


def test_a_table_may_claim_less_than_it_is():
    not_odd = changed(HANDMADE, ('rules', 'LN', 0), 'SN')
    transpose = changed(not_odd, ('rules', 'symmetry'), 'transpose')
    assert controller.parse(transpose).system.rules.words[0][0] == 'SN'
    not_transposed = changed(HANDMADE, ('rules', 'LN', 1), 'SN')
    free = changed(not_transposed, ('rules', 'symmetry'), 'free')
    assert controller.parse(free).system.rules.words[0][1] == 'SN'
