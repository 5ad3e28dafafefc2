# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Cells of starts, their tubes, and what each tube says; cells that say too little are halved."""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.metrics import Windows, windows_of
from rpo_training.proof import apart
from rpo_training.proof.apart import ALONE, Beside
from rpo_training.proof.problem import Problem
from rpo_training.proof.sets import MOST, WORTH_S, Rest
from rpo_training.proof.tube import Motion, Trace, fill_slew, fly

Floats = NDArray[np.float64]

LONGER = 2
"""A tube may take so many times the time of the scenario to rest."""

DEEPEST, DEEPEST_APART = 16, 40
"""Halvings of a cell, at most: across two or four sides, or up to eight."""

MOST_TUBES, MOST_TUBES_APART = 240, 20000
"""Tubes for each first cell of a unit, after which no more cells are halved."""

CHECKPOINT_S = 10.0
"""The boxes of a tube are kept so often."""

WIDEST = (8.0, 1.0)
"""Half-widths [m], [m/s] at which a tube is given up."""

OVERLAP = 2.0**-48
"""Share of its place and width by which a cell reaches into its neighbours."""

FINER, FINER_MOVING = 64.0, 4.0
"""Vertical cells are so much smaller, from rest and else: they are few, and add to what all planar
ones have."""

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


def roots(problem: Problem, group: str) -> list[Cell]:
    """Return the first cells, which cover the box of starts; half of it where all is odd."""
    settings, chosen = problem.settings, problem.groups[group]
    lines, finer = [], 1.0
    if group == 'vertical':
        finer = FINER_MOVING if settings.half[5] else FINER
    for place, i in enumerate(chosen):
        centre, half = settings.centre[i], settings.half[i]
        size = (settings.cell_m if i < 3 else settings.cell_m_s) / finer
        low = centre - half
        if problem.odd and place == 0:
            low, half = centre, half / 2
        count = max(1, math.ceil(half / size - 1e-9))
        width = 2.0 * half / count
        lines.append([(low + (k + 0.5) * width, 0.5 * width) for k in range(count)])
    if settings.axes_apart:
        lines += [[((b + a) / 2, (b - a) / 2)] for a, b in apart.ranges(problem, group)]
    return [
        Cell(tuple(c for c, _ in corner), tuple(_wider(*side) for side in corner))
        for corner in itertools.product(*lines)
    ]


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


class Prover(threading.local):
    """Moves the sets of a group; one for each thread.

    rest : where tubes end
    above : (u, 2, ticks of the window) squares of norms of other groups: one of them adds to these
    beside : the other axis, where axes are apart
    """

    def __init__(
        self,
        problem: Problem,
        group: str,
        rest: Rest,
        above: Floats | None = None,
        beside: Beside = ALONE,
    ) -> None:
        self.problem, self.group, self.rest = problem, group, rest
        self.apart, self.beside = problem.settings.axes_apart, beside
        self.windows: Windows = windows_of(problem.scenario)
        self.above = np.zeros((1, 2, self.windows.tail)) if above is None else above
        self.ticks = LONGER * max(problem.hold_tick, problem.scenario.ticks)
        if not problem.rests:
            self.ticks = problem.scenario.ticks
        self.motion: Motion = problem.motion(group, self.ticks)
        if beside.states is not None:
            self.motion = apart.coupled(problem, self.motion, group, beside.states)
        self.slew_n_s = problem.limits.get('slew_per_axis_n_s', math.inf)
        n = len(problem.groups[group])
        p = n // 2
        self.trace = Trace(
            np.zeros((self.ticks + 1, n)),
            np.zeros((self.ticks + 1, n)),
            np.zeros((self.ticks, p)),
            np.zeros((self.ticks, p)),
            np.zeros((self.ticks, p)),
            np.zeros((self.ticks, p, 6)),
            np.zeros(n + self.motion.carried.shape[1]),
        )

    def motion_of(self, cell: Cell) -> Motion:
        """Return what moves the set of a cell."""
        if not self.apart:
            return self.motion
        centre, half = np.array(cell.centre), np.array(cell.half)
        return apart.motion_of(self.problem, self.motion, centre, half)

    def weights(self, cell: Cell) -> list[float]:
        """Return how much each side weighs, of a cell whose tube was the last one."""
        if not self.apart:
            return widths(cell)
        n, q = len(self.motion.a), self.motion.carried.shape[1]
        started, known = self.trace.weights[q:].tolist(), self.trace.weights[:q].tolist()
        return [started.pop(0) if h > 0.0 else 0.0 for h in cell.half[:n]] + known

    def start(self, cell: Cell) -> tuple[Floats, Floats, Floats, int]:
        """Return the set of a cell: centre, generators, box, number of generators."""
        n, first = len(self.motion.a), self.motion.carried.shape[1]
        g = np.zeros((n, MOST + 4 * n))
        m = first
        for i, half in enumerate(cell.half[:n]):
            if half > 0.0:
                g[i, m] = half
                m += 1
        return np.array(cell.centre[:n]), g, np.zeros(n), m

    def fly(self, cell: Cell) -> tuple[int, int]:
        """Fill `trace`; return its last tick, and the tick from which the tube rests or -1.

        A tube that does not last, or of which no slew is asked for, has no bounds of slew.
        """
        motion = self.motion_of(cell)
        c, g, d, m = self.start(cell)
        n = len(c)
        widest = np.repeat(WIDEST, n // 2)
        until = max(self.problem.hold_tick, self.problem.scenario.ticks)
        last, resting = fly(
            self.problem.table,
            motion,
            c,
            g,
            d,
            m,
            m,
            self.rest,
            until,
            widest,
            self.problem.hold_error_m,
            self.trace,
        )
        last = self._inside(int(last))
        if last >= until and math.isfinite(self.slew_n_s):
            fill_slew(self.problem.table, motion, self.trace, last, self.slew_n_s)
        else:
            self.trace.slew[:] = np.inf
        return last, int(resting)

    def _inside(self, last: int) -> int:
        """Return the last tick at which a tube is in the corridor."""
        if self.beside.corridor is None:
            return last
        low, high = self.beside.corridor[:, : last + 1]
        left = (self.trace.low[: last + 1] < low) | (self.trace.high[: last + 1] > high)
        return min([last, *(np.flatnonzero(left.any(axis=1)) - 1).tolist()[:1]])

    def values(self, cell: Cell) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the row of a cell, the boxes at its checkpoints, its tail and its reach."""
        t, dt, p = self.trace, self.problem.scenario.dt_s, len(self.motion.a) // 2
        empty = self.is_empty(cell)
        last, resting = (-1, -1) if empty else self.fly(cell)
        size = np.maximum(-t.low[: last + 1], t.high[: last + 1])
        judged, hold = self.windows.ticks, self.problem.hold_tick
        row, squares = np.full(len(VALUES), np.inf), np.full(self.above.shape[1:], np.inf)
        row[:3] = cell.depth, last * dt, resting * dt if resting >= 0 else np.inf
        if empty:
            row[3:], squares = 0.0, np.zeros(self.above.shape[1:])
        if last >= max(judged, hold):
            late = size[hold:]
            tail = size[judged - self.windows.tail + 1 : judged + 1] ** 2
            squares = np.stack([tail[:, :p].sum(axis=1), tail[:, p:].sum(axis=1)]) * (1.0 + 1e-12)
            means = np.sqrt(squares + self.above).mean(axis=2).max(axis=0)
            commands = np.maximum(-t.force_low[:judged], t.force_high[:judged])
            least = np.maximum(np.maximum(t.force_low[:judged], -t.force_high[:judged]), 0.0)
            outside = np.flatnonzero((size[:, :p] > 0.5).any(axis=1))
            row[3:] = (
                late[:, :p].max(),
                late[:, p:].max(),
                *means,
                t.slew[: judged - 1].max(),
                commands.max(),
                size[: judged + 1, p:].max(),
                (least**2).sum() * dt,
                (commands**2).sum() * dt,
                (outside[-1] + 1) * dt if len(outside) else 0.0,
            )
            row[3:] *= 1.0 + 1e-12
            row[VALUES.index('energy_low_n2s')] *= 1.0 - 4e-12
        every = round(CHECKPOINT_S / dt)
        count = judged // every + 1
        boxes = np.full((count, 2, 2 * p), np.nan)
        shown = min(count, last // every + 1)
        for side, values in enumerate((t.low, t.high)):
            boxes[:shown, side] = values[: last + 1 : every][:shown]
        return row, boxes, squares, self._reach(last, empty)

    def _reach(self, last: int, empty: bool) -> Floats:
        """Return the least and greatest states of a tube that lasts until a tick."""
        if not self.apart:
            return np.zeros((2, 0, len(self.motion.a)))
        found = np.array([self.trace.low, self.trace.high])
        if empty:
            found[0], found[1] = np.inf, -np.inf
        else:
            found[0, last + 1 :], found[1, last + 1 :] = -np.inf, np.inf
        return found

    def is_empty(self, cell: Cell) -> bool:
        """Whether a cell holds nothing that is asked for."""
        if not self.apart:
            return False
        return apart.is_outside(
            self.problem, self.group, np.array(cell.centre), np.array(cell.half)
        )

    def prove(self, cells: list[Cell], targets: Targets | None) -> Found:
        """Return the cells, halved where a target is missed, with what is known of them.

        targets : None, where every claim is refuted already: nothing is halved
        """
        goals = np.full(len(Targets._fields), np.inf) if targets is None else np.array(targets)
        names = [VALUES.index(name) for name in Targets._fields]
        rows, boxes, tails, done = [], [], [], []
        deepest = DEEPEST_APART if self.apart else DEEPEST
        most = (MOST_TUBES_APART if self.apart else MOST_TUBES) * len(cells)
        if targets is None or not np.isfinite(self.motion.pushed).all():
            most = 0  # or nothing is known of the other axis: no smaller cell helps
        todo, tubes, reach = list(reversed(cells)), 0, None
        while todo:
            cell = todo.pop()
            row, box, squares, far = self.values(cell)
            reached = self.arrived(row) and bool((row[names] <= goals).all())
            tubes += 1
            if not reached and cell.depth < deepest and tubes < most:
                todo += reversed(list(halves(cell, self.weights(cell))))
                continue
            reach = far if reach is None else joint(reach, far)
            rows.append(row)
            boxes.append(box)
            tails.append(squares)
            done.append(cell)
        return Found(
            np.array([cell.centre for cell in done]),
            np.array([cell.half for cell in done]),
            np.array(rows),
            np.array(boxes),
            np.max(tails, axis=0)[None],
            np.empty((2, 0, 0)) if reach is None else reach,
        )

    def arrived(self, row: Floats) -> bool:
        """Whether a tube comes to rest or, where that is not asked for, lasts to the end."""
        return bool(np.isfinite(row[3])) and (bool(np.isfinite(row[2])) or not self.problem.rests)


def joint(one: Floats, other: Floats) -> Floats:
    """Return the least and greatest (2, ...) of both."""
    return np.stack([np.minimum(one[0], other[0]), np.maximum(one[1], other[1])])
