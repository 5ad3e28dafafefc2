# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""IEC 61131-7 Fuzzy Control Language `.fcl`.

The standard leaves open how a tool samples the centre of gravity; expect differences of that size.
"""

from __future__ import annotations

from rpo_core.control.controller import FuzzyController
from rpo_export import parts
from rpo_montecarlo.outputs import identifier


def text(controller: FuzzyController) -> str:
    """Return the `.fcl` text of a controller."""
    *inputs, output = parts.variables(controller)
    lines = [f'(* {line} *)' for line in parts.facts(controller)]
    lines += [f'FUNCTION_BLOCK {identifier(controller.name)}', '', 'VAR_INPUT']
    lines += [f'    {variable.name} : REAL;' for variable in inputs]
    lines += ['END_VAR', '', 'VAR_OUTPUT', f'    {output.name} : REAL;', 'END_VAR']
    for variable in inputs:
        lines += ['', f'FUZZIFY {variable.name}', *_terms(variable), 'END_FUZZIFY']
    lines += [
        '',
        f'DEFUZZIFY {output.name}',
        *_terms(output),
        '    METHOD : COG;',
        '    DEFAULT := 0.0;',
        '    RANGE := (-1.0 .. 1.0);',
        'END_DEFUZZIFY',
        '',
        'RULEBLOCK rules',
        '    AND : MIN;',
        '    ACT : MIN;',
        '    ACCU : MAX;',
    ]
    for number, rule in enumerate(parts.rules(controller), 1):
        lines.append(
            f'    RULE {number} : IF position_error IS {rule.position} AND velocity_error IS '
            f'{rule.velocity} THEN force IS {rule.force};'
        )
    return '\n'.join([*lines, 'END_RULEBLOCK', '', 'END_FUNCTION_BLOCK']) + '\n'


def _terms(variable: parts.Variable) -> list[str]:
    """Return the terms; LN and LP reach beyond the range."""
    lines = []
    for word, (left, peak, right) in variable.terms:
        points = [(left, 0), (peak, 1), (right, 0)]
        shown = ' '.join(f'({x!r}, {grade})' for x, grade in points)
        lines.append(f'    TERM {word} := {shown};')
    return lines
