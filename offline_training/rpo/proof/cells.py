# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Cells of starts and their tubes; a cell whose tube misses a target is halved."""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rpo.proof import per_axis
from rpo.proof.per_axis import UNCOUPLED, Limits, OtherAxis, Stage
from rpo.proof.problem import Problem
from rpo.proof.slew import Strip
from rpo.proof.tube import MOST, WORTH_S, InvariantSet, Motion, Trace, Zonotope, fill_slew, fly
from rpo_core.judge.metrics import Windows, windows_of
from rpo_core.kernels.arrays import Floats

OVERLAP = 2.0**-48
"""Share of its place and width by which a cell reaches into its neighbours."""

FINER, FINER_MOVING = 64.0, 4.0
"""Vertical cells are so much smaller, at rest and moving: they are few, and add to all others."""

PARTS = 4
"""Parts of the range of each unknown constant, of first cells in a proof per axis."""

VALUES = (
    'depth',
    'last_s',
    'inside_s',
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

last_s, inside_s : end of the tube; time from which it is in the invariant set, infinite if never
hold : from the time of hold until it is in that set; mean : of the norm, over the scenario's
window, whatever the vertical start of a planar cell
slew : of the scenario's time; arrival : after it every axis is within 0.5 m, infinite if never
"""


CHECKPOINT_S = 10.0
"""The boxes of a tube are fixed so often."""


class Cell(NamedTuple):
    """A box of starts of a group; in a proof per axis, of unknown constants too."""

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
class CellBounds:
    """Cells of a unit, with what their tubes say.

    centre, half : (k, n); values : (k, len(VALUES)); boxes : (k, checkpoints, 2, n) low, high
    tail : (u, 2, ticks of the window) greatest square of the norms of position and velocity at each
        tick, of any cell of each unit
    reach : (2, N+1, 2) least and greatest state of any cell, in a proof per axis; else (2, 0, n)
    """

    centre: Floats
    half: Floats
    values: Floats
    boxes: Floats
    tail: Floats
    reach: Floats

    @property
    def flown(self) -> CellBounds:
        """The cells that are not empty."""
        some, names = self.column('last_s') >= 0.0, ('centre', 'half', 'values', 'boxes')
        return replace(self, **{name: getattr(self, name)[some] for name in names})

    def column(self, name: str) -> Floats:
        """Return a column of values (k,)."""
        return self.values[:, VALUES.index(name)]


def checkpoint_ticks(problem: Problem) -> int:
    """Return how many ticks are between two boxes that are stored."""
    return max(1, round(CHECKPOINT_S / problem.scenario.dt_s))


class Layout(NamedTuple):
    """Lengths of the arrays of `CellBounds`.

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
        unknown = len(per_axis.ranges(problem, group)) if problem.settings.axes_apart else 0
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
        lines += [_parts(b, (a - b) / 2, PARTS) for b, a in per_axis.ranges(problem, group)]
    return [
        Cell(tuple(c for c, _ in corner), tuple(_wider(*side) for side in corner))
        for corner in itertools.product(*lines)
    ]


def _size(problem: Problem, group: str, state: int) -> float:
    """Return the half-width of first cells in a state; in a proof per axis, strips cover it."""
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


LONGER = 2
"""A tube may take so many times the time of the scenario to omega."""

DEEPEST, DEEPEST_PER_AXIS = 16, 24
"""Halvings of a cell, at most: across two or four sides, or those of unknown constants."""

MOST_TUBES, MOST_TUBES_PER_AXIS = 240, 2000
"""Tubes for each first cell of a unit, after which no more cells are halved."""

WIDEST = (8.0, 1.0)
"""Half-widths [m], [m/s] at which a tube is given up."""


class Prover(threading.local):
    """Moves the sets of a group; one for each thread.

    omega : the invariant set, where tubes end
    above : (u, 2, ticks of the window) squares of norms of other groups: one of them adds to these
    other_axis : what couples into the motion, in a proof per axis
    """

    def __init__(
        self,
        problem: Problem,
        group: str,
        omega: InvariantSet,
        above: Floats | None = None,
        other_axis: OtherAxis = UNCOUPLED,
    ) -> None:
        self.problem, self.group, self.omega = problem, group, omega
        self.per_axis, self.other_axis = problem.settings.axes_apart, other_axis
        self.windows: Windows = windows_of(problem.scenario)
        self.layout = Layout.of(problem, group)
        self.above = np.zeros((1, 2, self.windows.tail)) if above is None else above
        self.ticks = LONGER * max(problem.hold_tick, problem.scenario.ticks)
        if not problem.needs_invariant_set:
            self.ticks = problem.scenario.ticks
        self.motion: Motion = problem.motion(group, self.ticks)
        if other_axis.states is not None:
            self.motion = per_axis.coupled(problem, self.motion, group, other_axis.states)
        self.slew_n_s = problem.limits.get('slew_per_axis_n_s', math.inf)
        carried = self.motion.carried.shape[1]
        self.trace = Trace.empty(self.ticks, len(problem.groups[group]), carried)

    def motion_of(self, cell: Cell) -> Motion:
        """Return what moves the set of a cell."""
        if not self.per_axis:
            return self.motion
        centre, half = np.array(cell.centre), np.array(cell.half)
        return per_axis.motion_of(self.problem, self.motion, centre, half)

    def weights(self, cell: Cell) -> list[float]:
        """Return how much each side weighs, of a cell whose tube was the last one."""
        of_constants = self.trace.weights[: self.motion.carried.shape[1]].tolist()
        if not self.per_axis or not of_constants:
            return widths(cell)
        return [0.0] * len(self.motion.a) + of_constants

    def start(self, cell: Cell) -> tuple[Zonotope, int]:
        """Return the set of a cell, and the number of its generators."""
        n, first = len(self.motion.a), self.motion.carried.shape[1]
        g = np.zeros((n, MOST + 4 * n))
        m = first
        for i, half in enumerate(cell.half[:n]):
            if half > 0.0:
                g[i, m] = half
                m += 1
        return Zonotope(np.array(cell.centre[:n]), g, np.zeros(n)), m

    def fly(self, cell: Cell) -> tuple[int, int]:
        """Fill `trace`; return its last tick, and the first one in the invariant set, or -1.

        A tube that does not last, or of which no slew is asked for, has no bounds of slew.
        """
        if self.per_axis:
            return self._merged(cell), -1
        motion = self.motion_of(cell)
        widest = np.repeat(WIDEST, len(motion.a) // 2)
        until = max(self.problem.hold_tick, self.problem.scenario.ticks)
        (z, m), table, most_m = self.start(cell), self.problem.table, self.problem.hold_error_m
        last, resting, _ = fly(table, motion, z, m, self.omega, until, widest, most_m, self.trace)
        if last >= until and math.isfinite(self.slew_n_s):
            fill_slew(self.problem.table, motion, self.trace, last, self.slew_n_s)
        else:
            self.trace.slew[:] = np.inf
        return int(last), int(resting)

    def stages(self, cell: Cell) -> Iterator[Stage]:
        """Yield the stages of a cell, in a proof per axis."""
        (r, v), (half_m, half) = cell.centre[:2], cell.half[:2]
        settings = self.problem.settings
        limits = Limits((settings.cell_m, settings.cell_m_s), WIDEST, self.slew_n_s)
        start = Strip(r, v, half_m, 0.0, half)
        motion, hold = self.motion_of(cell), self.problem.hold_tick
        yield from per_axis.stages(self.problem.table, motion, start, hold, limits)

    def _merged(self, cell: Cell) -> int:
        """Fill `trace` with what holds all strips; return the last tick that all have come to."""
        t, last = self.trace, 0
        t.low[:], t.high[:], t.force_low[:], t.force_high[:] = np.inf, -np.inf, np.inf, -np.inf
        t.slew[:], t.weights[:] = 0.0, 0.0
        for stage in self.stages(cell):
            for one in stage.moved:
                made = one.trace
                ticks = slice(stage.first, stage.last)
                states = slice(ticks.start, ticks.stop + 1)
                t.weights[:] += made.weights
                t.low[states] = np.minimum(t.low[states], made.low)
                t.high[states] = np.maximum(t.high[states], made.high)
                t.force_low[ticks] = np.minimum(t.force_low[ticks], made.force_low)
                t.force_high[ticks] = np.maximum(t.force_high[ticks], made.force_high)
                t.slew[ticks] = np.maximum(t.slew[ticks], made.slew)
            last = stage.last if stage.lasts else stage.first
        return self._inside(last)

    def _inside(self, last: int) -> int:
        """Return the last tick at which a tube is in the corridor."""
        if self.other_axis.corridor is None:
            return last
        low, high = self.other_axis.corridor[:, : last + 1]
        left = (self.trace.low[: last + 1] < low) | (self.trace.high[: last + 1] > high)
        return min([last, *(np.flatnonzero(left.any(axis=1)) - 1).tolist()[:1]])

    def values(self, cell: Cell) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the row of a cell, the boxes at its checkpoints, its tail and its reach."""
        t, dt, p = self.trace, self.problem.scenario.dt_s, len(self.motion.a) // 2
        box = np.array(cell.centre), np.array(cell.half)
        empty = self.per_axis and per_axis.is_outside(self.problem, self.group, *box)
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
            min_commands = np.maximum(np.maximum(t.force_low[:judged], -t.force_high[:judged]), 0.0)
            outside = np.flatnonzero((size[:, :p] > 0.5).any(axis=1))
            row[3:] = (
                late[:, :p].max(),
                late[:, p:].max(),
                *means,
                t.slew[: judged - 1].max(initial=0.0),
                commands.max(),
                size[: judged + 1, p:].max(),
                (min_commands**2).sum() * dt,
                (commands**2).sum() * dt,
                (outside[-1] + 1) * dt if len(outside) else 0.0,
            )
            row[3:] *= 1.0 + 1e-12
            row[VALUES.index('energy_low_n2s')] *= 1.0 - 4e-12
        every = checkpoint_ticks(self.problem)
        boxes = np.full((self.layout.checkpoints, 2, 2 * p), np.nan)
        shown = min(len(boxes), last // every + 1)
        for side, values in enumerate((t.low, t.high)):
            boxes[:shown, side] = values[: last + 1 : every][:shown]
        return row, boxes, squares, self._reach(last, empty)

    def _reach(self, last: int, empty: bool) -> Floats:
        """Return the least and greatest states of a tube that lasts until a tick."""
        if empty or not self.per_axis:
            return self._bounds(np.inf, -np.inf)
        reach = np.array([self.trace.low, self.trace.high])
        reach[0, last + 1 :], reach[1, last + 1 :] = -np.inf, np.inf
        return reach

    def prove(self, cells: list[Cell], targets: Targets | None) -> CellBounds:
        """Return the cells, halved where a target is missed, with what is known of them.

        targets : None, where every claim is refuted already: then nothing is known of them
        """
        goals, nothing = np.array(targets), self.nothing()
        names = [VALUES.index(name) for name in Targets._fields]
        rows, boxes, tails, done = [], [], [], []
        deepest = DEEPEST_PER_AXIS if self.per_axis else DEEPEST
        max_tubes = (MOST_TUBES_PER_AXIS if self.per_axis else MOST_TUBES) * len(cells)
        if not np.isfinite(self.motion.coupling).all():
            max_tubes = 0  # nothing is known of the other axis: no smaller cell helps
        todo, tubes = list(reversed(cells)), 0
        reach = self._bounds(np.inf, -np.inf)
        while todo:
            cell = todo.pop()
            row, box, squares, far = nothing if targets is None else self.values(cell)
            tubes += 1
            reached = targets is None or (self.arrived(row) and (row[names] <= goals).all())
            if not reached and cell.depth < deepest and tubes < max_tubes:
                todo += reversed(list(halves(cell, self.weights(cell))))
                continue
            reach = joint(reach, far)
            rows.append(row)
            boxes.append(box)
            tails.append(squares)
            done.append(cell)
        return CellBounds(
            np.array([cell.centre for cell in done]),
            np.array([cell.half for cell in done]),
            np.array(rows),
            np.array(boxes),
            np.max(tails, axis=0)[None],
            reach,
        )

    def nothing(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the `values` of a first cell of which nothing is known."""
        row, squares = np.full(len(VALUES), np.inf), np.full(self.above.shape[1:], np.inf)
        row[:2] = 0.0
        boxes = np.full((self.layout.checkpoints, 2, len(self.motion.a)), np.nan)
        return row, boxes, squares, self._bounds(-np.inf, np.inf)

    def _bounds(self, least: float, greatest: float) -> Floats:
        """Return the same least and greatest state at every tick, as `CellBounds.reach`."""
        one = np.ones((self.layout.reach, len(self.motion.a)))
        return np.stack([least * one, greatest * one])

    def arrived(self, row: Floats) -> bool:
        """Whether a tube enters the invariant set or, without one, lasts to the end."""
        return bool(np.isfinite(row[3])) and (
            bool(np.isfinite(row[2])) or not self.problem.needs_invariant_set
        )
