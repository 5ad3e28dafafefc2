# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Every field of every kind of file: missing, of the wrong type, not a number, cut, newer, garbage.

Each is refused in one sentence that names the file and the field; nothing else escapes.
"""

from __future__ import annotations

import dataclasses
import math
import random

import pytest
import yaml
from core_documents import MISSING, PARSERS, changed, document, keys, name, renamed, with_harmonics
from hypothesis import given, settings
from hypothesis import strategies as st

from rpo_core import files
from rpo_core.files.validation import InputError
from rpo_core.judge.requirements import ATTITUDES, THRUST, Requirements
from rpo_safety import limit_checker

PARSE = {**PARSERS, 'monitor': limit_checker.parse}
FREE = ('provenance', 'description')
"""Fields whose content is anybody's; `description` may be missing too."""


def one_harmonic():
    """Return a scenario whose disturbance is written out, with one harmonic."""
    data = with_harmonics()
    del data['disturbance']['harmonics'][0]
    return data


def with_hardware():
    """Return a scenario whose thrusters and navigation have errors."""
    data = document('scenario', 'quick')
    data['thrusters'] = {'matrix': [[1, 0, 0], [0, 1, 0], [0, 0, 1]], 'delay_ticks': 1}
    data['navigation'] = {
        'position_bias_m': [0.1, 0, 0], 'velocity_bias_m_s': [0, 0, 0],
        'position_noise_m': 0.1, 'velocity_noise_m_s': 0.01, 'noise_key': [1, 2],
    }  # fmt: skip
    return data


def with_requirements():
    """Return a scenario that requires all that can be required without pulses and propellant."""
    data = document('scenario', 'quick')
    names = {f.name for f in dataclasses.fields(Requirements)} - set(THRUST)
    required = {name: 1.0 for name in sorted(names)}
    data['requirements'] = {**required, 'contact_axis': '+y', 'profile': 'idss'}
    for key in ATTITUDES:  # of a chaser that turns
        del data['requirements'][key]
    del data['requirements']['arrival_error_norm_m']  # per axis or norm, not both
    return data


DOCUMENTS = {
    ('scenario', 'requirements'): with_requirements(),
    ('scenario', 'paper_test'): document('scenario', 'paper_test'),
    ('scenario', 'paper_training'): document('scenario', 'paper_training'),
    ('scenario', 'harmonics'): one_harmonic(),
    ('scenario', 'hardware'): with_hardware(),
    **{
        ('controller', n): document('controller', n)
        for n in (
            'handmade',
            'pd',
            'lqr',
            'mpc',
            'apf_smc',
            'drift',
            'pace',
            'more_words',
            'time_to_go',
        )
    },
    ('monitor', 'default'): document('monitor', 'default'),
}
IDS = [f'{kind} {which}' for kind, which in DOCUMENTS]
each_file = pytest.mark.parametrize('file', DOCUMENTS, ids=IDS)


def fields(data):
    """Return the path of every field that means something."""
    return [path for path in keys(data) if path[0] not in FREE]


def optional(path):
    """Whether a field may be missing."""
    return path[0] in ('thrusters', 'navigation', 'requirements') or path[-1] in (
        'phase_rad',
        'kind',
    )


def value_at(data, path):
    for key in path:
        data = data[key]
    return data


def refusal(folder, kind, data):
    """Load a document, or a file of these bytes; return how it is refused, None if it is not."""
    path = folder / 'mine.yaml'
    try:
        if isinstance(data, (str, bytes)):
            path.write_bytes(data.encode() if isinstance(data, str) else data)
            files.load(path, PARSE[kind])
        else:  # as YAML gives it; writing and reading would take most of the time
            PARSE[kind](data)
    except InputError as error:
        said = str(error)
        assert '\n' not in said and len(said) < 600
        assert said.startswith(f'{path}: ') or not isinstance(data, (str, bytes))
        return said
    return None


@each_file
def test_the_file_itself_is_taken(file, tmp_path):
    assert refusal(tmp_path, file[0], DOCUMENTS[file]) is None


@each_file
def test_every_missing_field_is_named(file, tmp_path):
    data = DOCUMENTS[file]
    for path in fields(data):
        if optional(path):
            continue
        said = refusal(tmp_path, file[0], changed(data, path, MISSING))
        assert said is not None, f'{name(path)} may be missing'
        assert name(path) in said, said


@each_file
def test_every_unknown_field_is_named(file, tmp_path):
    data = DOCUMENTS[file]
    for path in fields(data):
        wrong = f'{path[-1]}x'
        said = refusal(tmp_path, file[0], renamed(data, path, wrong))
        assert said is not None and (wrong in said or path == ('kind',)), said


@each_file
@pytest.mark.parametrize('bad', [None, True, [], {}, [[1]], {'x': 1}, 'such a text', math.nan,
                                 math.inf, -math.inf])  # fmt: skip
def test_every_field_of_a_wrong_type_or_not_finite_is_named(file, bad, tmp_path):
    data = DOCUMENTS[file]
    for path in fields(data):
        value = value_at(data, path)
        if type(value) is type(bad) and not isinstance(bad, float):
            continue  # any text is a name, a mapping or list has tests of its own
        said = refusal(tmp_path, file[0], changed(data, path, bad))
        assert said is not None, f'{name(path)}: {bad} is taken'
        assert path[-1] in said or str(path[0]) in said, said


@each_file
def test_a_newer_version_is_refused_by_its_schema(file, tmp_path):
    data = DOCUMENTS[file]
    *stem, version = data['schema'].split('/')
    newer = '/'.join([*stem, str(int(version) + 1)])
    said = refusal(tmp_path, file[0], changed(data, ('schema',), newer))
    assert '`schema` must be' in said and newer in said


@each_file
def test_a_file_cut_anywhere_is_refused_while_a_field_lacks(file, tmp_path):
    text = yaml.safe_dump(DOCUMENTS[file], sort_keys=False)
    needed = {path for path in fields(DOCUMENTS[file]) if not optional(path)}
    for cut in range(0, len(text), max(1, len(text) // 40)):
        if refusal(tmp_path, file[0], text[:cut]) is None:
            assert needed <= set(keys(yaml.safe_load(text[:cut]))), f'taken, cut at {cut}'


@pytest.mark.parametrize('kind', PARSE)
@pytest.mark.parametrize('filling', ['zeros', 'random', 'letters', 'brackets', 'lines'])
def test_ten_megabytes_of_garbage_are_refused(kind, filling, tmp_path):
    size = 10_000_000
    garbage = {
        'zeros': bytes(size),
        'random': random.Random(1).randbytes(size),
        'letters': b'a' * size,
        'brackets': b'[' * size,
        'lines': b'- x: [1]\n' * (size // 9),
    }[filling]
    assert refusal(tmp_path, kind, garbage) is not None


def anything():
    leaf = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
    return st.recursive(
        leaf,
        lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner),
        max_leaves=6,
    )


def spoil_and_load(draw):
    file = draw.draw(st.sampled_from(list(DOCUMENTS)))
    data = DOCUMENTS[file]
    for path in draw.draw(st.lists(st.sampled_from(keys(data)), min_size=1, max_size=3)):
        try:
            data = changed(data, path, draw.draw(anything()))
        except (KeyError, IndexError, TypeError):  # an earlier change took the place away
            continue
    text = yaml.safe_dump(data, sort_keys=False)
    cut = draw.draw(st.integers(0, len(text)) | st.just(len(text)))
    try:
        files.loads(text[:cut], PARSE[file[0]], 'fuzz.yaml')
    except InputError as error:
        assert '\n' not in str(error)


@given(draw=st.data())
def test_spoilt_files_of_every_kind(draw):
    spoil_and_load(draw)


@pytest.mark.slow
@pytest.mark.timeout(900)
@settings(max_examples=10_000)
@given(draw=st.data())
def test_ten_thousand_spoilt_files_of_every_kind(draw):
    spoil_and_load(draw)
