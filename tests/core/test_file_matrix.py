# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Every field of every kind of file: missing, of the wrong type, not a number, cut, newer, garbage.

Each is refused in one sentence that names the file and the field; nothing else escapes.
"""

from __future__ import annotations

import math

import pytest
from core_documents import DOCUMENTS, MISSING, PARSERS, changed, keys, name, renamed

from rpo_core import files
from rpo_core.files.validation import InputError

FREE = ('provenance', 'description')
"""Fields whose content is anybody's; `description` may be missing too."""


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
            files.load(path, PARSERS[kind])
        else:  # as YAML gives it; writing and reading would take most of the time
            PARSERS[kind](data)
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
