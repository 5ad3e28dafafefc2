# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Fields of scenarios and controllers that are refused, each in one sentence."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, get_type_hints

import pytest
from core_documents import MISSING, changed, document, refusal

from rpo_core import files
from rpo_core.files.validation import InputError

ROWS = files.load(Path(__file__).with_name('refused.yaml'), dict)
CASES = [(base, changes, said) for base, rows in ROWS.items() for changes, said in rows]
OUTAGES = [[float(i), i + 1.0] for i in range(101)]
MANY = {'kind': 'range_bearing', 'bearing_noise_rad': 0.002, 'outages_s': OUTAGES}
CASES.append(('scenario quick', {'sensors': {'units': [MANY]}}, 'a list of at most 100'))


@pytest.mark.parametrize(('base', 'changes', 'said'), CASES)
def test_what_cannot_be_is_one_sentence(base: str, changes: dict[str, Any], said: str):
    kind, name = base.split()
    data = document(kind, name)
    for key, value in changes.items():
        path = tuple(int(part) if part.isdigit() else part for part in key.split('.'))
        data = changed(data, path, MISSING if value is None else value)
    assert said in refusal(kind, data)


def checked_fields(record: Any) -> list[str]:
    """Return the fields of a class that have a check."""
    hints = get_type_hints(record, include_extras=True).items()
    return [name for name, hint in hints if any(map(callable, getattr(hint, '__metadata__', ())))]


def records() -> Iterator[Any]:
    """Yield the classes that check their fields, of all packages."""
    root = Path(__file__).parents[2]
    folders = [*root.glob('ros_ws/src/rpo_*'), root / 'offline_training']
    for folder, path in sorted((f, path) for f in folders for path in f.glob('rpo*/**/*.py')):
        if '(Checked' not in path.read_text():
            continue
        module = '.'.join(path.relative_to(folder).with_suffix('').parts)
        for record in vars(import_module(module)).values():
            own = isinstance(record, type) and record.__module__ == module
            if own and is_dataclass(record) and checked_fields(record):
                yield record


@pytest.mark.parametrize('record', list(records()), ids=lambda record: record.__name__)
def test_a_record_checks_its_fields_when_python_makes_it(record: Any):
    made, checked = object.__new__(record), checked_fields(record)
    for field in fields(record):
        kept = field.default_factory is dict and field.name not in checked
        object.__setattr__(made, field.name, {} if kept else object())
    with pytest.raises(InputError, match=f'^`{record.PLACE}{checked[0]}` must '):
        made.__post_init__()
