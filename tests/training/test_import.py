# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Files of others are read as FuzzyLite and MATLAB read them, or refused by name.

One line of a file is changed. pyfuzzylite judges `.fll`, scikit-fuzzy (MATLAB's sums) `.fis`.
"""

from __future__ import annotations

import random
import re

import fuzzylite as fl
import numpy as np
import pytest
import skfuzzy
from core_strategies import free_rules, smooth_functions
from hypothesis import given, settings
from hypothesis import strategies as st
from invoking import invoke

from rpo.exports import formats, text_of
from rpo_core.control.controller import load_controller
from rpo_core.files.validation import InputError

WORDS = ('far below', 'below', 'at', 'above', 'far above')
SCALES = (60.0, 1.25, 0.5)
SAME = 1e-9
"""Of the largest force."""


def points(scales, reach=1.6):
    """Return errors (2, n): a grid, and random ones up to beyond the outer peaks."""
    grid = np.array(np.meshgrid(*[np.linspace(-1, 1, 9)] * 2)).reshape(2, -1)
    drawn = np.random.default_rng(3).uniform(-reach, reach, (2, 120))
    return np.hstack([grid, drawn]) * np.array(scales[:2])[:, None]


def ours(controller, errors):
    """Return the force of errors (2, n), as they are in the file."""
    position, velocity, force = controller.scales
    output = controller.system.output
    return force * np.array([output(e / position, v / velocity) for e, v in errors.T])


def triangles(functions, scale, inside):
    """Return the feet and peaks of five words, with few digits; the outer feet at the peaks."""
    feet = np.round([feet for _, feet in formats.triangles(functions)], 3)
    if inside:
        feet[0, 0], feet[4, 2] = -1.0, 1.0
    return feet * scale


PARTS = st.tuples(smooth_functions, smooth_functions, smooth_functions)
FEET = st.tuples(st.booleans(), st.booleans(), st.just(False))


def variable(kind, name, feet, reach=1.0, **more):
    """Return a variable of FuzzyLite."""
    words = [re.sub(r'\W', '_', word) for word in WORDS]
    terms = [fl.Triangle(word, *map(float, row)) for word, row in zip(words, feet, strict=True)]
    size = float(feet[4, 1] * reach)
    return kind(name=name, minimum=-size, maximum=size, terms=terms, **more)


def engine_text(parts, inside, codes, samples=101, reach=None):
    """Return an engine that pyfuzzylite wrote."""
    feet = [triangles(*each) for each in zip(parts, SCALES, inside, strict=True)]
    reach = 1.0 + 1.0 / (samples - 1) if reach is None else reach
    inputs = [
        variable(fl.InputVariable, name, each, lock_range=True)
        for name, each in zip(('error', 'rate'), feet, strict=False)
    ]
    output = variable(
        fl.OutputVariable, 'push', feet[2], reach, aggregation=fl.Maximum(),
        defuzzifier=fl.Centroid(samples), default_value=0.0,
    )  # fmt: skip
    words = [term.name for term in output.terms]
    rules = [
        fl.Rule.create(f'if error is {p} and rate is {v} then push is {words[codes[row][column]]}')
        for row, v in enumerate(words)
        for column, p in enumerate(words)
    ]
    block = fl.RuleBlock(
        conjunction=fl.Minimum(), implication=fl.Minimum(), activation=fl.General(), rules=rules
    )
    engine = fl.Engine('theirs', '', inputs, [output], [block])
    with fl.settings.context(decimals=17):
        return fl.FllExporter().to_string(engine)


def pyfuzzylite(text, errors):
    """Return the output of pyfuzzylite; None if it refuses the file."""
    try:
        engine = fl.FllImporter().from_string(text)
        for name, values in zip(engine.input_variables, errors, strict=True):
            name.value = values
        engine.process()
        return np.broadcast_to(engine.output_variables[0].value, errors.shape[1:])
    except (ValueError, SyntaxError, RuntimeError, LookupError, TypeError):
        return None


FLL_VALUES = {
    'description': ['a % of # it', 'x: y'],
    'enabled': ['false', 'yes'],
    'lock-range': ['true', 'false'],
    'lock-previous': ['true'],
    'aggregation': ['AlgebraicSum', 'BoundedSum', 'UnboundedSum', 'none', 'maximum'],
    'defuzzifier': [
        'Centroid 5', 'Centroid 100', 'Centroid 201', 'Centroid 1000', 'Centroid', 'Centroid -5',
        'Bisector 101', 'MeanOfMaximum 101', 'none', 'WeightedAverage',
    ],
    'default': ['nan', '0.125', 'inf', '-0.0', '-0.125'],
    'conjunction': ['AlgebraicProduct', 'none', 'BoundedDifference', 'NilpotentMinimum'],
    'implication': ['AlgebraicProduct', 'none', 'HamacherProduct'],
    'disjunction': ['Maximum', 'AlgebraicSum', 'none'],
    'activation': [
        'Threshold > 0.3', 'First 3 0.1', 'Last', 'Highest 2', 'Lowest 1', 'Proportional', 'none'
    ],
}  # fmt: skip
"""What another tool may have there."""


def other_numbers(draw, line):
    """Return a line of which one number is another."""
    found = list(re.finditer(r'(?<=[\s\[])-?\d+\.?\d*', line))
    at = draw(st.sampled_from(found))
    factor = draw(st.sampled_from([1.5, 1.01, 0.99, 0.5, 0.0, -1.0, 3.0]))
    shift = draw(st.sampled_from([0.0, 0.01, -0.01]))
    return f'{line[: at.start()]}{float(at[0]) * factor + shift!r}{line[at.end() :]}'


@st.composite
def changed_fll(draw, text):
    """Return the key of the line that was changed, and the text."""
    lines = text.splitlines()
    at = draw(st.sampled_from([i for i, line in enumerate(lines) if line.startswith('  ')]))
    key, _, value = lines[at].strip().partition(': ')
    change = draw(st.sampled_from(['as it is', 'value', 'value', 'value', 'drop', 'twice', 'new']))
    if change == 'value' and key == 'rule':
        old, new = draw(
            st.sampled_from(
                [
                    (' is ', ' is very '), (' and ', ' or '), ('$', ' with 0.5'),
                    ('(?<= is )at$', 'above'), ('then push', 'then rate'),
                    (' is ', ' is not '), ('$', ' and push is at'),
                ]
            )
        )  # fmt: skip
        lines[at] = re.sub(old, new, lines[at], count=1)
    elif change == 'value' and key in ('term', 'range'):
        text_of_it = draw(st.sampled_from(['number', 'number', 'height', 'kind']))
        lines[at] = {
            'number': lambda: other_numbers(draw, lines[at]),
            'height': lambda: f'{lines[at]} 0.5',
            'kind': lambda: lines[at].replace('Triangle', 'Bell'),
        }[text_of_it]()
    elif change == 'value':
        lines[at] = f'  {key}: {draw(st.sampled_from(FLL_VALUES[key]))}'
    elif change == 'drop':
        del lines[at]
    elif change == 'twice':
        other = draw(st.sampled_from(FLL_VALUES.get(key, [value])))
        lines.insert(at + draw(st.integers(0, 1)), f'  {key}: {other}')
    elif change == 'new':
        key = draw(st.sampled_from(['weight', 'resolution', 'default', 'activation', 'range']))
        lines.insert(at, f'  {key}: 1.0 2.0')
    return key, '\n'.join(lines)


@settings(max_examples=30)
@given(PARTS, FEET, free_rules, st.sampled_from([3, 51, 101]), st.data())
def test_a_fll_with_another_line_is_refused_by_name_or_has_the_output_of_pyfuzzylite(
    parts, inside, rules, samples, data
):
    key, text = data.draw(changed_fll(engine_text(parts, inside, rules.codes.tolist(), samples)))
    errors = points(SCALES)
    theirs = pyfuzzylite(text, errors)
    try:
        read = formats.controller_of(formats.read_fll(text), 'theirs', (None, None, None))
    except InputError as error:
        found = (
            'term|rule|range|error|rate|push' if key in ('term', 'rule', 'range') else f'`{key}`'
        )
        assert re.search(found, str(error))
    else:
        assert theirs is not None
        np.testing.assert_allclose(ours(read, errors), theirs, rtol=0, atol=SAME * SCALES[2])


def fis_text(parts, inside, codes, shuffle):
    """Return a file as MATLAB writes it; the words of a variable in any order."""
    blocks = [
        "[System]\nName='theirs'\nType='mamdani'\nVersion=2.0\nNumInputs=2\nNumOutputs=1\n"
        "NumRules=25\nAndMethod='min'\nOrMethod='max'\nImpMethod='min'\nAggMethod='max'\n"
        "DefuzzMethod='centroid'\n"
    ]
    places = []
    names = ('Input1', 'Input2', 'Output1')
    for name, part, scale, within in zip(names, parts, SCALES, inside, strict=True):
        order = list(range(5))
        shuffle.shuffle(order)
        feet = triangles(part, scale, within)
        lines = [
            f"MF{order[i] + 1}='{WORDS[i]}':'trimf',[{' '.join(map(repr, row))}]"
            for i, row in enumerate(feet.tolist())
        ]
        places.append([i + 1 for i in order])
        blocks.append(
            f"[{name}]\nName='its {name}'\nRange=[{-scale} {scale}]\nNumMFs=5\n"
            + ''.join(f'{line}\n' for line in lines)
        )
    shuffle.shuffle(blocks)
    p, v, f = places
    rules = [
        f'{p[column]} {v[row]}, {f[codes[row][column]]} (1) : 1'
        for row in range(5)
        for column in range(5)
    ]
    return '\n'.join([*blocks, '[Rules]', *rules])


def matlab(text):
    """Return errors (2, n) within the ranges, and what MATLAB's sums give; None if it refuses."""
    found = dict(re.findall(r'^\[(\w+)\]\n((?:(?!\[).*\n?)*)', text, re.M))
    ranges, words = [], []
    for name in ('Input1', 'Input2', 'Output1'):
        numbers = re.search(r'Range=\[(\S+) (\S+)\]', found[name])
        rows = dict(re.findall(r"MF(\d)='.*':'trimf',\[(.*)\]", found[name]))
        if numbers is None or sorted(rows) != list('12345'):
            return None
        ranges.append([float(number) for number in numbers.groups()])
        words.append([[float(x) for x in rows[i].split()] for i in '12345'])
    rules = re.findall(r'^(\d) (\d), (\d) \((\S+)\) : 1$', found['Rules'], re.M)
    if any(low >= high for low, high in ranges):
        return None
    draw = np.random.default_rng(4).uniform(size=(2, 150))
    low, high = np.array(ranges[:2]).T
    errors = low[:, None] + draw * (high - low)[:, None]
    x = np.linspace(*ranges[2], 101)
    try:
        grades = [
            [skfuzzy.trimf(values, word) for word in each]
            for values, each in zip((*errors, x), words, strict=True)
        ]
    except (AssertionError, ValueError):
        return None
    total = np.zeros((len(errors.T), len(x)))
    for p, v, f, weight in rules:
        fired = np.fmin(grades[0][int(p) - 1], grades[1][int(v) - 1]) * float(weight)
        total = np.fmax(total, np.fmin(fired[:, None], grades[2][int(f) - 1]))
    area = total.sum(axis=1)
    return errors, np.divide(total @ x, area, out=np.zeros(len(area)), where=area > 0.0)


FIS_VALUES = {
    'Name': ["''", "'a b'"],
    'Type': ["'sugeno'", 'mamdani'],
    'Version': ['1.0', '2', '3.0'],
    'NumInputs': ['3', '--2', '-2', 'two'],
    'NumOutputs': ['2', '-1', '0'],
    'NumRules': ['24', '-25', '26', ''],
    'NumMFs': ['4', '-5', '5.5'],
    'AndMethod': ["'prod'", "'max'"],
    'OrMethod': ["'probor'", "'sum'"],
    'ImpMethod': ["'prod'", "''"],
    'AggMethod': ["'sum'", "'probor'"],
    'DefuzzMethod': ["'bisector'", "'mom'", "'som'", "'lom'", "'wtaver'"],
}
CHANGES_OUTPUT = {'AndMethod', 'ImpMethod', 'AggMethod', 'DefuzzMethod'}
MUST_BE_SO = {'Type', 'Version', 'NumInputs', 'NumOutputs', 'NumRules', 'NumMFs', 'OrMethod'}


@st.composite
def changed_fis(draw, text):
    """Return the key of the line that was changed, whether it must be refused, and the text."""
    lines = text.splitlines()
    at = draw(st.sampled_from([i for i, x in enumerate(lines) if x and x[0] != '[']))
    line = lines[at]
    key = line.partition('=')[0] if '=' in line else 'rule'
    change = draw(st.sampled_from(['as it is', 'value', 'value', 'value', 'drop', 'twice', 'new']))
    wrong = False
    if change == 'value' and key in FIS_VALUES:
        value = draw(st.sampled_from(FIS_VALUES[key]))
        lines[at] = f'{key}={value}'
        wrong = key in CHANGES_OUTPUT | MUST_BE_SO and value not in ('2', 'mamdani')
    elif change == 'value' and key == 'rule':
        lines[at] = draw(
            st.sampled_from(
                [line.replace('(1)', '(0.5)'), line[:-1] + '2', '-' + line, line + ' 1']
            )
        )
        wrong = '(0.5)' not in lines[at]
    elif change == 'value':
        lines[at] = other_numbers(draw, line)
    elif change == 'drop':
        del lines[at]
        wrong = key in CHANGES_OUTPUT | {'rule'}
    elif change == 'twice':
        lines.insert(at, line)
        wrong = True
    elif change == 'new':
        key, wrong = draw(st.sampled_from(['NumSamples', 'MF6', 'Weight'])), True
        lines.insert(at, f'{key}=5')
        key = 'rule' if lines[at + 1][0].isdigit() else key
    return key, wrong, '\n'.join(lines)


@settings(max_examples=40)
@given(PARTS, st.tuples(*[st.booleans()] * 3), free_rules, st.integers(0, 99), st.data())
def test_a_fis_with_another_line_is_refused_by_name_or_has_the_output_of_matlab(
    parts, inside, rules, seed, data
):
    text = fis_text(parts, inside, rules.codes.tolist(), random.Random(seed))
    key, wrong, text = data.draw(changed_fis(text))
    theirs = matlab(text)
    try:
        read = formats.controller_of(formats.read_fis(text), 'theirs', (None, None, None))
    except InputError as error:
        assert re.search(rf'{key}|Input|Output|rule', str(error))
    else:
        assert theirs is not None and not wrong
        errors, forces = theirs
        np.testing.assert_allclose(ours(read, errors), forces, rtol=0, atol=SAME * SCALES[2])


@pytest.mark.parametrize('suffix', ['fis', 'fll'])
def test_a_byte_order_mark_and_lines_of_windows_change_nothing(suffix, tmp_path):
    text, path = text_of(load_controller('handmade'), suffix), tmp_path / f'mine.{suffix}'
    path.write_bytes(b'\xef\xbb\xbf' + text.replace('\n', '\r\n').encode())
    done = invoke('import', path, '-o', tmp_path / 'handmade.yaml')
    assert done.exit_code == 0, done.stderr
    assert load_controller(tmp_path / 'handmade.yaml') == load_controller('handmade')


@pytest.mark.parametrize('reach', [1.0, 1.5])
def test_a_fll_whose_samples_end_elsewhere_is_refused_with_the_range_that_would_do(reach):
    """Range [-1.5, 1.5] with peaks at 1 gave -0.4837 for -0.7205."""
    parts = [load_controller('handmade').system.position] * 3
    codes = load_controller('handmade').system.rules.codes.tolist()
    text = engine_text(parts, (False, False, False), codes, reach=reach)
    with pytest.raises(InputError, match=r'`push`: `range` must be \[-1\.01 S, 1\.01 S\]'):
        formats.controller_of(formats.read_fll(text), 'theirs', (None, None, None))
    text = engine_text(parts, (False, False, True), codes)
    with pytest.raises(InputError, match=r'outer feet outside the range, like -1\.01 and 1\.01'):
        formats.controller_of(formats.read_fll(text), 'theirs', (None, None, None))
