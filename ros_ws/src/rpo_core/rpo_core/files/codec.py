# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Between mappings of YAML files and frozen dataclasses, whose `__post_init__` checks the values.

A field without default is required. A field that is itself a dataclass, or a tuple of one, is
written as a mapping or a list of mappings.
"""

from __future__ import annotations

from collections.abc import Collection
from contextlib import nullcontext
from dataclasses import MISSING, field, fields, is_dataclass
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from rpo_core.files.validation import InputError, mapping, shown, within

Record = TypeVar('Record')


def unless_default(default: Any) -> Any:
    """Return a field of a dataclass that `to_mapping` leaves out where it has its default."""
    return field(default=default, metadata={'written': 'unless it is the default'})


def from_mapping(
    kind: type[Record], place: str, value: Any, *, needed: Collection[str] = ()
) -> Record:
    """Return a dataclass of a mapping; `place` is the mapping's name in errors.

    needed : fields that must be there although they have a default

    Raises InputError that names a missing, unknown or bad field.
    """
    known = [f for f in fields(kind) if f.init]  # type: ignore[arg-type]
    must = [
        f.name
        for f in known
        if f.name in needed or (f.default is MISSING and f.default_factory is MISSING)
    ]
    data = mapping(place, value, must, [f.name for f in known if f.name not in must])
    hints = get_type_hints(kind)
    prefix = f'{place}.' if place else ''
    values = {name: _nested(hints[name], f'{prefix}{name}', item) for name, item in data.items()}
    with within(place) if place else nullcontext():
        return kind(**values)


def _nested(hint: Any, place: str, value: Any) -> Any:
    """Return the value of a field, made a dataclass where its type is one."""
    if isinstance(hint, type) and is_dataclass(hint):
        return from_mapping(hint, place, value)
    inner = get_args(hint)
    if type(None) in inner and value is not None and is_dataclass(inner[0]):
        return _nested(inner[0], place, value)
    if get_origin(hint) is tuple and inner and is_dataclass(inner[0]):
        if not isinstance(value, list):
            raise InputError(f'`{place}` must be a list; got {shown(value)}')
        return tuple(_nested(inner[0], f'{place}[{i}]', item) for i, item in enumerate(value))
    return value


def to_mapping(record: Any) -> Any:
    """Return a dataclass as what YAML has: mappings, lists, texts and numbers.

    One that has a form of its own says it by `to_document`.
    """
    if hasattr(record, 'to_document'):
        return record.to_document()
    if is_dataclass(record) and not isinstance(record, type):
        return {
            f.name: to_mapping(getattr(record, f.name))
            for f in fields(record)
            if f.init and not (f.metadata and getattr(record, f.name) == f.default)
        }
    if isinstance(record, dict):
        return {key: to_mapping(item) for key, item in record.items()}
    return [to_mapping(item) for item in record] if isinstance(record, (list, tuple)) else record
