# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A controller in the formats of other tools, MATLAB and FuzzyLite, and as JSON.

Numbers are written so that they read back bit for bit (`importing`).
"""

from __future__ import annotations

import json as json_module
import re
import textwrap
from collections.abc import Sequence
from functools import cache
from importlib import resources
from string import Template
from typing import Any, NamedTuple

import numpy as np

from rpo_core.control.controller import AnyController, FuzzyController, only_fuzzy, to_document
from rpo_core.control.fuzzy import DEFAULT_SAMPLES, WORDS, MembershipFunctions
from rpo_core.files.validation import InputError
from rpo_ctrl.family import Family
from rpo_ctrl.table import MoreWords
from rpo_ctrl.time_to_go import TimeToGo

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


@cache
def _template(file: str, part: str) -> Template:
    text = resources.files('rpo_export').joinpath(f'{file}.template').read_text('utf-8')
    parts = re.split(r'^@@ (\w+)\n', text, flags=re.MULTILINE)[1:]
    return Template(dict(zip(parts[::2], parts[1::2], strict=True))[part].removesuffix('\n'))


def filled(file: str, part: str, **values: object) -> str:
    """Return a part of a file `.template`, its places `$name` filled with values."""
    return _template(file, part).substitute(values)


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


def listed(values: Any, indent: int, width: int) -> str:
    """Return numbers that read back bit for bit, in indented lines of at most `width`."""
    text = ', '.join(map(repr, np.asarray(values).tolist()))
    space = ' ' * indent
    return textwrap.fill(text, width, initial_indent=space, subsequent_indent=space)


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
    blocks = [filled('formats', 'fis', name=_title(controller.name))]
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


class Engine(NamedTuple):
    """A controller as FuzzyLite has it: comments, variables as lines, and rules.

    methods : of the output, and of the block of rules
    """

    about: Sequence[str]
    inputs: Sequence[Sequence[str]]
    output: tuple[str, str, Sequence[str]]
    methods: tuple[str, str, str, str]
    rules: Sequence[str]


def fll(controller: AnyController) -> str:
    """Return FuzzyLite Language `.fll`; raises InputError for a controller without rules."""
    if isinstance(controller, FuzzyController):
        engine = _mamdani(controller)
    elif isinstance(controller, MoreWords):
        engine = _force_table(controller)
    elif isinstance(controller, TimeToGo):
        engine = _time_to_go(controller)
    else:
        raise InputError(f'`--to fll` does not know kind {controller.kind}; there are json and c')
    aggregation, defuzzifier, conjunction, implication = engine.methods
    name, extent, terms = engine.output
    lines = [
        *(f'# {line}' for line in [*facts(controller), *GOAL, *engine.about]),
        f'Engine: {_title(controller.name)}',
        *(line for variable in engine.inputs for line in variable),
        f'OutputVariable: {name}',
        '  enabled: true',
        f'  range: {extent}',
        '  lock-range: false',
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
        *(f'  rule: if {rule}' for rule in engine.rules),
    ]
    return '\n'.join(lines) + '\n'


def _input(name: str, extent: str, terms: Sequence[str], locked: bool = True) -> list[str]:
    return [
        f'InputVariable: {name}',
        '  enabled: true',
        f'  range: {extent}',
        f'  lock-range: {str(locked).lower()}',
        *(f'  term: {term}' for term in terms),
    ]


def _mamdani(controller: FuzzyController) -> Engine:
    """Return the paper's system.

    FuzzyLite integrates over the middles of equal cells: on a range wider by half a cell on each
    side they are the kernel's samples, so that the centroids are equal but for rounding.
    """
    samples = controller.system.samples
    edge = 1.0 + 1.0 / (samples - 1)
    *inputs, output = (
        (v.name, [f'{word} Triangle {" ".join(map(repr, feet))}' for word, feet in v.terms])
        for v in variables(controller)
    )
    return Engine(
        [],
        [_input(name, '-1.0 1.0', terms) for name, terms in inputs],
        (output[0], f'{-edge!r} {edge!r}', output[1]),
        ('Maximum', f'Centroid {samples}', 'Minimum', 'Minimum'),
        [
            f'position_error is {r.position} and velocity_error is {r.velocity} then force is '
            f'{r.force}'
            for r in rules(controller)
        ],
    )


_WEIGHTED = ('none', 'WeightedAverage TakagiSugeno', 'AlgebraicProduct', 'none')


def _peaks(name: str, words: Sequence[str], peaks: Sequence[float]) -> list[str]:
    """Return an input whose triangles partition it."""
    low, high = [peaks[0], *peaks[:-1]], [*peaks[1:], peaks[-1]]
    feet = zip(words, low, peaks, high, strict=True)
    terms = [f'{word} Triangle {a!r} {b!r} {c!r}' for word, a, b, c in feet]
    return _input(name, f'{peaks[0]!r} {peaks[-1]!r}', terms)


def _plain(words: Sequence[str]) -> list[str]:
    return [word.replace(' ', '_') for word in words]


def _force_table(controller: MoreWords) -> Engine:
    """Return a table of forces by distance and closing speed."""
    about = 'distance = |r|; closing speed of an axis = -sign(r) v'
    words, others = _plain(controller.distances), _plain(controller.speeds)
    pairs = [(i, j, f'{words[i]}_{others[j]}') for i in range(len(words))
             for j in range(len(others))]  # fmt: skip
    return Engine(
        [about, f'force of the axis = -sign(r) pull, saturated at {controller.max_force_n!r} N.'],
        [
            _peaks('distance', words, controller.peaks_m),
            _peaks('closing_speed', others, controller.speeds_m_s),
        ],
        ('pull', '-inf inf', [f'{n} Constant {controller.table_n[i][j]!r}' for i, j, n in pairs]),
        _WEIGHTED,
        [
            f'distance is {words[i]} and closing_speed is {others[j]} then pull is {name}'
            for i, j, name in pairs
        ],
    )


def _time_to_go(controller: TimeToGo) -> Engine:
    """Return gains by the time to go."""
    laws = list(reversed(controller.rules))
    words = _plain([rule.time_to_go for rule in laws])
    linear = [
        f'{word} Linear 0.0 {-rule.position_gain_n_m!r} {-rule.velocity_gain_n_s_m!r} 0.0'
        for word, rule in zip(words, laws, strict=True)
    ]
    return Engine(
        [
            f'time_to_go = max({controller.arrival_s!r} s - time since the start, 0); force of the',
            f'axis saturated at {controller.max_force_n!r} N.',
        ],
        [
            _peaks('time_to_go', words, [rule.peak_s for rule in laws]),
            *(_input(name, '-inf inf', [], locked=False) for name in ('position', 'velocity')),
        ],
        ('force', '-inf inf', linear),
        _WEIGHTED,
        [f'time_to_go is {word} then force is {word}' for word in words],
    )
