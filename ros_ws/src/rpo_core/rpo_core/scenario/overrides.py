# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Fields of a scenario changed: `--set initial_position_m=[0,80,0]`, or a mapping of values."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import yaml

from rpo_core import files
from rpo_core.files import CHANGED as CHANGED
from rpo_core.files.validation import InputError, shown, within
from rpo_core.scenario import scenario
from rpo_core.scenario.scenario import Scenario


def text_of(name: str, changes: Sequence[str]) -> str:
    """Return the YAML text of a scenario of a shipped name or a path, with fields changed.

    changes : KEY=VALUE; the value as in a file, the key with dots into sections

    Raises InputError if the result is no scenario. Without changes it is the text of the file.
    """
    path = files.find('scenario', name)
    content = files.read_text(path)
    if not changes:
        return content
    with within(f'{path} with --set'):
        return changed(content, read(changes))


def read(changes: Sequence[str], example: str = 'mass_kg=12.0') -> dict[str, Any]:
    """Return field -> value of changes KEY=VALUE; raises InputError."""
    values = {}
    for change in changes:
        key, equals, value = change.partition('=')
        key = key.strip()
        if not equals or not key.rpartition('.')[2]:
            raise InputError(f'`--set` must be KEY=VALUE, like {example}; got {shown(change)}')
        with within(f'`{key}`'):
            values[key] = files.parse_yaml(value)
    return values


def changed(content: str, changes: Mapping[str, Any]) -> str:
    """Return the YAML text of a scenario with fields changed; raises InputError if it is none.

    changes : field, with dots into sections -> its new value; the name says that it is changed
    """
    document = files.parse_yaml(content)
    if isinstance(document, dict) and isinstance(document.get('name'), str):
        document['name'] = document['name'].removesuffix(CHANGED) + CHANGED
    for key, value in changes.items():
        _apply(document, key, value)
    try:
        scenario.parse(document)
    except InputError as error:
        raise InputError(f'{error}{_elsewhere(changes, files.parse_yaml(content))}') from None
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=100)


def load(name: str, changes: Sequence[str]) -> Scenario:
    """Return a single scenario with fields changed; raises InputError."""
    if not changes:
        return scenario.load_scenario(name)
    return scenario.single(files.loads(text_of(name, changes), scenario.parse, name), name)


def _elsewhere(changes: Iterable[str], document: Any) -> str:
    """Return the end of a sentence that says in which section a field is, if it was given alone."""
    for key in changes:
        found = [leaf for leaf in _leaves(document) if leaf.endswith(f'.{key}')]
        if found and key not in document:
            return f'; did you mean `{found[0]}`?'
    return ''


def _leaves(document: Any, prefix: str = '') -> Iterator[str]:
    """Yield the fields of a document and of its sections, with dots."""
    for key, value in document.items() if isinstance(document, dict) else ():
        yield from (f'{prefix}{key}', *_leaves(value, f'{prefix}{key}.'))


def _apply(document: Any, key: str, value: Any) -> None:
    """Change one field of a document; None removes it."""
    *sections, last = key.split('.')
    for section in sections:
        document = document.setdefault(section, {}) if isinstance(document, dict) else None
    if not isinstance(document, dict):
        raise InputError(f'`{key}` must name a field; a part of it has no fields')
    if value is None and last in document:
        del document[last]
    else:
        document[last] = value
