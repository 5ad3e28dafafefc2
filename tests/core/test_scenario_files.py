# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Scenario files: the shipped ones load, fields refuse what they should, `--set` changes them."""

from __future__ import annotations

import datetime
from dataclasses import replace

import numpy as np
import pytest
from core_documents import changed, document, refusal

from rpo_core import files
from rpo_core.attitude.target import Target
from rpo_core.files.validation import InputError
from rpo_core.navigation.sensors import Navigation
from rpo_core.scenario import overrides, scenario
from rpo_core.scenario.scenario import load_scenario, parse
from rpo_core.thrusters.thrusters import Failure, Propellant, Pulses, ThrusterError, Thrusters
from rpo_core.world import cw, starts
from rpo_core.world.disturbance import Disturbance, Harmonic
from rpo_core.world.dynamics import Drag, Dynamics

SINGLE = document('scenario', 'paper_test')
SET = document('scenario', 'paper_training')
PULSES = Pulses(
    count=12, modulation='sigma_delta', minimum_on_time_s=0.01, on_time_quantum_s=0.001,
    errors=(ThrusterError(thruster='x+a', magnitude_share=0.1),),
    failures=(Failure(thruster='x+b', stuck='off', until_s=3.0, known=True),),
)  # fmt: skip
AIR = Drag(
    density_kg_m3=2e-11, target_ballistic_coefficient_kg_m2=150.0, scale_height_m=5e4,
    chaser_ballistic_coefficient_kg_m2=110.0, atmosphere_rate_rad_s=7.292e-5,
)  # fmt: skip
SECTIONS = {
    'hardware': (
        Thrusters(((0.9, 0.1, 0.0), (0.0, 1.1, -0.2), (0.05, 0.0, 1.0)), 3),
        Navigation((0.3, -0.2, 0.1), (0.01, 0.0, -0.02), 0.05, 0.004, (12, 34)),
    ),
    'pulses': (
        Thrusters(
            delay_ticks=2, pulses=PULSES, propellant=Propellant(specific_impulse_s=9.0, mass_kg=0.5)
        ),
    ),
    'world': (Dynamics(kind='two_body', eccentricity=0.02, inclination_deg=9.0, drag=AIR),),
    'target': (Target(kind='tumble', rates_deg_s=(3.5, 9.3, 6.0), known_error_deg=(1.0, 0, 0)),),
}


@pytest.mark.parametrize('sections', SECTIONS.values(), ids=SECTIONS)
def test_sections_are_written_and_read_back_to_the_same_bits(sections):
    flown = scenario.load_scenario('paper_test_phase').equipped(*sections)
    assert files.loads(scenario.dumps(flown), scenario.parse, 'again') == flown


@pytest.mark.parametrize('name', ['approach', 'paper_test', 'paper_test_phase', 'quick'])
def test_shipped_scenarios_are_the_papers_test(name):
    loaded = scenario.load_scenario(name)
    assert loaded.name == name
    assert loaded.orbit_radius_m == 6_678_000
    assert (loaded.mass_kg, loaded.max_force_n, loaded.dt_s) == (10.0, 0.5, 0.1)
    assert loaded.start == (10.0, 60.0, -40.0, 0.0, 0.0, 0.0)
    assert loaded.ticks == (50 if name == 'quick' else 4000)
    utc = datetime.timezone.utc
    epoch = datetime.datetime(2026, 1, 1, tzinfo=utc).timestamp()
    assert loaded.epoch_ns == int(epoch) * 1_000_000_000


def test_shipped_set_is_the_papers_training():
    loaded = scenario.load_set('paper_training')
    starts = loaded.initial_positions_m
    assert starts.shape == (216, 3)
    assert {tuple(start) for start in starts} == {
        (x, y, z)
        for x in (-100, -50, -5, 5, 50, 100)
        for y in (-100, -50, -5, 5, 50, 100)
        for z in (-100, -50, -5, 5, 50, 100)
    }
    members = loaded.scenarios()
    assert [member.initial_position_m for member in members] == [tuple(s) for s in starts.tolist()]
    assert members[7].name == 'paper_training_7'
    assert {(m.ticks, m.disturbance.is_zero) for m in members} == {(2000, True)}


def test_ticks_and_stamps_are_integers(paper_test):
    assert paper_test.dt_ns == 100_000_000
    assert paper_test.time_s(3) == 0.3  # and not 0.1 + 0.1 + 0.1
    assert paper_test.stamp_ns(4000) - paper_test.epoch_ns == 400 * 1_000_000_000
    for tick in (0, 1, 1234, 4000):
        assert paper_test.tick_of(paper_test.stamp_ns(tick)) == tick
    for stray in (-1, 1, 50_000_000):
        assert paper_test.tick_of(paper_test.stamp_ns(10) + stray) is None
    assert paper_test.tick_of(paper_test.stamp_ns(-1)) is None
    assert paper_test.tick_of(paper_test.stamp_ns(4001)) is None
    assert paper_test.times_s.shape == (4001,) and paper_test.times_s[-1] == 400.0


def test_a_set_has_1_to_100_positions():
    field = 'initial_position_axis_m'
    said = refusal('scenario', changed(SET, (field,), [1.0] * 101))
    assert f'`{field}` must be a list of 1 to 100 positions in m; got ' in said
    assert scenario.parse(changed(SET, (field,), [7.0])).initial_positions_m.tolist() == [[7.0] * 3]


def text(old, new, name='paper_test'):
    """Return a shipped scenario with one piece of text replaced."""
    content = files.find('scenario', name).read_text()
    assert content.count(old) == 1
    return content.replace(old, new)


def test_epoch_in_another_zone_is_the_same_moment(paper_test):
    content = text('2026-01-01T00:00:00Z', '2026-01-01T02:30:00+02:30')
    assert files.loads(content, scenario.parse, 'mine.yaml') == paper_test
    content = text('2026-01-01T00:00:00Z', '2026-01-01T00:00:00.000001Z')
    moved = files.loads(content, scenario.parse, 'mine.yaml')
    assert moved.epoch_ns == paper_test.epoch_ns + 1000
    assert scenario.parse(scenario.to_document(moved)) == moved


@pytest.mark.parametrize('written', ['1e-1', '6.678e6', '1.0e-1x', '"0.1"', '0,1'])
def test_numbers_that_yaml_reads_as_text_are_explained(written):
    message = refusal('scenario', text('dt_s: 0.1', f'dt_s: {written}'))
    assert '`dt_s` must be a finite number' in message
    signed = '; YAML wants a point and a signed exponent, like 1.0e-3 or 1.0e+3'
    hints = {
        '1e-1': signed,
        '6.678e6': signed,
        '"0.1"': '; without the quotes it is a number',
    }
    assert message.endswith(hints.get(written, f'got {written!r}'))


def test_kinds_are_told_apart():
    with pytest.raises(InputError, match='must be a single flight; paper_training is a set of 216'):
        scenario.load_scenario('paper_training')
    with pytest.raises(InputError, match=r'must be a set .* paper_test is a single flight'):
        scenario.load_set('paper_test')
    message = refusal('scenario', changed(SET, ('schema',), 'rpo/scenario/1'))
    assert (
        '`initial_position_axis_m` is not a known field; did you mean `initial_position_m`'
        in message
    )


def test_built_in_code_a_scenario_is_checked_alike(paper_test):
    with pytest.raises(InputError, match='`mass_kg` must be'):
        replace(paper_test, mass_kg=0)
    with pytest.raises(InputError, match='`epoch`'):
        replace(paper_test, epoch_ns=0)
    with pytest.raises(
        InputError, match=r'`disturbance.harmonics\[0\]` must turn less than 1e\+06'
    ):
        fast = Disturbance(harmonics=(Harmonic('x', 'sin', 1.0, 10.0),))
        replace(paper_test, duration_s=1e5, disturbance=fast)
    with pytest.raises(InputError, match='must turn less than'):  # the phase counts too
        late = Disturbance(harmonics=(Harmonic('x', 'sin', 1.0, -10.0, -100.0),))
        replace(paper_test, duration_s=99_995.0, disturbance=late)
    with pytest.raises(InputError, match='at most 10000000 ticks'):
        replace(paper_test, duration_s=1_000_000.1)
    turned = replace(paper_test, initial_position_m=np.array([1, 2, 3]))
    assert turned.initial_position_m == (1.0, 2.0, 3.0)


def test_goal_and_body_are_optional_checked_and_written_back(paper_test):
    mine = {**SINGLE, 'goal_position_m': [0, 10, 0], 'body': 'moon', 'orbit_radius_m': 1.8374e6}
    loaded = scenario.parse(mine)
    assert loaded.goal_position_m == (0.0, 10.0, 0.0) and loaded.body == cw.BODIES['moon']
    assert files.loads(scenario.dumps(loaded), scenario.parse, 'again') == loaded
    own = {
        'mu_m3_s2': 1.26686534e17,
        'radius_m': 7.1e7,
        'j2': 0.0147,
        'equatorial_radius_m': 7.1492e7,
    }
    jupiter = scenario.parse({**mine, 'body': own, 'orbit_radius_m': 8e7})
    assert files.loads(scenario.dumps(jupiter), scenario.parse, 'again') == jupiter
    for word in ('goal', 'body'):
        assert word not in scenario.dumps(paper_test)
    assert scenario.parse({**SINGLE, 'body': 'earth', 'goal_position_m': [0, 0, 0]}) == paper_test
    training = scenario.parse({**SET, 'goal_position_m': [0, 10, 0]})
    assert {s.goal_position_m for s in training.scenarios()} == {(0.0, 10.0, 0.0)}


def test_starts_of_a_grid_and_of_a_box():
    grid = starts.Grid((1.0, 2.0), (3.0,), (4.0, 5.0)).positions_m
    assert grid.tolist() == [[1.0, 3.0, 4.0], [1.0, 3.0, 5.0], [2.0, 3.0, 4.0], [2.0, 3.0, 5.0]]
    least, most = np.array([-4.0, 2.0, 0.0]), np.array([6.0, 2.0, 1.0])
    box = starts.Box(tuple(least), tuple(most), random=2000, seed=3)
    corners, drawn = np.split(box.positions_m, [4])
    assert corners.tolist() == [
        [-4.0, 2.0, 0.0],
        [-4.0, 2.0, 1.0],
        [6.0, 2.0, 0.0],
        [6.0, 2.0, 1.0],
    ]
    assert ((drawn >= least) & (drawn <= most)).all()
    assert np.abs(drawn.mean(axis=0) - 0.5 * (least + most)).max() < 0.3
    assert np.abs(drawn.std(axis=0) * np.sqrt(12.0) - (most - least)).max() < 0.3
    assert (box.positions_m == replace(box).positions_m).all()
    assert (box.positions_m[4:] != replace(box, seed=4).positions_m[4:])[:, [0, 2]].all()
    with pytest.raises(InputError, match='`least` must not be beyond `most`'):
        replace(box, most=(6.0, 1.9, 1.0))


def test_a_set_has_one_field_of_starts():
    one, other = starts.FIELDS[1:]
    assert starts.field_of({one: {}}) == one and starts.field_of({}) == starts.FIELDS[0]
    with pytest.raises(
        InputError, match=f'`{one}` must be the only starts of a set; got `{other}`'
    ):
        starts.field_of({one: {}, other: {}})
    grid = {'x': [1.0], 'y': [2.0], 'z': [3.0]}
    assert starts.parse(one, grid) == starts.Grid((1.0,), (2.0,), (3.0,))
    box = {'least': [0.0, 0.0, 0.0], 'most': [1.0, 1.0, 1.0]}
    assert starts.parse(other, box) == starts.Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    assert starts.parse(starts.FIELDS[0], [1.0]) == starts.Grid.cube((1.0,))


def test_the_farthest_of_a_set_is_the_one_that_is_rehearsed():
    training = scenario.load_set('paper_training')
    far = replace(training, starts=starts.Grid((1.0, -9.0, 4.0), (2.0, 3.0), (-1.0, 0.5)))
    assert far.farthest == replace(training.base, initial_position_m=(-9.0, 3.0, -1.0))


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
    assert overrides.load('assured', ['assurance=null']).named('assurance') is None
    assert overrides.text_of('quick', []) == files.find('scenario', 'quick').read_text()
    text = overrides.text_of('paper_test', ['body=moon', 'orbit_radius_m=2000000.0'])
    assert files.loads(text, parse, 'text').orbit_radius_m == 2e6


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ('mass_kg', '`--set` must be KEY=VALUE, like mass_kg=12.0; got'),
        ('=3', '`--set` must be KEY=VALUE'),
        ('asurance=null', '`asurance` is not a known field'),
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
