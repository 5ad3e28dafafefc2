# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Controllers of a family (`rpo_ctrl.family`) as JSON, Python, C and FuzzyLite."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np

from rpo_core import kernels
from rpo_core.control.controller import to_document
from rpo_core.files.validation import InputError, choice
from rpo_ctrl import baseline_kernels
from rpo_ctrl.family import Family
from rpo_ctrl.table import ForceTable
from rpo_ctrl.time_to_go import TimeToGo
from rpo_export import c, parts
from rpo_export.python import source

_KERNELS: tuple[Callable[..., Any], ...] = (
    kernels.saturate,
    baseline_kernels.interval,
    baseline_kernels.pace_inputs,
    baseline_kernels.pace_force,
    baseline_kernels.axis_force,
)

_MODULE = '''{facts}
"""Commanded force of the controller `{name}`; exported by `rpo export`.

The bits are those of the flown kernel. Positions in m, velocities in m/s, forces in N, target LVLH.
"""
from collections import namedtuple

Law = namedtuple('Law', 'gains distances paces forces lead_s limit')

# Gains of position [N/m] and velocity [N s/m] at each tick; the last ones stay.
GAINS = (
{gains}
)

LAW = Law(
    gains=[(k, 0.0, 0.0, d) for k, d in zip(GAINS[::2], GAINS[1::2])],
{tables}
    lead_s={lead_s!r},
    limit={limit!r},
)


def force_n(position_m, velocity_m_s, tick=0):
    """Commanded force (fx, fy, fz) of a finite relative state at a tick of the run."""
    return tuple(axis_force(r, v, tick, LAW) for r, v in zip(position_m, velocity_m_s))


{functions}
'''


def _python(controller: Family) -> str:
    law = controller.law
    if not controller.alike:
        raise InputError(f'`--to python` needs a law that treats all axes alike; {controller.name}')
    gains = np.asarray(law.gains, dtype=np.float64).reshape(-1, baseline_kernels.GAINS)[:, [0, 3]]
    return _MODULE.format(
        facts='\n'.join(f'# {line}' for line in parts.named(controller)),
        name=parts.one_line(controller.name),
        gains=parts.listed(gains.ravel().tolist(), 4, 88),
        tables='\n'.join(
            f'    {name}=(\n{parts.listed(np.asarray(getattr(law, name)).tolist(), 8, 88)}\n    ),'
            for name in ('distances', 'paces', 'forces')
        ),
        lead_s=law.lead_s,
        limit=law.limit,
        functions='\n\n\n'.join(map(source, _KERNELS)),
    )


def _json(controller: Family) -> str:
    tables = [table._asdict() for table in controller.tables()]
    document = {
        'about': parts.named(controller),
        'controller': to_document(controller),
        'rules': tables,
        'claims': [claim._asdict() for claim in controller.claims()],
    }
    return json.dumps(document, indent=2, ensure_ascii=False, default=str) + '\n'


def _fll(controller: Family) -> str:
    lines = [f'# {line}' for line in parts.named(controller)]
    if isinstance(controller, ForceTable):
        return '\n'.join([*lines, *_force_table(controller)]) + '\n'
    if isinstance(controller, TimeToGo):
        return '\n'.join([*lines, *_time_to_go(controller)]) + '\n'
    raise InputError(f'`--to fll` does not know kind {controller.kind}; there are json and python')


def _force_table(controller: ForceTable) -> list[str]:
    """Return a table of forces by distance and another input."""
    lead_s, second = controller.lead_or_0_s, controller.second.replace(' ', '_')
    about = '# distance = |r|; closing speed of an axis = -sign(r) v'
    if lead_s:
        about = f'# h = {lead_s!r} s x closing speed; distance = |r| + |h|; pace = h / distance'
    words, others = (
        [word.replace(' ', '_') for word in some]
        for some in (controller.distances, controller.seconds)
    )
    constants, rules = [], []
    for i, distance in enumerate(words):
        for j, other in enumerate(others):
            force = controller.table_n[i][j]
            constants.append(f'  term: {distance}_{other} Constant {force!r}')
            rules.append(
                f'  rule: if distance is {distance} and {second} is {other} then pull is '
                f'{distance}_{other}'
            )
    return [
        about,
        f'# force of the axis = -sign(r) pull, saturated at {controller.max_force_n!r} N.',
        f'Engine: {parts.one_line(controller.name)}',
        *_input('distance', words, list(controller.peaks_m)),
        *_input(second, others, list(controller.second_peaks)),
        *_output('pull', constants),
        *rules,
    ]


def _time_to_go(controller: TimeToGo) -> list[str]:
    rules = list(reversed(controller.rules))
    words = [rule.time_to_go.replace(' ', '_') for rule in rules]
    linear = [
        f'  term: {word} Linear 0.0 {-rule.position_gain_n_m!r} {-rule.velocity_gain_n_s_m!r} 0.0'
        for word, rule in zip(words, rules, strict=True)
    ]
    free = '  enabled: true', '  range: -inf inf', '  lock-range: false'
    return [
        f'# time_to_go = max({controller.arrival_s!r} s - time since the start, 0); force of the',
        f'# axis saturated at {controller.max_force_n!r} N.',
        f'Engine: {parts.one_line(controller.name)}',
        *_input('time_to_go', words, [rule.peak_s for rule in rules]),
        *('InputVariable: position', *free),
        *('InputVariable: velocity', *free),
        *_output('force', linear),
        *(f'  rule: if time_to_go is {word} then force is {word}' for word in words),
    ]


def _input(name: str, words: list[str], peaks: list[float]) -> list[str]:
    found = [float(peak) for peak in peaks]
    low, high = [found[0], *found[:-1]], [*found[1:], found[-1]]
    return [
        f'InputVariable: {name}',
        '  enabled: true',
        f'  range: {found[0]!r} {found[-1]!r}',
        '  lock-range: true',
        *(
            f'  term: {word} Triangle {a!r} {b!r} {c!r}'
            for word, a, b, c in zip(words, low, found, high, strict=True)
        ),
    ]


def _output(name: str, terms: list[str]) -> list[str]:
    return [
        f'OutputVariable: {name}',
        '  enabled: true',
        '  range: -inf inf',
        '  lock-range: false',
        '  aggregation: none',
        '  defuzzifier: WeightedAverage TakagiSugeno',
        '  default: 0.0',
        '  lock-previous: false',
        *terms,
        'RuleBlock: rules',
        '  enabled: true',
        '  conjunction: AlgebraicProduct',
        '  disjunction: none',
        '  implication: none',
        '  activation: General',
    ]


FORMATS: dict[str, Callable[[Family], str]] = {
    'fll': _fll,
    'json': _json,
    'python': _python,
    'c': c.text,
}


def text(controller: Family, name: str) -> str:
    """Return a controller in one of `FORMATS`; raises InputError."""
    return FORMATS[choice('--to', name, FORMATS)](controller)
