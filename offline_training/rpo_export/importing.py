# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Reading `.fis` and `.fll` files back, if they hold a system of the paper's shape.

Two inputs (position error, then velocity error) and one output, each of five triangles that mirror
about 0, and 25 rules joined by AND. Words go by the order of their peaks, whatever their names. The
outer peaks lie at -S and S; S other than 1 is that variable's scale in m, m/s, N. Inputs end at
the outer peaks, and the samples of the output too. Every key is read; what our inference has not is
refused by name.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rpo_core import files
from rpo_core.control.controller import FuzzyController
from rpo_core.control.fuzzy import (
    DEFAULT_SAMPLES,
    WORDS,
    FuzzySystem,
    MembershipFunctions,
    RuleTable,
    odd_samples,
)
from rpo_core.files.validation import InputError, choice, near, quoted, shown, within
from rpo_export.formats import SCALES

_SYMMETRY = 1e-9  # of a range: how far apart mirrored feet may be, for files with rounded numbers
_FACT = re.compile(r'\s*[%#]\s*rpo:\s*(\w+)\s*=\s*(\S+)')

_Keys = Mapping[str, tuple[str | None, ...]]
"""Key of a file -> the values that our inference has, None: absent; empty: read elsewhere."""


@dataclass(frozen=True)
class FileVariable:
    """A variable as the file has it: range and (name, kind, parameters) of its terms.

    reach : where the range must end, as a multiple of the outer peak
    """

    name: str
    range: tuple[float, float]
    terms: tuple[tuple[str, str, tuple[float, ...]], ...]
    reach: float = 1.0


@dataclass(frozen=True)
class Description:
    """The content of a file before the check of its shape.

    rules : indices (position, velocity, force) of the terms
    facts : numbers that `rpo export` wrote into comments
    """

    name: str
    variables: tuple[FileVariable, ...]
    rules: tuple[tuple[int, int, int], ...]
    facts: dict[str, float]


def load(path: Path, scales: Sequence[float | None] = (None, None, None)) -> FuzzyController:
    """Return the controller of a `.fis` or `.fll` file.

    scales : position [m], velocity [m/s], force [N]; those that are None come from the file

    Raises
    ------
    InputError
        If the file cannot be read, has another format or another shape, or has no scale.
    """
    readers = {'.fis': read_fis, '.fll': read_fll}
    suffix = path.suffix.lower()
    with within(str(path)):
        read = readers[choice('file name suffix', suffix, readers)]
    content = files.read_text(path)
    with within(str(path)):
        return controller_of(read(content.removeprefix('\ufeff')), path.name, scales)


def facts_of(content: str) -> dict[str, float]:
    """Return the numbers that `rpo export` noted in comments."""
    found = filter(None, (_FACT.match(line) for line in content.splitlines()))
    return {
        fact[1]: number(fact[2], f'rpo: {fact[1]}')
        for fact in found
        if fact[1] in (*SCALES, 'samples')
    }


def number(text: str, place: str) -> float:
    """Return the finite number of a text; raises InputError."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f'{quoted(place)} must be a finite number; got {shown(text)}')
    return value


def controller_of(
    described: Description, source: str, scales: Sequence[float | None]
) -> FuzzyController:
    """Return the controller that a file describes; raises InputError if it has another shape."""
    normalised = []
    for variable in described.variables:
        with within(f'variable {quoted(variable.name)}'):
            normalised.append(_normalised(variable))
    parts, sizes, orders = zip(*normalised, strict=True)
    facts = described.facts
    samples = facts.get('samples', float(DEFAULT_SAMPLES))
    system = FuzzySystem(
        parts[0],
        parts[1],
        parts[2],
        rules=_table(described.rules, orders),
        samples=int(samples) if samples.is_integer() else odd_samples('samples', samples),
    )
    chosen: list[float] = []
    for name, option, size in zip(SCALES, scales, sizes, strict=True):
        said = facts.get(name) if size == 1.0 else size
        found = said if option is None else option
        if found is None:
            raise InputError(f'does not say `{name}`: give --{name.partition("_")[0]}-scale')
        chosen.append(found)
    position, velocity, force = chosen
    provenance = {'method': 'imported', 'file': source}
    return FuzzyController(described.name, system, position, velocity, force, provenance=provenance)


def _normalised(variable: FileVariable) -> tuple[MembershipFunctions, float, list[int]]:
    """Return functions on [-1, 1], the size S, and the term indices in the order of `WORDS`."""
    if len(variable.terms) != 5:
        raise InputError(f'must have 5 terms; it has {len(variable.terms)}')
    for name, kind, points in variable.terms:
        if kind not in ('trimf', 'Triangle') or len(points) != 3:
            raise InputError(
                f'term {quoted(name)} must be a triangle of 3 points; got {kind} {list(points)}'
            )
        if not points[0] <= points[1] <= points[2]:
            raise InputError(
                f'term {quoted(name)} must have its feet on both sides of its peak: left foot, '
                f'peak, right foot; got {list(points)}'
            )
    order = sorted(range(5), key=lambda i: variable.terms[i][2][1])
    feet = np.array([variable.terms[i][2] for i in order])
    size, reach = float(feet[4, 1]), variable.reach
    ends = np.array([-size, size]) * reach
    if not (size > 0.0 and np.abs(ends - variable.range).max() <= _SYMMETRY * size):
        wanted, more = '[-S, S]', ''
        if reach > 1.0:
            wanted, more = f'[{-reach:g} S, {reach:g} S]', ', half a cell of the `defuzzifier` more'
        raise InputError(
            f'`range` must be {wanted} with the outer peaks at -S and S{more}; '
            f'got {list(variable.range)} and peaks at {feet[0, 1]:g} and {size:g}'
        )
    if reach > 1.0 and (feet[0, 0] > ends[0] or feet[4, 2] < ends[1]):
        outer = ' and '.join(quoted(variable.terms[order[i]][0]) for i in (0, 4))
        raise InputError(
            f'terms {outer} must have their outer feet outside the range, like {2.0 * ends[0]:g} '
            f'and {2.0 * ends[1]:g}: the outer samples lie at the peaks but for rounding'
        )
    return _functions(feet / size, [variable.terms[i][0] for i in order]), size, order


def _functions(feet: NDArray[np.float64], names: list[str]) -> MembershipFunctions:
    """Return the functions of triangles (5, 3) on [-1, 1]; raises InputError if they differ."""
    mirror = -feet[::-1, ::-1]
    feet[[0, 4], [0, 2]] = mirror[[0, 4], [0, 2]] = -2.0, 2.0  # outside: no matter where they are
    for name, own, other in zip(names, feet, mirror, strict=True):
        if np.abs(own - other).max() > _SYMMETRY:
            raise InputError(f'term {quoted(name)} must mirror its opposite about 0; it does not')
    (_, z, half), (left, centre, right), (large, peak, _) = feet[2:].tolist()
    if z != 0.0 or peak != 1.0:
        raise InputError('its middle and outer terms must peak at 0 and at the ends of the range')
    return MembershipFunctions(half, left, centre, right, large)


def _table(rules: Sequence[tuple[int, int, int]], orders: Sequence[list[int]]) -> RuleTable:
    """Return the rule table; a rule has the index of a term in the order of each variable."""
    codes = np.full((5, 5), -1)
    for rule in rules:
        column, row, word = (order.index(i) for order, i in zip(orders, rule, strict=True))
        if codes[row, column] >= 0:
            raise InputError(
                f'must have one rule for each pair of words; (velocity {WORDS[row]}, position '
                f'{WORDS[column]}) has two'
            )
        codes[row, column] = word
    if (codes < 0).any():
        raise InputError(f'must have 25 rules; it has {len(rules)}')
    return RuleTable.from_codes(codes)


def _expected(keys: Mapping[str, str], known: _Keys) -> None:
    """Check that keys are known, and have values that our inference has; raises InputError."""
    for key in keys:
        if key not in known:
            raise InputError(f'{quoted(key)} is not a known key{near(key, known)}')
    for key, values in known.items():
        if values and keys.get(key) not in values:
            wanted = ' or '.join(value for value in values if value is not None)
            got = shown(keys[key]) if key in keys else 'no such key'
            raise InputError(f'`{key}` must be {wanted}; got {got}')


def _once(found: dict[str, str], key: str, value: str) -> None:
    if key in found:
        raise InputError(f'{quoted(key)} must stand once; it stands twice')
    found[key] = value


_SECTION = re.compile(r'\[(\w+)\]')
_MF = re.compile(r"'(.*)'\s*:\s*'(\w+)'\s*,\s*\[(.*)\]")
_RULE = re.compile(r'(\d{1,9})\s+(\d{1,9})\s*,\s*(\d{1,9})\s*\((.+)\)\s*:\s*1')
_MFS = tuple(f'MF{i}' for i in range(1, 6))
_SYSTEM: _Keys = {
    'Name': (),
    'Type': ('mamdani',),
    'Version': ('2.0', '2', None),
    'NumInputs': ('2', None),
    'NumOutputs': ('1', None),
    'NumRules': ('25', None),
    'AndMethod': ('min',),
    'OrMethod': ('max', None),
    'ImpMethod': ('min',),
    'AggMethod': ('max',),
    'DefuzzMethod': ('centroid',),
}
_VARIABLE: _Keys = {'Name': (), 'Range': (), 'NumMFs': ('5', None), **dict.fromkeys(_MFS, ())}


def read_fis(content: str) -> Description:
    """Return the description of a MATLAB `.fis` text; raises InputError."""
    sections: dict[str, dict[str, str]] = {'': {}}
    rules: list[tuple[int, int, int]] = []
    current = ''
    for line in _lines(content, '%'):
        section = _SECTION.fullmatch(line)
        if section:
            current = section[1]
            if current in sections:
                raise InputError(f'section [{current}] must stand once; it stands twice')
            sections[current] = {}
        elif current == 'Rules':
            rules.append(_fis_rule(line))
        else:
            key, equals, value = line.partition('=')
            if not equals:
                raise InputError(f'not a .fis line: {shown(line)}')
            with within(f'[{current}]'):
                _once(sections[current], key.strip(), value.strip())
    system = sections.get('System')
    if system is None:
        raise InputError('not a .fis file: it has no [System]')
    names = [name for name in sections if name.startswith(('Input', 'Output'))]
    if sorted(names) != ['Input1', 'Input2', 'Output1']:
        raise InputError(
            f'must have two inputs and one output; it has {", ".join(names) or "none"}'
        )
    for name, keys in sections.items():
        if name not in ('', 'System', 'Rules', *names):
            raise InputError(f'section [{name}] is not known')
        known = {'': {}, 'Rules': {}, 'System': _SYSTEM}.get(name, _VARIABLE)
        with within(f'[{name}]'):
            _expected({key: _bare(value) for key, value in keys.items()}, known)
    return Description(
        name=_bare(system.get('Name', '')) or 'imported',
        variables=tuple(_fis_variable(sections[name]) for name in sorted(names)),
        rules=tuple(rules),
        facts=facts_of(content),
    )


def _lines(content: str, comment: str) -> list[str]:
    stripped = (line.partition(comment)[0].strip() for line in content.splitlines())
    return [line for line in stripped if line]


def _bare(text: str) -> str:
    return text.strip().strip('\'"')


def _numbers(text: str, place: str) -> tuple[float, ...]:
    return tuple(number(part, place) for part in re.split(r'[\s,]+', text.strip(' []')))


def _range(text: str, place: str) -> tuple[float, float]:
    numbers = _numbers(text, place)
    if len(numbers) != 2:
        raise InputError(f'{quoted(place)} must be two numbers; got {shown(text)}')
    return numbers[0], numbers[1]


def _fis_variable(section: dict[str, str]) -> FileVariable:
    name = _bare(section.get('Name', ''))
    terms = []
    for key in _MFS:  # rules number the words
        value = section.get(key, '')
        match = _MF.fullmatch(value)
        if not match:
            raise InputError(f"`{key}` must be like 'LN':'trimf',[-2 -1 0]; got {shown(value)}")
        terms.append((match[1], match[2], _numbers(match[3], key)))
    return FileVariable(name, _range(section.get('Range', ''), f'{name}.Range'), tuple(terms))


def _fis_rule(line: str) -> tuple[int, int, int]:
    match = _RULE.fullmatch(line)
    indices = [int(i) for i in match.groups()[:3]] if match else []
    if not match or number(match[4], 'weight') != 1.0 or not all(1 <= i <= 5 for i in indices):
        raise InputError(
            'a rule must be like `1 2, 3 (1) : 1`: words 1 to 5, weight 1, joined by AND; '
            f'got {shown(line)}'
        )
    return indices[0] - 1, indices[1] - 1, indices[2] - 1


_BLOCKS: dict[str, _Keys] = {
    'Engine': {'description': ()},
    'InputVariable': {
        'description': (),
        'enabled': ('true', None),
        'range': (),
        'lock-range': ('true',),  # else the grade of an outer word falls beyond its peak
        'term': (),
    },
    'OutputVariable': {
        'description': (),
        'enabled': ('true', None),
        'range': (),
        'lock-range': ('true', 'false', None),
        'aggregation': ('Maximum',),
        'defuzzifier': (),
        'default': (),
        'lock-previous': ('false', None),
        'term': (),
    },
    'RuleBlock': {
        'description': (),
        'enabled': ('true', None),
        'conjunction': ('Minimum',),
        'disjunction': ('none', 'Maximum', None),  # no rule has an OR
        'implication': ('Minimum',),
        'activation': ('General',),
        'rule': (),
    },
}


def read_fll(content: str) -> Description:
    """Return the description of a FuzzyLite `.fll` text; raises InputError."""
    blocks: list[tuple[str, str, dict[str, str], list[str]]] = []
    for line in _lines(content, '#'):
        key, colon, value = line.partition(':')
        key, value = key.strip(), value.strip()
        if not colon:
            raise InputError(f'not a .fll line: {shown(line)}')
        if key in _BLOCKS:
            blocks.append((key, value, {}, []))
        elif not blocks:
            raise InputError(f'not a .fll file: it starts with {shown(line)}')
        elif key in ('term', 'rule') and key in _BLOCKS[blocks[-1][0]]:
            blocks[-1][3].append(value)
        else:
            with within(f'{blocks[-1][0]} {quoted(blocks[-1][1])}'):
                _once(blocks[-1][2], key, value)
    kinds = [kind for kind, *_ in blocks]
    if sorted(kinds) != sorted([*_BLOCKS, 'InputVariable']):
        raise InputError(
            'must be one Engine with two InputVariables, one OutputVariable and one RuleBlock; '
            f'it has {", ".join(kinds) or "none"}'
        )
    for kind, name, keys, _ in blocks:
        with within(f'{kind} {quoted(name)}'):
            _expected(keys, _BLOCKS[kind])
    blocks.sort(key=lambda block: list(_BLOCKS).index(block[0]))
    engine, *variables, rules = blocks
    facts, output = facts_of(content), variables[2][2]
    samples = _samples(output.get('defuzzifier', ''))
    if facts.setdefault('samples', float(samples)) != samples:
        raise InputError(
            f'`defuzzifier` must have the samples of the comment `rpo: samples`, '
            f'{facts["samples"]:g}; got {shown(output["defuzzifier"])}'
        )
    if not re.fullmatch(r'-?0+(\.0*)?', output.get('default', '')):
        raise InputError(
            '`default` must be 0.0, our output where no rule fires; '
            f'got {shown(output.get("default", "no such key"))}'
        )
    reaches = 1.0, 1.0, 1.0 + 1.0 / (samples - 1)
    described = tuple(
        _fll_variable(name, keys, terms, reach)
        for (_, name, keys, terms), reach in zip(variables, reaches, strict=True)
    )
    return Description(
        name=engine[1] or 'imported',
        variables=described,
        rules=tuple(_fll_rule(rule, described) for rule in rules[3]),
        facts=facts,
    )


def _samples(defuzzifier: str) -> int:
    """Return the samples of FuzzyLite's centroid; raises InputError."""
    match = re.fullmatch(r'Centroid\s+(\d{1,6})', defuzzifier, re.ASCII)
    if not match or int(match[1]) % 2 == 0 or int(match[1]) < 3:
        raise InputError(
            '`defuzzifier` must be Centroid with an odd number of samples, so that 0 is one of '
            f'them, like `Centroid {DEFAULT_SAMPLES}`; got {shown(defuzzifier)}'
        )
    return int(match[1])


def _fll_variable(
    name: str, keys: dict[str, str], values: Sequence[str], reach: float
) -> FileVariable:
    terms = []
    for value in values:
        label, kind, numbers = (*value.split(maxsplit=2), '', '', '')[:3]
        terms.append((label, kind, _numbers(numbers, f'{name}.{label}')))
    if len({label for label, _, _ in terms}) < len(terms):
        raise InputError(f'the terms of {quoted(name)} must have different names')
    place = f'{name}.range'
    return FileVariable(name, _range(keys.get('range', ''), place), tuple(terms), reach)


def _fll_rule(rule: str, variables: tuple[FileVariable, ...]) -> tuple[int, int, int]:
    terms = [{name: i for i, (name, _, _) in enumerate(v.terms)} for v in variables]
    clauses = re.fullmatch(r'if (\w+) is (\w+) and (\w+) is (\w+) then (\w+) is (\w+)', rule)
    parts = clauses.groups() if clauses else ()
    word_of = dict(zip(parts[::2], parts[1::2], strict=True))
    words = [word_of.get(variable.name, '') for variable in variables]
    if len(word_of) != 3 or any(
        word not in known for word, known in zip(words, terms, strict=True)
    ):
        raise InputError(
            'a rule must be like `if A is P and B is Q then F is R`, of terms that the file has; '
            f'got {shown(rule)}'
        )
    position, velocity, force = (known[w] for known, w in zip(terms, words, strict=True))
    return position, velocity, force
