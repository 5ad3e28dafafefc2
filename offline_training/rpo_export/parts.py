# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What the formats share: variables with their triangles, rules, and the facts for a comment."""

from __future__ import annotations

import re
import textwrap
from typing import Any, NamedTuple

import numpy as np

from rpo_core.control.controller import FuzzyController
from rpo_core.control.fuzzy import WORDS, MembershipFunctions

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


def facts(controller: FuzzyController) -> list[str]:
    """Return the lines of a comment for a person and for `rpo import`."""
    lines = [
        f'{one_line(controller.name)}: fuzzy controller of one axis of a final approach',
        *([one_line(controller.description)] if controller.description.strip() else []),
        'position_error = -position / position_scale, velocity_error = -velocity / velocity_scale,',
        'both saturated to [-1, 1]; force on that axis = force * force_scale',
    ]
    scales = zip(SCALES, controller.scales, strict=True)
    lines += [f'rpo: {name} = {value!r}' for name, value in scales]
    return [*lines, f'rpo: samples = {controller.system.samples}']


def named(controller: Any) -> list[str]:
    """Return what any controller says of itself, for a comment."""
    lines = [f'{controller.name}: {controller.description}', 'exported by rpo export']
    return [one_line(line) for line in lines]


def listed(values: Any, indent: int, width: int) -> str:
    """Return numbers that read back bit for bit, in indented lines of at most `width`."""
    text = ', '.join(map(repr, np.asarray(values).tolist()))
    space = ' ' * indent
    return textwrap.fill(text, width, initial_indent=space, subsequent_indent=space)


def one_line(text: str) -> str:
    """Return a text that ends no comment and no quotation of any of the formats."""
    return re.sub(r"[*%#'\"\\]", ' ', ' '.join(text.split()))
