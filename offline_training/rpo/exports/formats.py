# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A controller in the formats of other tools, MATLAB and FuzzyLite, and as JSON; and read back.

Numbers are written so that they read back bit for bit. A `.fis` or `.fll` file is read if it holds
a system of the paper's shape: two inputs (position error, then velocity error) and one output, each
of five triangles that mirror about 0, and 25 rules joined by AND. Words go by the order of their
peaks, whatever their names. The outer peaks lie at -S and S; S other than 1 is that variable's
scale in m, m/s, N. Inputs end at the outer peaks, and the samples of the output too. Every key is
read; what our inference has not is refused by name.
"""

from __future__ import annotations

import json as json_module
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core import files
from rpo_core.control.controller import AnyController, FuzzyController, only_fuzzy, to_document
from rpo_core.control.family import Family
from rpo_core.control.fuzzy import (
    DEFAULT_SAMPLES,
    WORDS,
    FuzzySystem,
    MembershipFunctions,
    RuleTable,
    odd_samples,
)
from rpo_core.control.table import MoreWords
from rpo_core.control.time_to_go import TimeToGo
from rpo_core.files.validation import InputError, choice, near, quoted, shown, within

GOAL = (
    'Position and velocity are relative to the goal: position minus goal. Off the target, add the',
    'force that holds a chaser at the goal (x, y, z), m n^2 (-3 x, 0, z): mass m, mean motion n.',
    'Where guidance flies, its reference and the force of the reference stand for both.',
)
"""What a controller alone does not know, of every format."""

SCALES = ('position_scale_m', 'velocity_scale_m_s', 'force_scale_n')

Triangle = tuple[float, float, float]


class Variable(NamedTuple):
    """A normalised variable; `terms` in the order of `WORDS`, left foot, peak, right foot."""

    name: str
    terms: tuple[tuple[str, Triangle], ...]


class Rule(NamedTuple):
    """If the position and the velocity error are these words, the force is that."""

    position: str
    velocity: str
    force: str


def triangles(functions: MembershipFunctions) -> tuple[tuple[str, Triangle], ...]:
    """Return the five triangles; the outer feet of LN and LP lie at -2 and 2, as in the kernel."""
    f = functions
    return (
        ('LN', (-2.0, -1.0, 0.0 - f.lp_left)),
        ('SN', (0.0 - f.sp_right, -f.sp_centre, 0.0 - f.sp_left)),
        ('Z', (-f.z_half_width, 0.0, f.z_half_width)),
        ('SP', (f.sp_left, f.sp_centre, f.sp_right)),
        ('LP', (f.lp_left, 1.0, 2.0)),
    )


def variables(controller: FuzzyController) -> tuple[Variable, Variable, Variable]:
    """Return position error, velocity error and force."""
    system = controller.system
    return (
        Variable('position_error', triangles(system.position)),
        Variable('velocity_error', triangles(system.velocity)),
        Variable('force', triangles(system.force)),
    )


def rules(controller: FuzzyController) -> list[Rule]:
    """Return the 25 rules, column by column of the table."""
    words = controller.system.rules.words
    return [
        Rule(position, velocity, words[row][column])
        for column, position in enumerate(WORDS)
        for row, velocity in enumerate(WORDS)
    ]


def facts(controller: AnyController) -> list[str]:
    """Return the lines of a comment for a person and, of a fuzzy controller, for `rpo import`.

    What every format but C says of the goal is `GOAL`.
    """
    if not isinstance(controller, FuzzyController):
        lines = [f'{controller.name}: {controller.description}', 'exported by rpo export']
        return [one_line(line) for line in lines]
    lines = [
        f'{one_line(controller.name)}: fuzzy controller of one axis of a final approach',
        *([one_line(controller.description)] if controller.description.strip() else []),
        'position_error = -position / position_scale, velocity_error = -velocity / velocity_scale,',
        'both saturated to [-1, 1]; force on that axis = force * force_scale',
    ]
    scales = zip(SCALES, controller.scales, strict=True)
    lines += [f'rpo: {name} = {value!r}' for name, value in scales]
    return [*lines, f'rpo: samples = {controller.system.samples}']


def one_line(text: str) -> str:
    """Return a text that ends no comment of any of the formats, and no quotation."""
    return re.sub(r'[*"\\]', ' ', ' '.join(text.replace("'", '`').split()))


def _title(text: str) -> str:
    """Return a text in which no comment of `.fis` or `.fll` begins."""
    return re.sub('[%#]', ' ', one_line(text))


def json(controller: AnyController) -> str:
    """Return the JSON text of a controller: its file, and its rules spelt out."""
    about = [*facts(controller), *GOAL]
    document: dict[str, Any] = {'about': about, 'controller': to_document(controller)}
    if isinstance(controller, FuzzyController):
        document['triangles'] = {v.name: dict(v.terms) for v in variables(controller)}
        document['rules'] = [rule._asdict() for rule in rules(controller)]
    elif isinstance(controller, Family):
        document['rules'] = [table._asdict() for table in controller.tables()]
        document['claims'] = [claim._asdict() for claim in controller.claims()]
    return json_module.dumps(document, indent=2, ensure_ascii=False, default=str) + '\n'


def fis(any_controller: AnyController) -> str:
    """Return MATLAB Fuzzy Logic Toolbox `.fis` 2.0; `evalfis` gives the kernel's output.

    Raises InputError if the controller is not the paper's fuzzy one.
    """
    controller = only_fuzzy(any_controller)
    comments, samples = [*facts(controller), *GOAL], controller.system.samples
    if samples != DEFAULT_SAMPLES:
        comments.append(f'evaluate with evalfisOptions(NumSamplePoints={samples})')
    system = {key: text.rstrip('?').split('|')[0] for key, text in _SYSTEM.items() if text}
    lines = [f"{k}='{v}'" if v.isalpha() else f'{k}={v}' for k, v in system.items()]
    blocks = ['\n'.join(['[System]', f"Name='{_title(controller.name)}'", *lines]) + '\n']
    names = ('Input1', 'Input2', 'Output1')
    for name, variable in zip(names, variables(controller), strict=True):
        lines = [f'[{name}]', f"Name='{variable.name}'", 'Range=[-1 1]', 'NumMFs=5']
        for number, (word, feet) in enumerate(variable.terms, 1):
            lines.append(f"MF{number}='{word}':'trimf',[{' '.join(map(repr, feet))}]")
        blocks.append('\n'.join(lines) + '\n')
    place = {word: i for i, word in enumerate(WORDS, 1)}
    lines = [
        f'{place[rule.position]} {place[rule.velocity]}, {place[rule.force]} (1) : 1'
        for rule in rules(controller)
    ]
    blocks.append('\n'.join(['[Rules]', *lines]) + '\n')
    return ''.join(f'% {line}\n' for line in comments) + '\n'.join(blocks)


def fll(controller: AnyController) -> str:
    """Return FuzzyLite Language `.fll`; raises InputError for a controller without rules."""
    if isinstance(controller, FuzzyController):
        return _mamdani(controller)
    if isinstance(controller, MoreWords):
        return _force_table(controller)
    if isinstance(controller, TimeToGo):
        return _time_to_go(controller)
    raise InputError(f'`--to fll` does not know kind {controller.kind}; there are json and c')


def _engine(
    controller: AnyController,
    about: Sequence[str],
    inputs: Sequence[str],
    output: tuple[str, str, Sequence[str]],
    methods: tuple[str, str, str, str],
    rules: Iterable[str],
) -> str:
    """Return the text of an engine.

    about : more comments
    inputs : variables, each as its lines
    output : name, range, terms
    methods : aggregation, defuzzifier, conjunction, implication
    """
    name, extent, terms = output
    aggregation, defuzzifier, conjunction, implication = methods
    lines = [
        *(f'# {line}' for line in [*facts(controller), *GOAL, *about]),
        f'Engine: {_title(controller.name)}',
        *inputs,
        _variable('OutputVariable', name, extent, 'false', []),
        f'  aggregation: {aggregation}',
        f'  defuzzifier: {defuzzifier}',
        '  default: 0.0',
        '  lock-previous: false',
        *(f'  term: {term}' for term in terms),
        'RuleBlock: rules',
        '  enabled: true',
        f'  conjunction: {conjunction}',
        '  disjunction: none',
        f'  implication: {implication}',
        '  activation: General',
        *(f'  rule: if {rule}' for rule in rules),
    ]
    return '\n'.join(lines) + '\n'


def _variable(block: str, name: str, extent: str, locked: str, terms: Sequence[str]) -> str:
    head = [f'{block}: {name}', '  enabled: true', f'  range: {extent}', f'  lock-range: {locked}']
    return '\n'.join(head + [f'  term: {term}' for term in terms])


def _mamdani(controller: FuzzyController) -> str:
    """Return the paper's system.

    FuzzyLite integrates over the middles of equal cells: on a range wider by half a cell on each
    side they are the kernel's samples, so that the centroids are equal but for rounding.
    """
    samples = controller.system.samples
    edge = 1.0 + 1.0 / (samples - 1)
    *inputs, (output, words) = (
        (v.name, [f'{word} Triangle {" ".join(map(repr, feet))}' for word, feet in v.terms])
        for v in variables(controller)
    )
    return _engine(
        controller,
        [],
        [_variable('InputVariable', name, '-1.0 1.0', 'true', terms) for name, terms in inputs],
        (output, f'{-edge!r} {edge!r}', words),
        ('Maximum', f'Centroid {samples}', 'Minimum', 'Minimum'),
        (f'position_error is {p} and velocity_error is {v} then force is {f}'
         for p, v, f in rules(controller)),
    )  # fmt: skip


_WEIGHTED = ('none', 'WeightedAverage TakagiSugeno', 'AlgebraicProduct', 'none')


def _peaks(name: str, words: Sequence[str], peaks: Sequence[float]) -> str:
    """Return an input whose triangles partition it."""
    feet = zip(words, [peaks[0], *peaks], peaks, [*peaks[1:], peaks[-1]], strict=False)
    terms = [f'{word} Triangle {a!r} {b!r} {c!r}' for word, a, b, c in feet]
    return _variable('InputVariable', name, f'{peaks[0]!r} {peaks[-1]!r}', 'true', terms)


def _plain(words: Iterable[str]) -> list[str]:
    return [word.replace(' ', '_') for word in words]


def _force_table(controller: MoreWords) -> str:
    """Return a table of forces by distance and closing speed."""
    words, others = _plain(controller.distances), _plain(controller.speeds)
    cells = [(i, j) for i in range(len(words)) for j in range(len(others))]
    forces = [f'{words[i]}_{others[j]} Constant {controller.table_n[i][j]!r}' for i, j in cells]
    return _engine(
        controller,
        ['distance = |r|; closing speed of an axis = -sign(r) v',
         f'force of the axis = -sign(r) pull, saturated at {controller.max_force_n!r} N.'],
        [_peaks('distance', words, controller.peaks_m),
         _peaks('closing_speed', others, controller.speeds_m_s)],
        ('pull', '-inf inf', forces),
        _WEIGHTED,
        (f'distance is {words[i]} and closing_speed is {others[j]} then pull is '
         f'{words[i]}_{others[j]}' for i, j in cells),
    )  # fmt: skip


def _time_to_go(controller: TimeToGo) -> str:
    """Return gains by the time to go."""
    laws = list(reversed(controller.rules))
    words = _plain(rule.time_to_go for rule in laws)
    linear = [
        f'{word} Linear 0.0 {-rule.position_gain_n_m!r} {-rule.velocity_gain_n_s_m!r} 0.0'
        for word, rule in zip(words, laws, strict=True)
    ]
    return _engine(
        controller,
        [f'time_to_go = max({controller.arrival_s!r} s - time since the start, 0); force of the',
         f'axis saturated at {controller.max_force_n!r} N.'],
        [_peaks('time_to_go', words, [rule.peak_s for rule in laws]),
         *(_variable('InputVariable', name, '-inf inf', 'false', [])
           for name in ('position', 'velocity'))],
        ('force', '-inf inf', linear),
        _WEIGHTED,
        (f'time_to_go is {word} then force is {word}' for word in words),
    )  # fmt: skip


_SYMMETRY = 1e-9  # of a range: how far apart mirrored feet may be, for files with rounded numbers
_FACT = re.compile(r'\s*[%#]\s*rpo:\s*(\w+)\s*=\s*(\S+)')

_MF = re.compile(r"(.*)'\s*:\s*'(\w+)'\s*,\s*\[(.*)\]")
_MFS = tuple(f'MF{i}' for i in range(1, 6))
_RULE = re.compile(r'(\d{1,9})\s+(\d{1,9})\s*,\s*(\d{1,9})\s*\((.+)\)\s*:\s*1')
_CLAUSES = re.compile(r'if (\w+) is (\w+) and (\w+) is (\w+) then (\w+) is (\w+)')

# Key -> the values that our inference has; `?`: it may be absent; nothing: it is read elsewhere.
_SYSTEM = {
    'Name': '', 'Type': 'mamdani', 'Version': '2.0|2?', 'NumInputs': '2?', 'NumOutputs': '1?',
    'NumRules': '25?', 'AndMethod': 'min', 'OrMethod': 'max?', 'ImpMethod': 'min',
    'AggMethod': 'max', 'DefuzzMethod': 'centroid',
}  # fmt: skip
_VARIABLE = {'Name': '', 'Range': '', 'NumMFs': '5?', **dict.fromkeys(_MFS, '')}
_INPUT = {
    'description': '', 'enabled': 'true?', 'range': '',
    'lock-range': 'true',  # else the grade of an outer word falls beyond its peak
}  # fmt: skip
_OUTPUT = {
    **_INPUT, 'lock-range': 'true|false?', 'aggregation': 'Maximum', 'defuzzifier': '',
    'default': '', 'lock-previous': 'false?',
}  # fmt: skip
_RULES = {
    'description': '', 'enabled': 'true?', 'conjunction': 'Minimum',
    'disjunction': 'none|Maximum?',  # no rule has an OR
    'implication': 'Minimum', 'activation': 'General',
}  # fmt: skip

_Format = Sequence[tuple[str, dict[str, str]]]
_FIS: _Format = (
    ('System', _SYSTEM), ('Input1', _VARIABLE), ('Input2', _VARIABLE), ('Output1', _VARIABLE),
    ('Rules', {}),
)  # fmt: skip
_FLL: _Format = (
    ('Engine', {'description': ''}), ('InputVariable', _INPUT), ('InputVariable', _INPUT),
    ('OutputVariable', _OUTPUT), ('RuleBlock', _RULES),
)  # fmt: skip
"""Blocks of a file, each once, and their keys."""

_ITEMS = {'InputVariable': 'term', 'OutputVariable': 'term', 'RuleBlock': 'rule'}
"""The key of a block that may stand several times."""


class FileVariable(NamedTuple):
    """A variable as the file has it: range and (name, kind, parameters) of its terms.

    reach : where the range must end, as a multiple of the outer peak
    """

    name: str
    range: tuple[float, ...]
    terms: list[tuple[str, str, tuple[float, ...]]]
    reach: float = 1.0


class Description(NamedTuple):
    """The content of a file before the check of its shape.

    rules : indices (position, velocity, force) of the terms
    facts : numbers that `rpo export` wrote into comments
    """

    name: str
    variables: list[FileVariable]
    rules: list[tuple[int, ...]]
    facts: dict[str, float]


class _Block(NamedTuple):
    """A section of `.fis`, or a block of `.fll` with its name; items : terms or rules."""

    label: str
    name: str
    keys: dict[str, str]
    items: list[str]


def load(path: Path, scales: Sequence[float | None] = (None, None, None)) -> FuzzyController:
    """Return the controller of a `.fis` or `.fll` file.

    scales : position [m], velocity [m/s], force [N]; those that are None come from the file

    Raises InputError if the file cannot be read, has another format or shape, or has no scale.
    """
    readers = {'.fis': read_fis, '.fll': read_fll}
    with within(str(path)):
        read = readers[choice('file name suffix', path.suffix.lower(), readers)]
    content = files.read_text(path)
    with within(str(path)):
        return controller_of(read(content.removeprefix('\ufeff')), path.name, scales)


def facts_of(content: str) -> dict[str, float]:
    """Return the numbers that `rpo export` noted in comments."""
    facts = {match[1]: match[2] for match in map(_FACT.match, content.splitlines()) if match}
    names = [name for name in (*SCALES, 'samples') if name in facts]
    return {name: number(facts[name], f'rpo: {name}') for name in names}


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
        in_file = facts.get(name) if size == 1.0 else size
        scale = in_file if option is None else option
        if scale is None:
            raise InputError(f'does not say `{name}`: give --{name.partition("_")[0]}-scale')
        chosen.append(scale)
    position, velocity, force = chosen
    provenance = {'method': 'imported', 'file': source}
    return FuzzyController(described.name, system, position, velocity, force, provenance=provenance)


def _normalised(variable: FileVariable) -> tuple[MembershipFunctions, float, list[int]]:
    """Return functions on [-1, 1], the size S, and the term indices in the order of `WORDS`."""
    if len(variable.terms) != 5:
        raise InputError(f'must have 5 terms; it has {len(variable.terms)}')
    for name, kind, points in variable.terms:
        is_triangle = kind in ('trimf', 'Triangle') and len(points) == 3
        if not (is_triangle and points[0] <= points[1] <= points[2]):
            raise InputError(
                f'term {quoted(name)} must be a triangle of 3 points: left foot, peak, right foot; '
                f'got {kind} {list(points)}'
            )
    order = sorted(range(5), key=lambda i: variable.terms[i][2][1])
    names = [variable.terms[i][0] for i in order]
    feet = np.array([variable.terms[i][2] for i in order])
    size, reach = float(feet[4, 1]), variable.reach
    ends = np.array([-size, size]) * reach
    if not (size > 0.0 and np.abs(ends - variable.range).max() <= _SYMMETRY * size):
        end = 'S' if reach == 1.0 else f'{reach:g} S'
        raise InputError(
            f'`range` must be [-{end}, {end}] with the outer peaks at -S and S; '
            f'got {list(variable.range)} and peaks at {feet[0, 1]:g} and {size:g}'
        )
    if reach > 1.0 and (feet[0, 0] > ends[0] or feet[4, 2] < ends[1]):
        raise InputError(
            f'terms {quoted(names[0])} and {quoted(names[4])} must have their outer feet outside '
            f'the range, like {2.0 * ends[0]:g} and {2.0 * ends[1]:g}: the outer samples lie at '
            'the peaks but for rounding'
        )
    return _functions(feet / size, names), size, order


def _functions(feet: NDArray[np.float64], names: list[str]) -> MembershipFunctions:
    """Return the functions of triangles (5, 3) on [-1, 1]; raises InputError if they differ."""
    mirror = -feet[::-1, ::-1]
    feet[[0, 4], [0, 2]] = mirror[[0, 4], [0, 2]] = -2.0, 2.0  # outside: no matter where they are
    for name, feet_of_term, other in zip(names, feet, mirror, strict=True):
        if np.abs(feet_of_term - other).max() > _SYMMETRY:
            raise InputError(f'term {quoted(name)} must mirror its opposite about 0; it does not')
    (_, z, half), (left, centre, right), (large, peak, _) = feet[2:].tolist()
    if z != 0.0 or peak != 1.0:
        raise InputError('its middle and outer terms must peak at 0 and at the ends of the range')
    return MembershipFunctions(half, left, centre, right, large)


def _table(rules: Sequence[Sequence[int]], orders: Sequence[list[int]]) -> RuleTable:
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


def _blocks(
    content: str, comment: str, sign: str, header: re.Pattern[str], known: _Format
) -> list[_Block]:
    """Return the blocks of a file in the order of its format; raises InputError.

    header : begins a block; its groups are the kind and the name of the block
    """
    blocks: list[tuple[str, _Block]] = []
    for text in content.splitlines():
        line = text.partition(comment)[0].strip()
        key, equals, value = (part.strip() for part in line.partition(sign))
        if begin := header.fullmatch(line):
            kind, name = begin[1], begin[2].strip()
            label = f'{kind} {quoted(name)}' if name else f'[{kind}]'
            blocks.append((kind, _Block(label, name, {}, [])))
        elif not line:
            continue
        elif blocks and (blocks[-1][0] == 'Rules' or key == _ITEMS.get(blocks[-1][0])):
            blocks[-1][1].items.append(line if blocks[-1][0] == 'Rules' else value)
        elif not (blocks and equals):
            raise InputError(f'not a line of such a file: {shown(line)}')
        else:
            _, block = blocks[-1]
            if key in block.keys:
                raise InputError(f'{block.label}: {quoted(key)} must stand once; it stands twice')
            block.keys[key] = value.strip('\'"') if sign == '=' else value
    kinds, wanted = [kind for kind, _ in blocks], [kind for kind, _ in known]
    if sorted(kinds) != sorted(wanted):
        raise InputError(f'must have {", ".join(wanted)}; it has {", ".join(kinds) or "none"}')
    for kind, block in blocks:
        with within(block.label):
            _check(block.keys, dict(known)[kind])
    return [block for _, block in sorted(blocks, key=lambda each: wanted.index(each[0]))]


def _check(keys: dict[str, str], known: dict[str, str]) -> None:
    """Check that keys are known, and have values that our inference has; raises InputError."""
    for key in keys:
        if key not in known:
            raise InputError(f'{quoted(key)} is not a known key{near(key, known)}')
    for key, text in known.items():
        values = text.rstrip('?').split('|')
        if text and keys.get(key) not in values and (key in keys or not text.endswith('?')):
            got = shown(keys[key]) if key in keys else 'no such key'
            raise InputError(f'`{key}` must be {" or ".join(values)}; got {got}')


def _numbers(text: str, place: str) -> tuple[float, ...]:
    return tuple(number(part, place) for part in re.split(r'[\s,]+', text.strip(' []')))


def _range(text: str, place: str) -> tuple[float, ...]:
    numbers = _numbers(text, place)
    if len(numbers) != 2:
        raise InputError(f'{quoted(place)} must be two numbers; got {shown(text)}')
    return numbers


def read_fis(content: str) -> Description:
    """Return the description of a MATLAB `.fis` text; raises InputError."""
    system, *blocks, rules = _blocks(content, '%', '=', re.compile(r'\[(\w+)\]()'), _FIS)
    variables = []
    for block in blocks:
        name, terms = block.keys.get('Name', ''), []
        for key in _MFS:  # rules number the words
            value = block.keys.get(key, '')
            match = _MF.fullmatch(value)
            if not match:
                raise InputError(f"`{key}` must be like 'LN':'trimf',[-2 -1 0]; got {shown(value)}")
            terms.append((match[1], match[2], _numbers(match[3], key)))
        extent = _range(block.keys.get('Range', ''), f'{name}.Range')
        variables.append(FileVariable(name, extent, terms))
    name = system.keys.get('Name', '') or 'imported'
    return Description(name, variables, list(map(_fis_rule, rules.items)), facts_of(content))


def _fis_rule(line: str) -> tuple[int, ...]:
    match = _RULE.fullmatch(line)
    words = [int(i) - 1 for i in match.groups()[:3]] if match else []
    if not match or number(match[4], 'weight') != 1.0 or not all(0 <= i < 5 for i in words):
        raise InputError(
            'a rule must be like `1 2, 3 (1) : 1`: words 1 to 5, weight 1, joined by AND; '
            f'got {shown(line)}'
        )
    return tuple(words)


def read_fll(content: str) -> Description:
    """Return the description of a FuzzyLite `.fll` text; raises InputError."""
    header = re.compile(rf'({"|".join(dict(_FLL))})\s*:(.*)')
    engine, *blocks, rules = _blocks(content, '#', ':', header, _FLL)
    facts, output = facts_of(content), blocks[2].keys
    defuzzifier, default = output.get('defuzzifier', ''), output.get('default', 'no such key')
    match = re.fullmatch(r'Centroid\s+(\d{1,6})', defuzzifier, re.ASCII)
    samples = int(match[1]) if match else 0
    if samples % 2 == 0 or samples < 3:
        raise InputError(
            '`defuzzifier` must be Centroid with an odd number of samples, so that 0 is one of '
            f'them, like `Centroid {DEFAULT_SAMPLES}`; got {shown(defuzzifier)}'
        )
    if facts.setdefault('samples', float(samples)) != samples:
        raise InputError(
            f'`defuzzifier` must have the samples of the comment `rpo: samples`, '
            f'{facts["samples"]:g}; got {shown(defuzzifier)}'
        )
    if not re.fullmatch(r'-?0+(\.0*)?', default):
        raise InputError(
            f'`default` must be 0.0, our output where no rule fires; got {shown(default)}'
        )
    reaches = 1.0, 1.0, 1.0 + 1.0 / (samples - 1)
    variables = [_fll_variable(*each) for each in zip(blocks, reaches, strict=True)]
    read = [_fll_rule(rule, variables) for rule in rules.items]
    return Description(engine.name or 'imported', variables, read, facts)


def _fll_variable(block: _Block, reach: float) -> FileVariable:
    terms = []
    for value in block.items:
        label, kind, numbers = (*value.split(maxsplit=2), '', '', '')[:3]
        terms.append((label, kind, _numbers(numbers, f'{block.name}.{label}')))
    if len({label for label, _, _ in terms}) < len(terms):
        raise InputError(f'the terms of {quoted(block.name)} must have different names')
    extent = _range(block.keys.get('range', ''), f'{block.name}.range')
    return FileVariable(block.name, extent, terms, reach)


def _fll_rule(rule: str, variables: list[FileVariable]) -> tuple[int, ...]:
    clauses = _CLAUSES.fullmatch(rule)
    parts = clauses.groups() if clauses else ()
    word_of = dict(zip(parts[::2], parts[1::2], strict=True))
    names = [[name for name, _, _ in variable.terms] for variable in variables]
    words = [word_of.get(variable.name, '') for variable in variables]
    if len(word_of) != 3 or any(word not in of for word, of in zip(words, names, strict=True)):
        raise InputError(
            'a rule must be like `if A is P and B is Q then F is R`, of terms that the file has; '
            f'got {shown(rule)}'
        )
    return tuple(of.index(word) for word, of in zip(words, names, strict=True))
