# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Reading `.fis` and `.fll` files back, if they hold a system of the paper's shape.

Two inputs (position error, then velocity error) and one output, each of five triangles that mirror
about 0, and 25 rules joined by AND. Words go by the order of their peaks, whatever their names. The
outer peaks lie at -S and S; S other than 1 is that variable's scale in m, m/s, N.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
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
from rpo_core.files.validation import InputError, choice, quoted, shown, within
from rpo_export.formats import SCALES

_SYMMETRY = 1e-9  # of a range: how far apart mirrored feet may be, for files with rounded numbers
_NORMS = {'and': 'min', 'implication': 'min', 'aggregation': 'max', 'defuzzification': 'centroid'}
_FACT = re.compile(r'[%#]\s*rpo:\s*(\w+)\s*=\s*(\S+)')


@dataclass(frozen=True)
class FileVariable:
    """A variable as the file has it: range and (name, kind, parameters) of its terms."""

    name: str
    range: tuple[float, float]
    terms: tuple[tuple[str, str, tuple[float, ...]], ...]


@dataclass(frozen=True)
class Description:
    """The content of a file before the check of its shape.

    norms : name -> method
    rules : indices (position, velocity, force) of the terms
    facts : numbers that `rpo export` wrote into comments
    """

    name: str
    norms: dict[str, str]
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
        return controller_of(read(content), path.name, scales)


def facts_of(content: str) -> dict[str, float]:
    """Return the numbers that `rpo export` noted in comments."""
    return {
        name: number(value, f'rpo: {name}')
        for name, value in _FACT.findall(content)
        if name in (*SCALES, 'samples')
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
    for name, wanted in _NORMS.items():
        choice(name, described.norms[name], [wanted])
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
    order = sorted(range(5), key=lambda i: variable.terms[i][2][1])
    feet = np.array([variable.terms[i][2] for i in order])
    size = float(feet[4, 1])
    low, high = variable.range
    if not (
        size > 0.0 and high >= size * (1.0 - _SYMMETRY) and abs(low + high) <= _SYMMETRY * high
    ):
        raise InputError(
            f'its range must be [-S, S] with the outer peaks at -S and S; got [{low:g}, {high:g}] '
            f'and peaks at {feet[0, 1]:g} and {size:g}'
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


_SECTION = re.compile(r'\[(\w+)\]')
_MF = re.compile(r"'(.*)'\s*:\s*'(\w+)'\s*,\s*\[(.*)\]")
_RULE = re.compile(r'(\d{1,9})\s+(\d{1,9})\s*,\s*(\d{1,9})\s*\((.+)\)\s*:\s*1')


def read_fis(content: str) -> Description:
    """Return the description of a MATLAB `.fis` text; raises InputError."""
    sections: dict[str, dict[str, str]] = {'': {}}
    rules: list[tuple[int, int, int]] = []
    current = ''
    for line in _lines(content, '%'):
        section = _SECTION.fullmatch(line)
        if section:
            current = section[1]
            sections[current] = {}
        elif current == 'Rules':
            rules.append(_fis_rule(line))
        else:
            key, equals, value = line.partition('=')
            if not equals:
                raise InputError(f'not a .fis line: {shown(line)}')
            sections[current][key.strip()] = value.strip()
    system = sections.get('System')
    if system is None:
        raise InputError('not a .fis file: it has no [System]')
    choice('Type', _bare(system.get('Type', '')), ['mamdani'])
    names = [name for name in sections if name.startswith(('Input', 'Output'))]
    if sorted(names) != ['Input1', 'Input2', 'Output1']:
        raise InputError(
            f'must have two inputs and one output; it has {", ".join(names) or "none"}'
        )
    keys = {'and': 'And', 'implication': 'Imp', 'aggregation': 'Agg', 'defuzzification': 'Defuzz'}
    return Description(
        name=_bare(system.get('Name', '')) or 'imported',
        norms={name: _bare(system.get(f'{key}Method', '')) for name, key in keys.items()},
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
    for key, value in section.items():
        if re.fullmatch(r'MF\d+', key):
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


_BLOCKS = ('Engine', 'InputVariable', 'OutputVariable', 'RuleBlock')


def read_fll(content: str) -> Description:
    """Return the description of a FuzzyLite `.fll` text; raises InputError."""
    blocks: list[tuple[str, str, list[tuple[str, str]]]] = []
    for line in _lines(content, '#'):
        key, colon, value = line.partition(':')
        key, value = key.strip(), value.strip()
        if not colon:
            raise InputError(f'not a .fll line: {shown(line)}')
        if key in _BLOCKS:
            blocks.append((key, value, []))
        elif not blocks:
            raise InputError(f'not a .fll file: it starts with {shown(line)}')
        else:
            blocks[-1][2].append((key, value))
    kinds = [kind for kind, _, _ in blocks]
    if sorted(kinds) != sorted([*_BLOCKS, 'InputVariable']):
        raise InputError(
            'must be one Engine with two InputVariables, one OutputVariable and one RuleBlock; '
            f'it has {", ".join(kinds) or "none"}'
        )
    blocks.sort(key=lambda block: _BLOCKS.index(block[0]))
    engine, *variables, rules = blocks
    described = tuple(_fll_variable(name, settings) for _, name, settings in variables)
    output, block = dict(variables[2][2]), dict(rules[2])
    short = {'Minimum': 'min', 'Maximum': 'max', 'Centroid': 'centroid'}
    norms = {
        'and': block.get('conjunction', 'none'),
        'implication': block.get('implication', 'none'),
        'aggregation': output.get('aggregation', 'none'),
        'defuzzification': output.get('defuzzifier', 'none').partition(' ')[0],
    }
    return Description(
        name=engine[1] or 'imported',
        norms={name: short.get(method, method) for name, method in norms.items()},
        variables=described,
        rules=tuple(_fll_rule(value, described) for key, value in rules[2] if key == 'rule'),
        facts=facts_of(content),
    )


def _fll_variable(name: str, settings: list[tuple[str, str]]) -> FileVariable:
    terms = []
    for key, value in settings:
        if key == 'term':
            label, kind, numbers = (*value.split(maxsplit=2), '', '', '')[:3]
            terms.append((label, kind, _numbers(numbers, f'{name}.{label}')))
    return FileVariable(
        name, _range(dict(settings).get('range', ''), f'{name}.range'), tuple(terms)
    )


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
