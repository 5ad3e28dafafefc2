# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels in C99: the same operations in the same order, so the same bits.

The constants and tables that the kernels read are known (`Source.record`): what they decide is
decided here, and the C source has only what is left.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from rpo_core.files.validation import InputError
from rpo_export import formats
from rpo_export.c_expressions import Written, number, own_name
from rpo_export.c_function import Writer, wrapped
from rpo_export.kernel_source import Type, plain, read, type_of_value

_TABLES = {
    'table': 'const double *at; int count;',
    'ints': 'const signed char *at; int count;',
    'rows': 'const double *at; int count; int width;',
}


class Source:
    """C99 source of some kernels, of what they call, and of the constants that they read."""

    def __init__(self) -> None:
        self._records: dict[type, tuple[str, Any]] = {}
        self._read: dict[type, dict[str, None]] = {}
        self._tuples: dict[str, str] = {}
        self._constants: dict[str, float] = {}
        self._functions: dict[Any, Written] = {}

    def record(self, name: str, value: Any) -> None:
        """Let kernels read a NamedTuple of numbers and tables; C has it under the name."""
        self._records[type(value)] = (name, value)

    def spelled(self, kind: Type) -> str:
        """Return a type as C has it."""
        if isinstance(kind, tuple):
            alike = set(kind) == {'double'}
            name = f'double{len(kind)}' if alike else 'all_' + ''.join(k[0] for k in kind)
            fields = ' '.join(f'{k} f{i};' for i, k in enumerate(kind))
            self._tuples[name] = f'double at[{len(kind)}];' if alike else fields
            return name
        return f'const {kind.__name__} *' if isinstance(kind, type) else str(kind)

    def constant(self, name: str, value: float) -> str:
        """Return the name of a constant of a module; raises InputError if two are different."""
        if self._constants.setdefault(name, value) != value:
            raise InputError(f'constant `{name}` must be one number in all kernels; got {value!r}')
        return name

    def field(self, record: type, name: str) -> Type:
        """Return the type of a field of a record, which is read."""
        self._read.setdefault(record, {})[name] = None
        return type_of_value(getattr(self._records[record][1], name))

    def function(self, kernel: Callable[..., Any], given: Sequence[Type] = ()) -> Written:
        """Return a kernel in C, written once; raises InputError if it cannot be."""
        function = plain(kernel)
        if function not in self._functions:
            constants = {kind: value for kind, (_, value) in self._records.items()}
            found = read(function, constants)
            name, taken = f'rpo_{function.__name__}', {w.name for w in self._functions.values()}
            name = f'{name}_{len(taken)}' if name in taken else name
            self._functions[function] = Writer(self, found, name, given).written()
        return self._functions[function]

    def text(self) -> str:
        """Return types, constants and functions, each before what needs it."""
        blocks = [
            *(block for kind in self._records for block in self._constants_of(kind)),
            *(written.text for written in self._functions.values()),
        ]
        body = '\n\n'.join(blocks)
        types = [
            *((name, fields) for name, fields in _TABLES.items() if f'{name} ' in body),
            *self._tuples.items(),
        ]
        lines = [f'typedef struct {{ {fields} }} {name};' for name, fields in types]
        return '\n\n'.join(filter(None, ['\n'.join(lines), self._numbers(), body]))

    def _numbers(self) -> str:
        whole = [f'{n} = {v}' for n, v in self._constants.items() if isinstance(v, int)]
        lines = [wrapped(f'enum {{ {", ".join(whole)} }};')] if whole else []
        real = {n: v for n, v in self._constants.items() if isinstance(v, float)}
        return '\n'.join([*lines, *(f'#define {n} {number(v)}' for n, v in real.items())])

    def _constants_of(self, kind: type) -> list[str]:
        name, value = self._records[kind]
        members: dict[str, list[str]] = {}
        given, arrays = [], []
        for field in self._read.get(kind, ()):
            found, own = getattr(value, field), own_name(field)
            typed = type_of_value(found)
            members.setdefault(typed, []).append(own)
            if typed in _TABLES:
                array = np.asarray(found)
                sizes = ', '.join(map(str, array.shape))
                given.append(f'    .{own} = {{{name}_{field}, {sizes}}},')
                arrays.append(_array(f'{name}_{field}', typed, array))
            else:
                given.append(f'    .{own} = {number(found)},')
        if not members:
            return []
        lines = [wrapped(f'{typed} {", ".join(names)};', 1) for typed, names in members.items()]
        return [
            *arrays,
            '\n'.join(['typedef struct {', *lines, f'}} {kind.__name__};']),
            '\n'.join([f'static const {kind.__name__} {name} = {{', *given, '};']),
        ]


def _array(name: str, kind: Type, array: Any) -> str:
    element = 'signed char' if kind == 'ints' else 'double'
    numbers = formats.listed(array.ravel(), 4, 96)
    return f'static const {element} {name}[{array.size}] = {{\n{numbers}}};'
