# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""FuzzyLite Language `.fll`.

FuzzyLite integrates over the middles of equal cells: on a range wider by half a cell on each side
they are the kernel's samples, so that the centroids are equal but for rounding.
"""

from __future__ import annotations

from rpo_core.control.controller import FuzzyController
from rpo_export import parts


def text(controller: FuzzyController) -> str:
    """Return the `.fll` text of a controller."""
    samples = controller.system.samples
    edge = 1.0 + 1.0 / (samples - 1)
    lines = [f'# {line}' for line in parts.facts(controller)]
    lines.append(f'Engine: {parts.one_line(controller.name)}')
    *inputs, output = parts.variables(controller)
    for variable in inputs:
        lines += [
            f'InputVariable: {variable.name}',
            '  enabled: true',
            '  range: -1.0 1.0',
            '  lock-range: true',
            *_terms(variable),
        ]
    lines += [
        f'OutputVariable: {output.name}',
        '  enabled: true',
        f'  range: {-edge!r} {edge!r}',
        '  lock-range: false',
        '  aggregation: Maximum',
        f'  defuzzifier: Centroid {samples}',
        '  default: 0.0',
        '  lock-previous: false',
        *_terms(output),
        'RuleBlock: rules',
        '  enabled: true',
        '  conjunction: Minimum',
        '  disjunction: none',
        '  implication: Minimum',
        '  activation: General',
    ]
    for rule in parts.rules(controller):
        lines.append(
            f'  rule: if position_error is {rule.position} and velocity_error is '
            f'{rule.velocity} then force is {rule.force}'
        )
    return '\n'.join(lines) + '\n'


def _terms(variable: parts.Variable) -> list[str]:
    return [f'  term: {word} Triangle {" ".join(map(repr, feet))}' for word, feet in variable.terms]
