# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Stages of a chain in one C99 file, from their kernels and records: the bits that fly.

Each stage has a `struct` of settings, one of memory, the values of both, and `NAME_STAGE_step`. The
chain has `NAME_start`, and `NAME_tick`: one call per tick, on one array of signals, which are laid
out as `rpo_core.chain.driver` lays them out. Beside it are a header, and a program that flies the
ticks of a log again and compares.

A field of any length is an address and a count; its numbers are static, so where a memory has such
fields one flight at a time can be flown.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import resources
from pathlib import Path
from string import Template
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from rpo.exports import formats
from rpo.exports.c_source import Array, Record, Source, number, own_name, wrapped
from rpo.exports.formats import one_line
from rpo.montecarlo.outputs import identifier
from rpo_core.chain.chain import NO_FORCE, Chain, Link
from rpo_core.chain.driver import Driver
from rpo_core.chain.flight import Flight
from rpo_core.control.controller import AnyController
from rpo_core.files.validation import InputError, choice
from rpo_core.kernels import calls
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import as_table
from rpo_core.kernels.records import Field, class_of, fields_of, values_of
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import KernelStage, Place, Stage, has_kernel, places_of, width_of
from rpo_core.wire.interfaces import (
    CONTROL_FORCE,
    DISTURBANCE_FORCE,
    NEXT,
    RELATIVE_STATE,
    STATE,
    current,
    row_of,
)

ALL = 'all'
"""In the place of names of stages: the whole flight."""

_ONBOARD = (
    Place.ATTITUDE_ESTIMATOR, Place.ESTIMATOR, Place.GUIDANCE, Place.POINTING, Place.CONTROLLER,
    Place.SHAPING, Place.ASSURANCE, Place.STEERING, Place.UNLOADING,
)  # fmt: skip

_STATES = 240

_PUBLIC = re.compile(r'^(/\*(?:(?!\*/).)*\*/\n(?:void|int) [^{;]*)\n\{', re.M | re.S)
"""Comment and prototype of a function that is not static."""


@cache
def _templates() -> dict[str, Template]:
    text = resources.files('rpo.exports').joinpath('c.template').read_text('utf-8')
    parts = re.split(r'^@@ (\w+)\n', text, flags=re.MULTILINE)[1:]
    texts = (Template(text.removesuffix('\n')) for text in parts[1::2])
    return dict(zip(parts[::2], texts, strict=True))


def _filled(part: str, **values: object) -> str:
    """Return a part of `c.template`, its places `$name` filled with values."""
    return _templates()[part].substitute(values)


class Flown(NamedTuple):
    """Ticks (n,) that were flown, and signals (n, width) by name, those that are known."""

    ticks: Sequence[int]
    signals: Mapping[str, Floats]

    def of(self, name: str) -> Floats:
        """Return a signal; of the tick before it is zero at first. Raises InputError."""
        if current(name) not in self.signals:
            raise InputError(f'the log must have `{name}`, which a stage reads; it has not')
        values = self.signals[current(name)]
        if current(name) == name:
            return values
        return np.vstack([np.zeros_like(values[:1]), values[:-1]])


class Files(NamedTuple):
    """A source file in C, its header, a program that compares, and the ticks that it compares."""

    source: str
    header: str
    test: str
    ticks: str


class _Values:
    """Values of records as initialisers, and the static arrays that they point to.

    is_const : whether they stay as they are; otherwise each array has a copy to begin with
    """

    def __init__(self, source: Source, is_const: bool) -> None:
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
        self.arrays.append(f'static {head} {begun}[{len(flat)}] = {values_text};')
        return f'{{{name}, {", ".join(map(str, sizes))}}}'

    def _part(self, base: Any, values: Any, depth: int, name: str) -> str:
        if not depth:
            is_number = base in (float, int)
            return number(base(values)) if is_number else self.record(base, values, name)
        texts = [self._part(base, v, depth - 1, f'{name}_{i}') for i, v in enumerate(values)]
        zero = texts[0] if set(texts) <= {'0.0', '0', '{0.0}', '{0}'} else ''
        size = 4 if base in (float, int) else 1
        rows = (', '.join(texts[i : i + size]) for i in range(0, len(texts), size))
        text = zero or ',\n    '.join(rows)
        return f'{{{text}}}'


class _Stage(NamedTuple):
    """A stage in C: its names; types of settings and memory; values; what begins its memory.

    name : of its memory in that of the chain
    """

    name: str
    title: str
    settings: str
    memory: str
    values: list[str]
    copies: list[str]


def _stage(source: Source, link: Link, prefix: str, name: str, flown: Flown) -> _Stage:
    """Write a stage, with its tables for the ticks; raises InputError if they need a flight."""
    stage, reads = link.stage, link.reads
    if not has_kernel(stage):
        raise InputError(f'{type(stage).__name__} has no kernel')
    title, settings, memory = f'{prefix}_{name}', class_of(stage.p), class_of(stage.m)
    inner = _inner(source, stage, title, flown)
    begun = [n for n in reads if n in flown.signals]
    stage.answer_ahead(flown.ticks[-1], [float(v) for n in begun for v in flown.of(n)[0]])
    p, m = values_of(stage.p), values_of(stage.m)
    if inner is not None:  # C knows it by its name
        p = SimpleNamespace(**{f.name: getattr(p, f.name) for f in fields_of(settings)})
        p.step, p.settings, p.memory = 1, 0, 0
    u, y = (
        Array(float, (sum(width_of(current(n)) if n else 3 for n in names),), names is reads)
        for names in (reads, stage.outputs)
    )
    given = 'int', u, Record(settings, True), Record(memory, False), y
    source.function(type(stage).kernel, given, f'{title}_step')
    types = source.struct(settings, True), source.struct(memory, False)
    fixed, memory_values = _Values(source, True), _Values(source, False)
    of_settings = fixed.record(settings, p, f'{title}_p')
    of_memory = memory_values.record(memory, m, f'{title}_m')
    values = [
        *fixed.arrays,
        wrapped(f'const {types[0]} {title}_p = {of_settings};'),
        *memory_values.arrays,
        wrapped(f'const {types[1]} {title}_m0 = {of_memory};'),
    ]
    copies = [*memory_values.copies, f'm->{name} = {title}_m0;']
    if inner is not None:
        values = [*inner.values, *values]
        copies += [*inner.copies[:-1], f'{inner.title}_m = {inner.title}_m0;']
    return _Stage(name, title, *types, values, copies)


def _inner(source: Source, stage: KernelStage, title: str, flown: Flown) -> _Stage | None:
    """Write the stage whose kernel another one calls by its address; return it, if there is one."""
    inner = getattr(stage, 'inner', None)
    source.inner = ''
    if inner is None:
        return None
    written = _stage(source, Link(Place.CONTROLLER, inner, inner.inputs), title, 'law', flown)
    source.declare(f'extern const {written.settings} {written.title}_p;')
    source.declare(f'static {written.memory} {written.title}_m;')
    source.inner = written.title
    return written


def _refused(chain: Chain, stage: Stage, why: str) -> str:
    """Return that a stage cannot be C, and which others can."""
    others = ','.join(link.stage.name for link in chain.links if link.stage is not stage)
    instead = f'; `--stages {others}` exports the others' if others else ''
    return f'stage `{stage.name}` cannot be C: {why}{instead}'


def files(about: Sequence[str], chain: Chain, file: str, flown: Flown) -> Files:
    """Return the C of the stages of a chain; raises InputError.

    about : lines that say what it is
    file : name of the source file; names in C begin with it
    flown : ticks whose states the tables of the stages reach to, and that the program compares
    """
    stem, source, places = Path(file).stem, Source(), Driver(chain).places
    prefix = identifier(stem)
    chain.reset()
    stages: list[_Stage] = []
    for i, link in enumerate(chain.links):
        title = identifier(link.stage.name)
        title = f'{title}_{i}' if any(title == s.name for s in stages) else title
        try:
            stages.append(_stage(source, link, prefix, title, flown))
        except InputError as error:
            raise InputError(_refused(chain, link.stage, str(error))) from None
    begin = [f'    {line}' for s in stages for line in s.copies]
    tick = [
        _call(s, i, [places[n] for n in link.reads], places[link.stage.outputs[0]].start)
        for i, (s, link) in enumerate(zip(stages, chain.links, strict=True), 1)
    ]
    tick += [
        f'    s[{at.start + i}] = s[{places[current(n)].start + i}];'
        for n, at in places.items()
        if current(n) != n and current(n) in places
        for i in range(at.stop - at.start)
    ]
    room = max(at.stop for at in places.values())
    widest = max(sum(places[n].stop - places[n].start for n in link.reads) for link in chain.links)
    begin_text, tick_text = '\n'.join(begin), '\n'.join(tick)
    functions = _filled('chain', name=prefix, start=begin_text, tick=tick_text, room=room)
    inputs = _inputs(chain)
    facts = '\n'.join(wrapped(f'/* {one_line(line)} */') for line in about)
    of_chain = [_memory(prefix, stages), _places(prefix, places, room + widest)]
    includes = '\n'.join(f'#include <std{word}.h>' for word in ('int', 'lib'))
    text = _filled(
        'source',
        facts=facts,
        kernels=f'{includes}\n#include <string.h>\n\n{source.text()}',
        functions='\n\n'.join([*of_chain, *(v for s in stages for v in s.values), functions]),
    )
    values = [
        f'extern const {record} {s.title}_{word};'
        for s in stages
        for record, word in ((s.settings, 'p'), (s.memory, 'm0'))
    ]
    heads = [f'{head};' for head in _PUBLIC.findall(text)]
    names = {
        'facts': facts, 'name': prefix, 'size': f'{prefix.upper()}_SIGNALS',
        'stem': stem.replace('*/', '* /'),
    }  # fmt: skip
    header = _filled(
        'header',
        **names,
        guard=f'{prefix.upper()}_H',
        inputs=_listed(inputs),
        outputs=_listed(chain.outputs),
        prototypes='\n\n'.join(
            ['#include <stdint.h>', source.types(), *of_chain, '\n'.join(values), *heads]
        ),
    )
    sides = enumerate((inputs, chain.outputs))
    compared = [(name, places[name], i) for i, names_of in sides for name in names_of]
    test = _filled(
        'test',
        **names,
        signals=',\n'.join(
            f'    {{"{n}", {at.start}, {at.stop - at.start}, {i}}}' for n, at, i in compared
        ),
        count=len(compared),
        stages=wrapped(', '.join(f'"{s.name}"' for s in stages), 1),
    )
    return Files(text, header, test, _ticks(chain, flown))


def _inputs(chain: Chain) -> list[str]:
    """Return what a chain reads and does not keep itself from one tick to the next."""
    return [n for n in chain.inputs if current(n) == n or current(n) not in chain.outputs]


def _ticks(chain: Chain, flown: Flown) -> str:
    """Return what goes in and comes out, tick by tick; it ends where a stage cannot go on.

    What is not known of the ticks is computed: then C is compared with the kernels of Python.
    """
    number, ticks = len(flown.ticks), as_table(flown.ticks, np.int64)
    signals = {NO_FORCE: np.zeros((number, 3)), **flown.signals}
    known, count = flown._replace(signals=signals), number
    for link in chain.links:
        stage: Any = link.stage
        if not stage.asks and signals.keys() >= set(stage.outputs):
            continue
        read = as_table(np.hstack([*map(known.of, link.reads), np.empty((number, 0))]))
        places = places_of(stage.outputs)
        made = as_table(np.zeros((number, places[-1].stop)))
        count = calls.run_stage(*stage.row, 0, ticks[:count], read, made)
        for name, place in zip(stage.outputs, places, strict=True):
            signals.setdefault(name, np.asarray(made)[:, place])
    count = min(count, number - any(name in NEXT for name in chain.outputs))
    columns = [known.of(name)[:count] for name in _inputs(chain)]
    columns += [signals[n][1:][:count] if n in NEXT else signals[n][:count] for n in chain.outputs]
    rows = zip(flown.ticks, np.hstack(columns).tolist(), strict=False)
    return ''.join(f'{tick} {" ".join(map(float.hex, row))}\n' for tick, row in rows)


def _listed(names: Sequence[str]) -> str:
    """Return what signals mean, in lines of a comment."""
    lines = (f'{n} ({width_of(current(n))}): {one_line(row_of(n).meaning)}' for n in names)
    return '\n'.join(wrapped(f'   - {line}') for line in lines)


def _memory(name: str, stages: Sequence[_Stage]) -> str:
    lines = [f'    {stage.memory} {stage.name};' for stage in stages]
    head = f'/* What the stages remember; `{name}_start` begins a flight. */\ntypedef struct {{'
    return '\n'.join([head, *lines, f'}} {name}_memory;'])


def _places(name: str, places: dict[str, slice], room: int) -> str:
    """Return where each signal begins in the array of signals, and how many numbers that has.

    room : numbers of the array, with those for what a stage reads
    """
    words = {re.sub(r'\W+', '_', n or 'no_force').strip('_'): at.start for n, at in places.items()}
    words['signals'] = room
    texts = ', '.join(f'{name}_{word}'.upper() + f' = {at}' for word, at in words.items())
    return wrapped(f'enum {{ {texts} }};')


def _call(stage: _Stage, index: int, reads: Sequence[slice], writes: int) -> str:
    lines, end = [], 0
    for place in reads:
        size = place.stop - place.start
        lines.append(f'    memcpy(&u[{end}], &s[{place.start}], {size} * sizeof *u);')
        end += size
    call = f'{stage.title}_step(tick, u, &{stage.title}_p, &m->{stage.name}, &s[{writes}])'
    call = wrapped(f'if ({call} != 0) {{', 1)
    return _filled('call', u='\n'.join(lines), call=call, index=index)


def of_controller(controller: AnyController, file: str) -> Files:
    """Return the C of a controller alone; raises InputError.

    file : name of the source file
    """
    stage = controller.stage(controller.clock_s or 1.0)
    if stage.inputs != (STATE,):
        raise InputError(f'{controller.name} reads more than a state: export its scenario')
    draw = np.random.default_rng(1)
    states = np.round(draw.normal(size=(_STATES, 6)) * [30, 30, 30, 0.4, 0.4, 0.4], 3)
    ticks = np.arange(_STATES) * 17
    (forces,) = stage.steps(ticks, states)
    flown = Flown(ticks.tolist(), {RELATIVE_STATE: states, CONTROL_FORCE: forces})
    chain = Chain([Link(Place.CONTROLLER, stage, (RELATIVE_STATE,))])
    about = [*formats.facts(controller), *formats.GOAL]
    return files(about, chain, file, flown)


def of_flight(flight: Flight, controller: AnyController, file: str, stages: str = '') -> Files:
    """Return the C of stages of a flight, which the program flies again; raises InputError.

    stages : names, separated by commas; `ALL`; '': those on board
    """
    scenario, chain = flight.scenario, Chain.of(flight.scenario, controller)
    if stages != ALL:
        named = _named(stages, chain, scenario)
        chain = Chain([link for link in chain.links if link.stage.name in named])
    names = [link.stage.name for link in chain.links]
    for name in names:
        if flight.events.get(name):
            raise InputError(f'stage `{name}` got commands in flight; C gets none')
    signals = {
        **flight.signals, RELATIVE_STATE: flight.states, CONTROL_FORCE: flight.forces_n,
        DISTURBANCE_FORCE: flight.disturbances_n,
    }  # fmt: skip
    about = [f'{scenario.name} with {controller.name}: {", ".join(names)}', scenario.description]
    flown = Flown(list(range(len(flight.states))), signals)
    return files(about, chain, file, flown)


def _named(stages: str, chain: Chain, scenario: Scenario) -> list[str]:
    """Return the names of stages; '': those on board, of thrusters the allocation of a table."""
    if stages:
        known = [link.stage.name for link in chain.links]
        return [choice('--stages', name.strip(), known) for name in stages.split(',')]
    table = scenario.thrusters is not None and scenario.thrusters.table is not None
    places = (*_ONBOARD, Place.THRUSTERS) if table else _ONBOARD
    return [link.stage.name for link in chain.links if link.place in places]
