# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Controller files: the shipped ones load, round-trip, and every field refuses what it should."""

from __future__ import annotations

import math

from core_documents import MISSING, assert_names, changed, document, keys, refusal, renamed
from core_strategies import functions, odd_rules, systems
from hypothesis import given, settings
from hypothesis import strategies as st

from rpo_core import files
from rpo_core.control import controller
from rpo_core.control.controller import FuzzyController, dumps, load_controller
from rpo_core.control.fuzzy import WORDS

HANDMADE = document('controller', 'handmade')
FEET = ['z_half_width', 'sp_left', 'sp_centre', 'sp_right', 'lp_left']


def test_shipped_controllers_load_and_round_trip():
    names = files.shipped('controller')
    assert 'handmade' in names
    for name in names:
        loaded = load_controller(name)
        assert loaded.name == name
        again = files.loads(dumps(loaded), controller.parse, 'again')
        assert again == loaded
        assert (again.description, again.provenance) == (loaded.description, loaded.provenance)


def test_handmade_is_odd_and_monotone(handmade):
    rules = handmade.system.rules
    assert rules.is_odd and rules.is_monotone and rules.is_transpose_symmetric
    assert handmade.system.samples == 101
    assert handmade.force_scale_n == 0.5


positive = st.floats(1e-6, 1e6)


@settings(max_examples=30)
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


def test_a_misspelt_field_is_guessed():
    for path in keys(HANDMADE):
        if path[0] != 'provenance' and len(path[-1]) > 2:
            message = refusal('controller', renamed(HANDMADE, path, f'{path[-1]}x'))
            assert f'did you mean `{path[-1]}`?' in message


def test_mappings_are_checked():
    for path in [('scales',), ('membership_functions', 'velocity'), ('rules',), ('provenance',)]:
        for bad in (None, 5, 'x', [], True):
            message = refusal('controller', changed(HANDMADE, path, bad))
            assert_names(message, path)
            assert 'must be a mapping' in message and f'got {bad!r}' in message


NUMBERS = [
    *((('scales', key), -70.0, 1e7) for key in ('position_m', 'velocity_m_s', 'force_n')),
    *(
        (('membership_functions', variable, key), -0.1, 1.1)
        for variable in ('position', 'velocity', 'force')
        for key in FEET
    ),
]


def test_numbers_are_checked():
    for path, *outside in NUMBERS:
        for bad in ('0.2', True, [0.2], math.nan, math.inf, *outside):
            message = refusal('controller', changed(HANDMADE, path, bad))
            assert f'{path[-1]}` must be a finite number' in message and f'got {bad!r}' in message


def test_rule_words_are_checked():
    for row in WORDS:
        for bad in ('PL', 'ln', 4, None, True, ['LN']):
            message = refusal('controller', changed(HANDMADE, ('rules', row, 1), bad))
            assert f'`rules.{row}[SN]` must be one of LN, SN, Z, SP, LP; got {bad!r}' in message
        for bad in (None, 'LN', ['LN'] * 4, ['LN'] * 6, {'LN': 'LN'}, []):
            message = refusal('controller', changed(HANDMADE, ('rules', row), bad))
            assert f'`rules.{row}` must be a list of 5 words; got {bad!r}' in message


def test_columns_must_be_in_order():
    for bad in (list(reversed(WORDS)), ['LN'], None, 'LN SN Z SP LP'):
        message = refusal('controller', changed(HANDMADE, ('rules', 'columns'), bad))
        assert '`rules.columns` must be [LN, SN, Z, SP, LP]' in message


def test_claimed_symmetry_is_checked():
    not_transposed = changed(HANDMADE, ('rules', 'LN', 1), 'SN')
    message = refusal('controller', not_transposed)
    assert '`rules.symmetry` is odd, but the table is not its own transpose' in message
    not_odd = changed(HANDMADE, ('rules', 'LN', 0), 'SN')
    assert 'rule(-e, -v) = -rule(e, v) does not hold' in refusal('controller', not_odd)
    transpose = changed(not_odd, ('rules', 'symmetry'), 'transpose')
    assert controller.parse(transpose).system.rules.words[0][0] == 'SN'
    assert 'not its own transpose' in refusal(
        'controller', changed(not_transposed, ('rules', 'symmetry'), 'transpose')
    )
    free = changed(not_transposed, ('rules', 'symmetry'), 'free')
    assert controller.parse(free).system.rules.words[0][1] == 'SN'
    message = refusal('controller', changed(HANDMADE, ('rules', 'symmetry'), 'even'))
    assert "`rules.symmetry` must be one of free, transpose, odd; got 'even'" in message


def test_inference_settings_are_the_supported_ones():
    for key, only in controller.INFERENCE.items():
        for bad in ('prod', None, 1, True):
            message = refusal('controller', changed(HANDMADE, ('inference', key), bad))
            assert f'`inference.{key}` must be one of {only}; got {bad!r}' in message
    for bad in (0, 1, 100, -101, 101.0, True, '101', None, 200_001, math.nan):
        message = refusal('controller', changed(HANDMADE, ('inference', 'samples'), bad))
        assert '`inference.samples` must be ' in message and f'got {bad!r}' in message


def test_names_and_schema_are_checked():
    for bad in (None, '', ' ', 5, 'a\0b', 'a\nb', 'x' * 201):
        assert '`name` must be ' in refusal('controller', changed(HANDMADE, ('name',), bad))
    for bad in (None, 1, 'rpo/controller/2', 'rpo/scenario/1', ['rpo/controller/1']):
        message = refusal('controller', changed(HANDMADE, ('schema',), bad))
        assert '`schema` must be rpo/controller/1; got ' in message


@given(functions)
def test_every_membership_function_that_can_be_built_can_be_loaded(part):
    feet = dict(zip(FEET, [getattr(part, key) for key in FEET], strict=True))
    loaded = controller.parse(changed(HANDMADE, ('membership_functions', 'force'), feet))
    assert loaded.system.force == part
