# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Moving the sets of cells: what their tubes say, and halves of those that say too little."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rpo_core.judge.metrics import Windows, windows_of
from rpo_proof import apart, merging
from rpo_proof.apart import ALONE, Beside
from rpo_proof.cells import (
    VALUES,
    Cell,
    Found,
    Layout,
    Targets,
    checkpoint_ticks,
    halves,
    joint,
    widths,
)
from rpo_proof.merging import Limits, Stage
from rpo_proof.problem import Problem
from rpo_proof.sets import MOST, Rest
from rpo_proof.slew import Strip
from rpo_proof.tube import Motion, Trace, fill_slew, fly

Floats = NDArray[np.float64]

LONGER = 2
"""A tube may take so many times the time of the scenario to rest."""

DEEPEST, DEEPEST_APART = 16, 24
"""Halvings of a cell, at most: across two or four sides, or those of unknown constants."""

MOST_TUBES, MOST_TUBES_APART = 240, 2000
"""Tubes for each first cell of a unit, after which no more cells are halved."""

WIDEST = (8.0, 1.0)
"""Half-widths [m], [m/s] at which a tube is given up."""


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
        self.layout = Layout.of(problem, group)
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
        known = self.trace.weights[: self.motion.carried.shape[1]].tolist()
        if not self.apart or not known:
            return widths(cell)
        return [0.0] * len(self.motion.a) + known

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
        if self.apart:
            return self._merged(cell), -1
        motion = self.motion_of(cell)
        c, g, d, m = self.start(cell)
        n = len(c)
        widest = np.repeat(WIDEST, n // 2)
        until = max(self.problem.hold_tick, self.problem.scenario.ticks)
        last, resting, _ = fly(
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
        if last >= until and math.isfinite(self.slew_n_s):
            fill_slew(self.problem.table, motion, self.trace, last, self.slew_n_s)
        else:
            self.trace.slew[:] = np.inf
        return int(last), int(resting)

    def stages(self, cell: Cell) -> Iterator[Stage]:
        """Yield the stages of a cell, where axes are apart."""
        (r, v), (half_m, half) = cell.centre[:2], cell.half[:2]
        settings = self.problem.settings
        limits = Limits((settings.cell_m, settings.cell_m_s), WIDEST, self.slew_n_s)
        start = Strip(r, v, half_m, 0.0, half)
        motion, hold = self.motion_of(cell), self.problem.hold_tick
        yield from merging.stages(self.problem.table, motion, start, hold, limits)

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
                t.slew[: judged - 1].max(initial=0.0),
                commands.max(),
                size[: judged + 1, p:].max(),
                (least**2).sum() * dt,
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
        if not self.apart:
            return np.zeros((2, self.layout.reach, len(self.motion.a)))
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

        targets : None, where every claim is refuted already: then nothing is known of them
        """
        if targets is None:
            return self.nothing(cells)
        goals = np.array(targets)
        names = [VALUES.index(name) for name in Targets._fields]
        rows, boxes, tails, done = [], [], [], []
        deepest = DEEPEST_APART if self.apart else DEEPEST
        most = (MOST_TUBES_APART if self.apart else MOST_TUBES) * len(cells)
        if not np.isfinite(self.motion.pushed).all():
            most = 0  # nothing is known of the other axis: no smaller cell helps
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

    def nothing(self, cells: list[Cell]) -> Found:
        """Return the cells, of which nothing is known."""
        n, k = len(self.motion.a), len(cells)
        values = np.full((k, len(VALUES)), np.inf)
        values[:, :2] = 0.0
        reach = np.array([-np.inf, np.inf])[:, None, None] * np.ones((self.layout.reach, n))
        return Found(
            np.array([cell.centre for cell in cells]),
            np.array([cell.half for cell in cells]),
            values,
            np.full((k, self.layout.checkpoints, 2, n), np.nan),
            np.full((1, *self.above.shape[1:]), np.inf),
            reach,
        )

    def arrived(self, row: Floats) -> bool:
        """Whether a tube comes to rest or, where that is not asked for, lasts to the end."""
        return bool(np.isfinite(row[3])) and (bool(np.isfinite(row[2])) or not self.problem.rests)
