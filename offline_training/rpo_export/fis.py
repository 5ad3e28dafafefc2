# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""MATLAB Fuzzy Logic Toolbox `.fis` (version 2.0); `evalfis` gives the kernel's output."""

from __future__ import annotations

from rpo_core.control.controller import FuzzyController
from rpo_core.control.fuzzy import DEFAULT_SAMPLES, WORDS
from rpo_export import parts

_HEAD = """[System]
Name='{name}'
Type='mamdani'
Version=2.0
NumInputs=2
NumOutputs=1
NumRules=25
AndMethod='min'
OrMethod='max'
ImpMethod='min'
AggMethod='max'
DefuzzMethod='centroid'
"""


def text(controller: FuzzyController) -> str:
    """Return the `.fis` text of a controller."""
    comments = parts.facts(controller)
    samples = controller.system.samples
    if samples != DEFAULT_SAMPLES:
        comments.append(f'evaluate with evalfisOptions(NumSamplePoints={samples})')
    head = _HEAD.format(name=parts.one_line(controller.name))
    blocks = [head]
    names = ('Input1', 'Input2', 'Output1')
    for name, variable in zip(names, parts.variables(controller), strict=True):
        lines = [f'[{name}]', f"Name='{variable.name}'", 'Range=[-1 1]', 'NumMFs=5']
        for number, (word, feet) in enumerate(variable.terms, 1):
            lines.append(f"MF{number}='{word}':'trimf',[{' '.join(map(repr, feet))}]")
        blocks.append('\n'.join(lines) + '\n')
    place = {word: i for i, word in enumerate(WORDS, 1)}
    rules = [
        f'{place[rule.position]} {place[rule.velocity]}, {place[rule.force]} (1) : 1'
        for rule in parts.rules(controller)
    ]
    blocks.append('\n'.join(['[Rules]', *rules]) + '\n')
    return ''.join(f'% {line}\n' for line in comments) + '\n'.join(blocks)
