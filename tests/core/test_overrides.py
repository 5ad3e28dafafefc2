# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Fields of a scenario changed on the command line."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rpo_core import files
from rpo_core.files.validation import InputError
from rpo_core.scenario import overrides
from rpo_core.scenario.scenario import load_scenario, parse
from rpo_core.thrusters.thrusters import Thrusters


def test_changed_fields_are_those_of_a_file_with_them():
    changes = ['initial_position_m=[0,80,0]', 'thrusters.delay_ticks=2', 'disturbance=none']
    found = overrides.load('paper_test', changes)
    paper = load_scenario('approach')
    expected = replace(paper, name='paper_test (changed)', initial_position_m=(0.0, 80.0, 0.0))
    assert found == expected.equipped(Thrusters(delay_ticks=2))
    assert found.requirements == load_scenario('paper_test').requirements
    judged = overrides.load('quick', ['requirements.energy_n2s=2', 'name=mine'])
    assert judged.requirements.limits == {'energy_n2s': 2.0} and judged.name == 'mine'
    assert overrides.load('quick', []) == load_scenario('quick')
    assert overrides.text_of('quick', []) == files.find('scenario', 'quick').read_text()
    text = overrides.text_of('paper_test', ['body=moon', 'orbit_radius_m=2000000.0'])
    assert files.loads(text, parse, 'text').orbit_radius_m == 2e6


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ('mass_kg', '`--set` must be KEY=VALUE, like mass_kg=12.0; got'),
        ('=3', '`--set` must be KEY=VALUE'),
        ('masss_kg=3.0', '`masss_kg` is not a known field; did you mean `mass_kg`?'),
        (
            'mass_kg=heavy',
            "`mass_kg` must be a finite number >= 0.001 and <= 1e+09 kg; got 'heavy'",
        ),
        ('mass_kg.x=3', '`mass_kg.x` must name a field; a part of it has no fields'),
        ('mass_kg=[1', '`mass_kg`: line 1: not valid YAML'),
        ('schema=rpo/scenario/9', '`schema` must be'),
    ],
)
def test_a_wrong_change_is_one_sentence_that_names_the_file(change, sentence):
    with pytest.raises(InputError) as refused:
        overrides.text_of('paper_test', [change])
    assert 'paper_test.yaml with --set: ' in str(refused.value)
    assert sentence in str(refused.value) and '\n' not in str(refused.value)
