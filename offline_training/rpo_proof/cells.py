# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Cells of starts, their tubes, and what each tube says; cells that say too little are halved."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.judge.metrics import windows_of
from rpo_proof import apart
from rpo_proof.problem import Problem
from rpo_proof.sets import WORTH_S

Floats = NDArray[np.float64]

OVERLAP = 2.0**-48
"""Share of its place and width by which a cell reaches into its neighbours."""

FINER, FINER_MOVING = 64.0, 4.0
"""Vertical cells are so much smaller, from rest and else: they are few, and add to what all planar
ones have."""

PARTS = 4
"""Parts of the range of each unknown constant, of first cells where axes are apart."""

VALUES = (
    'depth',
    'last_s',
    'rest_s',
    'hold_error_m',
    'hold_speed_m_s',
    'mean_error_m',
    'mean_speed_m_s',
    'slew_n_s',
    'force_n',
    'speed_m_s',
    'energy_low_n2s',
    'energy_high_n2s',
    'arrival_s',
)
"""Columns of what is known of a cell. Bounds of all states, commands and axes of its tube.

last_s, rest_s : end of the tube; time from which it is inside the set of rest, infinite if never
hold : from the time of hold until rest; mean : of the norm, over the scenario's window, whatever
the vertical start of a planar cell
slew : of the scenario's time; arrival : after it every axis is within 0.5 m, infinite if never
"""


CHECKPOINT_S = 10.0
"""The boxes of a tube are kept so often."""


class Cell(NamedTuple):
    """A box of starts of a group; where axes are apart, of unknown constants too."""

    centre: tuple[float, ...]
    half: tuple[float, ...]
    depth: int = 0


class Targets(NamedTuple):
    """What a cell's tube should show; infinite: not asked for."""

    hold_error_m: float
    hold_speed_m_s: float
    mean_error_m: float
    mean_speed_m_s: float
    slew_n_s: float


@dataclass(frozen=True)
class Found:
    """Cells of a unit, with what their tubes say.

    centre, half : (k, n); values : (k, len(VALUES)); boxes : (k, checkpoints, 2, n) low, high
    tail : (u, 2, ticks of the window) greatest square of the norms of position and velocity at each
        tick, of any cell of each unit
    reach : (2, N+1, 2) least and greatest state of any cell, where axes are apart; else (2, 0, n)
    """

    centre: Floats
    half: Floats
    values: Floats
    boxes: Floats
    tail: Floats
    reach: Floats

    @property
    def flown(self) -> Found:
        """The cells that are not empty."""
        some = self.column('last_s') >= 0.0
        return replace(
            self,
            centre=self.centre[some],
            half=self.half[some],
            values=self.values[some],
            boxes=self.boxes[some],
        )

    def column(self, name: str) -> Floats:
        """Return a column of values (k,)."""
        return self.values[:, VALUES.index(name)]


def checkpoint_ticks(problem: Problem) -> int:
    """Return how many ticks are between two boxes that are kept."""
    return max(1, round(CHECKPOINT_S / problem.scenario.dt_s))


class Layout(NamedTuple):
    """Lengths of the arrays of `Found`.

    sides, states : numbers of a cell, and of them those of a state
    checkpoints, tail, reach : ticks
    """

    sides: int
    states: int
    checkpoints: int
    tail: int
    reach: int

    @classmethod
    def of(cls, problem: Problem, group: str) -> Layout:
        """Return the lengths for a group."""
        states, windows = len(problem.groups[group]), windows_of(problem.scenario)
        unknown = len(apart.ranges(problem, group)) if problem.settings.axes_apart else 0
        checkpoints = windows.ticks // checkpoint_ticks(problem) + 1
        reach = problem.scenario.ticks + 1 if problem.settings.axes_apart else 0
        return cls(states + unknown, states, checkpoints, windows.tail, reach)


def roots(problem: Problem, group: str) -> list[Cell]:
    """Return the first cells, which cover the box of starts; half of it where all is odd."""
    settings, lines = problem.settings, []
    for place, i in enumerate(problem.groups[group]):
        centre, half = settings.centre[i], settings.half[i]
        low = centre - half
        if problem.odd and place == 0:
            low, half = centre, half / 2
        lines.append(_parts(low, half, max(1, math.ceil(half / _size(problem, group, i) - 1e-9))))
    if settings.axes_apart:
        lines += [_parts(b, (a - b) / 2, PARTS) for b, a in apart.ranges(problem, group)]
    return [
        Cell(tuple(c for c, _ in corner), tuple(_wider(*side) for side in corner))
        for corner in itertools.product(*lines)
    ]


def _size(problem: Problem, group: str, state: int) -> float:
    """Return the half-width of first cells in a state; where axes are apart, strips cover it."""
    settings = problem.settings
    if settings.axes_apart:
        return math.inf
    finer = 1.0
    if group == 'vertical':
        finer = FINER_MOVING if settings.half[5] else FINER
    return (settings.cell_m if state < 3 else settings.cell_m_s) / finer


def _parts(low: float, half: float, count: int) -> list[tuple[float, float]]:
    """Return the middle and half-width of equal parts of a range that begins at `low`."""
    width = 2.0 * half / count
    return [(low + (k + 0.5) * width, 0.5 * width) for k in range(count)]


def _wider(centre: float, half: float) -> float:
    """Return a half-width with which neighbours overlap, whatever was rounded."""
    return half * (1.0 + OVERLAP) + OVERLAP * abs(centre) if half > 0.0 else 0.0


def widths(cell: Cell) -> list[float]:
    """Return how much each side of a cell of positions and velocities weighs."""
    n = len(cell.half)
    return [h * (1.0 if 2 * i < n else WORTH_S) for i, h in enumerate(cell.half)]


def halves(cell: Cell, weights: list[float]) -> Iterator[Cell]:
    """Yield both halves, across the side that weighs most."""
    axis = weights.index(max(weights))
    for side in (-0.5, 0.5):
        centre, half = list(cell.centre), list(cell.half)
        centre[axis] += side * half[axis]
        half[axis] = _wider(centre[axis], 0.5 * half[axis])
        yield Cell(tuple(centre), tuple(half), cell.depth + 1)


def joint(one: Floats, other: Floats) -> Floats:
    """Return the least and greatest (2, ...) of both."""
    return np.stack([np.minimum(one[0], other[0]), np.maximum(one[1], other[1])])
