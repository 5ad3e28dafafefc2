# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Stages of a chain in one C99 file, from their kernels and records: the bits that fly.

Each stage has a `struct` of settings, one of memory, the values of both, and `NAME_STAGE_step`. The
chain has `NAME_start`, and `NAME_tick`: one call per tick, on one array of signals, which are laid
out as `rpo_core.chain.driver` lays them out.

A field of any length is an address and a count; its numbers are static, so where a memory has such
fields one flight at a time can be flown.
"""

from __future__ import annotations

import ast
import inspect
import math
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

from rpo.exports.c import PUBLIC, Files
from rpo.exports.c_source import Source, number, own_name, wrapped
from rpo.exports.formats import filled
from rpo.exports.kernel_source import Array, Record, Type
from rpo.montecarlo.outputs import identifier
from rpo_core.chain.chain import Chain, Link
from rpo_core.chain.driver import Driver
from rpo_core.files.validation import InputError
from rpo_core.kernels.records import Field, class_of, fields_of, values_of
from rpo_core.stage import has_kernel, width_of
from rpo_core.wire.interfaces import current

_OPERATORS = {ast.FloorDiv: 'int64_floor', ast.Mod: 'int64_modulo'}

_FUNCTIONS = {
    'int64_floor': """static int64_t int64_floor(int64_t a, int64_t b)
{
    return a / b - (a % b != 0 && (a < 0) != (b < 0));
}""",
    'int64_modulo': """static int64_t int64_modulo(int64_t a, int64_t b)
{
    const int64_t rest = a % b;
    return rest != 0 && (rest < 0) != (b < 0) ? rest + b : rest;
}""",
    'int64_product': """static int64_t int64_product(int64_t a, int64_t b)
{
    return (int64_t)((uint64_t)a * (uint64_t)b); /* it may wrap around */
}""",
}


class RecordSource(Source):
    """C99 source of kernels that take records; whole numbers have 64 bits."""

    wide = True

    def __init__(self) -> None:
        super().__init__()
        self._structs: dict[tuple[Any, bool], str] = {}
        self.typedefs: dict[str, str] = {}

    def operator(self, operator: type[ast.operator], is_long: bool) -> str:
        """Return the function that stands for an operator of whole numbers, '' for none."""
        return 'int64_product' if operator is ast.Mult and is_long else _OPERATORS.get(operator, '')

    def field(self, record: Any, name: str) -> Type:
        """Return the type of a field of a record."""
        field = next(field for field in fields_of(record.base) if field.name == name)
        if field.shape and record.is_value:
            return ('double',) * (field.shape[0] or 0)
        if field.shape:
            return Array(field.base, field.shape, record.is_const)
        if field.base in (float, int):
            return 'double' if field.base is float else 'int'
        return Record(field.base, record.is_const)

    def declared(self, type_: Type, name: str, fixed: bool = False) -> str:
        """Return a declaration of a name; fixed : it is written once."""
        if not isinstance(type_, Array) or None in type_.shape:
            fixed = fixed and (not isinstance(type_, Record) or type_.is_value)
            return super().declared(type_, name, fixed)
        const = 'const ' if type_.is_const else ''
        sizes = ''.join(f'[{n}]' for n in type_.shape[1:])
        place = f'(*{name}){sizes}' if sizes else f'*{name}'
        return f'{const}{self._base(type_.base, type_.is_const)} {place}'

    def spelled(self, type_: Type) -> str:
        """Return a type as C has it."""
        if type_ == 'int':
            return 'int64_t'
        if isinstance(type_, Record) and type_.is_value:
            return self._value_struct(type_)
        if isinstance(type_, Record):
            const = 'const ' if type_.is_const else ''
            return f'{const}{self.struct(type_.base, type_.is_const)} *'
        if isinstance(type_, Array):
            if None not in type_.shape:
                return self.declared(type_, '')
            return self._list(type_.base, len(type_.shape), type_.is_const)
        return super().spelled(type_)

    def _value_struct(self, record: Record) -> str:
        """Return the name of the struct of a named tuple that a kernel makes: it has no arrays."""
        fields = fields_of(record.base)
        if not any(field.shape for field in fields):
            return self.struct(record.base, True)
        types = ((f.name, self.spelled(self.field(record, f.name))) for f in fields)
        name = f'{record.base.__name__}_value'
        self._tuples[name] = ' '.join(f'{spelled} {own_name(f)};' for f, spelled in types)
        return name

    def struct(self, record: Any, is_const: bool) -> str:
        """Return the name of a record's struct; what arrays of any length hold may be const."""
        key = record, is_const or not _has_lists(record)
        if key not in self._structs:
            lines = [f'    {self._member(field, is_const)};' for field in fields_of(record)]
            name, taken = own_name(record.__name__), self.typedefs
            name = f'{name}_{len(taken)}' if name in taken else name
            self._structs[key] = name
            about = (inspect.getdoc(record) or '').replace('*/', '* /')
            body = '\n'.join(['typedef struct {', *lines, f'}} {name};'])
            self.typedefs[name] = f'/* {about} */\n{body}' if about else body
        return self._structs[key]

    def _base(self, base: Any, is_const: bool) -> str:
        if base in (float, int):
            return 'double' if base is float else 'int64_t'
        return self.struct(base, is_const)

    def _member(self, field: Field, is_const: bool) -> str:
        if not field.is_fixed:
            return f'{self._list(field.base, len(field.shape), is_const)} {own_name(field.name)}'
        sizes = ''.join(f'[{n}]' for n in field.shape)
        return f'{self._base(field.base, is_const)} {own_name(field.name)}{sizes}'

    def _list(self, base: Any, dimensions: int, is_const: bool) -> str:
        """Return the name of the struct of an array of any length."""
        of = self._base(base, is_const)
        const, words = ('const ', 'const_') if is_const else ('', '')
        name = f'{words}{of}_{"rows" if dimensions > 1 else "list"}'
        counts = 'count, width' if dimensions > 1 else 'count'
        self.typedefs[name] = f'typedef struct {{ {const}{of} *at; int64_t {counts}; }} {name};'
        return name

    def text(self) -> str:
        """Return types, constants and functions, each before what needs it."""
        body = super().text()
        functions = [text for name, text in _FUNCTIONS.items() if f'{name}(' in body]
        return '\n\n'.join([self.types(), *functions, body])

    def types(self) -> str:
        """Return the structs."""
        return '\n\n'.join(self.typedefs.values())


def _has_lists(record: Any) -> bool:
    return any(
        not field.is_fixed or (field.base not in (float, int) and _has_lists(field.base))
        for field in fields_of(record)
    )


class _Values:
    """Values of records as initialisers, and the static arrays that they point to.

    is_const : whether they stay as they are; otherwise each array has a copy to begin with
    """

    def __init__(self, source: RecordSource, is_const: bool) -> None:
        self._source, self._is_const = source, is_const
        self.arrays: list[str] = []
        self.copies: list[str] = []

    def record(self, base: Any, values: Any, name: str) -> str:
        """Return the values of a record; name : of its arrays."""
        parts = (
            f'.{own_name(f.name)} = {self._field(f, getattr(values, f.name), f"{name}_{f.name}")}'
            for f in fields_of(base)
        )
        return f'{{{", ".join(parts)}}}'

    def _field(self, field: Field, values: Any, name: str) -> str:
        depth = len(field.shape)
        if field.is_fixed:
            return self._part(field.base, values, depth, name)
        sizes = [len(values)] + ([len(values[0]) if len(values) else 0] if depth > 1 else [])
        flat = [value for row in values for value in row] if depth > 1 else list(values)
        if not flat:
            return f'{{{", ".join(["0", *map(str, sizes)])}}}'
        values_text = self._part(field.base, flat, 1, name)
        array = Array(field.base, (0,), self._is_const)
        head, begun = self._source.declared(array, '').removesuffix(' *'), name
        if not self._is_const:
            self.arrays.append(f'static {head} {name}[{len(flat)}];')
            head, begun = f'const {head}', f'{name}_begun'
            self.copies.append(f'memcpy({name}, {begun}, sizeof {name});')
        self.arrays.append(wrapped(f'static {head} {begun}[{len(flat)}] = {values_text};'))
        return f'{{{name}, {", ".join(map(str, sizes))}}}'

    def _part(self, base: Any, values: Any, depth: int, name: str) -> str:
        if not depth:
            is_number = base in (float, int)
            return _number(base(values)) if is_number else self.record(base, values, name)
        texts = [self._part(base, v, depth - 1, f'{name}_{i}') for i, v in enumerate(values)]
        zero = texts[0] if set(texts) <= {'0.0', '0', '{0.0}', '{0}'} else ''
        return f'{{{zero or ", ".join(texts)}}}'


def _number(value: Any) -> str:
    """Return a value of a record in C."""
    if math.isfinite(value):
        return number(value)
    return 'NAN' if math.isnan(value) else 'INFINITY' if value > 0.0 else '-INFINITY'


class _Stage(NamedTuple):
    """A stage in C: its name; types of settings and memory; values; what begins its memory."""

    name: str
    settings: str
    memory: str
    step: str
    values: list[str]
    copies: list[str]


def _stage(source: RecordSource, link: Link, chain: str, name: str) -> _Stage:
    stage = link.stage
    if not has_kernel(stage):
        raise InputError(
            f'stage `{stage.name}` must have a kernel to be C; {type(stage).__name__} has none'
        )
    title, kernel = f'{chain}_{name}', type(stage).kernel
    settings, memory = class_of(stage.p), class_of(stage.m)
    u, y = (
        Array(float, (sum(width_of(current(n)) if n else 3 for n in names),), names is link.reads)
        for names in (link.reads, stage.outputs)
    )
    given = 'int', u, Record(settings, True), Record(memory, False), y
    step = source.function(kernel, given, f'{title}_step')
    types = source.struct(settings, True), source.struct(memory, False)
    fixed, begun = _Values(source, True), _Values(source, False)
    of_settings = fixed.record(settings, values_of(stage.p), f'{title}_p')
    of_memory = begun.record(memory, values_of(stage.m), f'{title}_m')
    values = [
        *fixed.arrays,
        wrapped(f'const {types[0]} {title}_p = {of_settings};'),
        *begun.arrays,
        wrapped(f'const {types[1]} {title}_m0 = {of_memory};'),
    ]
    return _Stage(name, *types, step.name, values, begun.copies)


def files(name: str, chain: Chain, file: str) -> Files:
    """Return the C of the stages of a chain, and its header; raises InputError.

    name : what the names in C begin with; file : name of the source file
    """
    prefix, source, places = identifier(name), RecordSource(), Driver(chain).places
    chain.reset()
    stages: list[_Stage] = []
    for i, link in enumerate(chain.links):
        title = identifier(link.stage.name)
        title = f'{title}_{i}' if any(title == s.name for s in stages) else title
        stages.append(_stage(source, link, prefix, title))
    begin = [f'    {line}' for s in stages for line in s.copies]
    begin += [f'    m->{s.name} = {prefix}_{s.name}_m0;' for s in stages]
    tick = [
        _call(prefix, s, i, [places[n] for n in link.reads], places[link.stage.outputs[0]].start)
        for i, (s, link) in enumerate(zip(stages, chain.links, strict=True), 1)
    ]
    tick += [
        f'    s[{at.start + i}] = s[{places[current(n)].start + i}];'
        for n, at in places.items()
        if current(n) != n and current(n) in places
        for i in range(at.stop - at.start)
    ]
    functions = filled('chain', name=prefix, start='\n'.join(begin), tick='\n'.join(tick))
    facts = wrapped(f'/* stages of {name}: {", ".join(s.name for s in stages)} */')
    of_chain = [_memory(prefix, stages), _places(prefix, places)]
    includes = '\n'.join(f'#include <std{word}.h>' for word in ('int', 'lib'))
    text = filled(
        'source',
        facts=facts,
        kernels=f'{includes}\n#include <string.h>\n\n{source.text()}',
        functions='\n\n'.join([*of_chain, *(v for s in stages for v in s.values), functions]),
    )
    values = [
        f'extern const {record} {prefix}_{s.name}_{word};'
        for s in stages
        for record, word in ((s.settings, 'p'), (s.memory, 'm0'))
    ]
    heads = [f'{head};' for head in PUBLIC.findall(text)]
    header = filled(
        'header',
        facts=facts,
        source=file.replace('*/', '* /'),
        use=f'{prefix}_start(&memory); {prefix}_tick(tick, &memory, signals);',
        guard=f'{prefix.upper()}_H',
        prototypes='\n\n'.join(
            ['#include <stdint.h>', source.types(), *of_chain, '\n'.join(values), *heads]
        ),
    )
    return Files(text, header)


def _memory(name: str, stages: Sequence[_Stage]) -> str:
    lines = [f'    {stage.memory} {stage.name};' for stage in stages]
    head = f'/* What the stages remember; `{name}_start` begins a flight. */\ntypedef struct {{'
    return '\n'.join([head, *lines, f'}} {name}_memory;'])


def _places(name: str, places: dict[str, slice]) -> str:
    """Return where each signal begins in the array of signals, and how many numbers that has."""
    words = {re.sub(r'\W+', '_', n or 'no_force').strip('_'): at.start for n, at in places.items()}
    words['signals'] = max(at.stop for at in places.values())
    texts = ', '.join(f'{name}_{word}'.upper() + f' = {at}' for word, at in words.items())
    return wrapped(f'enum {{ {texts} }};')


def _call(name: str, stage: _Stage, index: int, reads: Sequence[slice], writes: int) -> str:
    at = [i for place in reads for i in range(place.start, place.stop)] or [0]
    u = ', '.join(f's[{i}]' for i in at)
    return filled(
        'call',
        u=wrapped(f'const double u[{len(at)}] = {{{u}}};', 2),
        call=wrapped(
            f'if ({stage.step}(tick, u, &{name}_{stage.name}_p, &m->{stage.name}, '
            f'&s[{writes}]) != 0) {{',
            2,
        ),
        index=index,
    )
