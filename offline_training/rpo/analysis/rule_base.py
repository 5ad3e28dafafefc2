# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Warnings about a rule base: holes in coverage, idle rules, wrong order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple, dataclass
from itertools import pairwise

import numpy as np

from rpo.proof import surface
from rpo_core.control.explain import SPOKEN
from rpo_core.control.fuzzy import WORDS, FuzzySystem, MembershipFunctions


def holes(functions: MembershipFunctions) -> tuple[tuple[float, float], ...]:
    """Return the intervals of |x| in [0, 1] where no word has membership; exact.

    An interval may be a single point. The negative side mirrors the positive.
    """
    points = np.unique([*np.clip(astuple(functions), 0.0, 1.0), 0.0, 1.0]).tolist()
    pairs = [*pairwise(points), *zip(points, points, strict=True)]
    bare = [(low, high) for low, high in pairs if not functions.grades((low + high) / 2).any()]
    merged: list[tuple[float, float]] = []
    for low, high in sorted(bare):
        if merged and low <= merged[-1][1]:
            merged[-1] = merged[-1][0], max(high, merged[-1][1])
        else:
            merged.append((low, high))
    return tuple(merged)


@dataclass(frozen=True)
class Activity:
    """Where a rule acts, as shares of the input square (of a grid that holds every breakpoint).

    fires : strength > 0
    decides : and no other rule with the same consequent is as strong
    """

    position: str
    velocity: str
    force: str
    fires: float
    decides: float


GRID = 1 / 100
"""Widest step of the grid on which `activities` counts."""


def activities(system: FuzzySystem) -> tuple[Activity, ...]:
    """Return the activity of the 25 rules, row by row of the table."""
    e = surface.divided(surface.breakpoints(system.position), GRID)
    v = surface.divided(surface.breakpoints(system.velocity), GRID)
    position, velocity = system.position.grades(e).T, system.velocity.grades(v).T
    codes = system.rules.codes
    strengths = {(i, j): np.minimum(velocity[i][:, None], position[j]) for i, j in np.ndindex(5, 5)}
    activity = []
    for (i, j), strength in strengths.items():
        others = [strengths[k] for k in strengths if k != (i, j) and codes[k] == codes[i, j]]
        other = np.maximum.reduce(others) if others else np.zeros_like(strength)
        word = WORDS[codes[i, j]]
        fires, decides = float((strength > 0.0).mean()), float((strength > other).mean())
        activity.append(Activity(WORDS[j], WORDS[i], word, fires, decides))
    return tuple(activity)


FORCES = 'Force, and the share of the input square where the rule decides its word'
"""What the table `force_rows` shows."""


def force_rows(system: FuzzySystem) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return headings and rows of the rule table, each cell with the share where it decides.

    Large positive velocity errors come first: up, as in the pictures of the surface.
    """
    shares = activities(system)
    rows = []
    for row, word in enumerate(WORDS):
        cells = shares[5 * row : 5 * row + 5]
        forces = (f'{cell.force} {cell.decides:.0%}' for cell in cells)
        rows.append((f'{word} ({SPOKEN[word]})', *forces))
    return ('velocity error ↑ position error →', *WORDS), rows[::-1]


WELL = 'Every rule decides somewhere, no hole, the rules are monotone.'
"""What holds where there are no `warnings`."""


def warnings(system: FuzzySystem) -> tuple[str, ...]:
    """Return the warnings about a rule base, a sentence each."""
    return tuple(_warnings(system))


def _warnings(system: FuzzySystem) -> Iterator[str]:
    inputs = ('position', system.position), ('velocity', system.velocity)
    for name, functions in inputs:
        for low, high in holes(functions):
            place = f'is {low:g}' if low == high else f'is between {low:g} and {high:g}'
            yield (
                f'hole in coverage: no word fits a {name} error whose size {place}; '
                'no rule fires there, and the force is 0'
            )
    tables = system.tables
    for grades, words in ((tables.sp, 'SN and SP'), (tables.lp, 'LN and LP')):
        if not any(grades):
            yield f'force words {words} fall between the output samples: they have no effect'
    for rule in activities(system):
        place = f'rule (velocity {rule.velocity}, position {rule.position}) → {rule.force}'
        if rule.fires == 0.0:
            yield f'{place} never fires'
        elif rule.decides == 0.0:
            yield f'{place} never decides: others that say {rule.force} are as strong'
    table, codes = system.rules.words, system.rules.codes
    for i, j in np.ndindex(5, 5):
        for other, k, m in (('position', i, j + 1), ('velocity', i + 1, j)):
            if k < 5 and m < 5 and codes[k, m] < codes[i, j]:
                yield (
                    f'not monotone: as the {other} error grows from (velocity {WORDS[i]}, '
                    f'position {WORDS[j]}) to (velocity {WORDS[k]}, position {WORDS[m]}), '
                    f'the force falls from {table[i][j]} to {table[k][m]}'
                )
    for name, functions in inputs:
        if not surface.is_continuous(functions):
            yield f'{name} word SP has a vertical edge: the force jumps there'
