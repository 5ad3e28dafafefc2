# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A controller in the formats of other tools, MATLAB and FuzzyLite, and as JSON.

Numbers are written so that they read back bit for bit (`importing`).
"""

from __future__ import annotations

import json as json_module
import re
import textwrap
from collections.abc import Iterable, Sequence
from functools import cache
from importlib import resources
from string import Template
from typing import Any, NamedTuple

import numpy as np

from rpo_core.control.controller import AnyController, FuzzyController, only_fuzzy, to_document
from rpo_core.control.family import Family
from rpo_core.control.fuzzy import DEFAULT_SAMPLES, WORDS, MembershipFunctions
from rpo_core.control.table import MoreWords
from rpo_core.control.time_to_go import TimeToGo
from rpo_core.files.validation import InputError

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
def _templates() -> dict[str, Template]:
    text = resources.files('rpo.exports').joinpath('parts.template').read_text('utf-8')
    parts = re.split(r'^@@ (\w+)\n', text, flags=re.MULTILINE)[1:]
    texts = (Template(text.removesuffix('\n')) for text in parts[1::2])
    return dict(zip(parts[::2], texts, strict=True))


def filled(part: str, **values: object) -> str:
    """Return a part of `parts.template`, its places `$name` filled with values."""
    return _templates()[part].substitute(values)


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
    blocks = [filled('fis', name=_title(controller.name))]
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
