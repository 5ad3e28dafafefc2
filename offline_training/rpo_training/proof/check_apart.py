# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The checker's look at axes that are proven alone: their constants, masses and pushes."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from fractions import Fraction

import numpy as np

from rpo_core import cw
from rpo_training.proof import apart
from rpo_training.proof.cells import Cell, Found, Prover
from rpo_training.proof.exact import UNIT, exact
from rpo_training.proof.problem import APART, Problem
from rpo_training.proof.tube import Motion

DRAWN = 4
"""Constants of a cell that are drawn for each tick."""

COEFFICIENT = 32 * UNIT
"""Share by which a coefficient of the flight, or of the motion of a cell, may be rounded."""


def empty_faults(problem: Problem, group: str, found: Found) -> Iterator[str]:
    """Yield cells that are said to hold nothing, and hold a sinusoid that is asked for."""
    for k in np.flatnonzero(found.column('last_s') < 0.0).tolist():
        centre, half = found.centre[k], found.half[k]
        if not (problem.settings.axes_apart and apart.is_outside(problem, group, centre, half)):
            yield f'{group} cell {k}: is not empty'


def motion_faults(
    prover: Prover, cell: Cell, motion: Motion, tick: int, where: str
) -> Iterator[str]:
    """Yield what the motion of a cell does not hold at a tick: forces, masses, the other axis."""
    yield from _force_faults(prover, cell, motion, tick, where)
    if prover.beside.states is not None:
        bounds = prover.beside.states[:, tick].tolist()
        yield from _push_faults(prover, motion, tick, bounds, where)


def _force_faults(
    prover: Prover, cell: Cell, motion: Motion, tick: int, where: str
) -> Iterator[str]:
    """Compare the force of drawn constants, as it is flown, with the one that is carried."""
    problem, n = prover.problem, len(motion.a)
    axis, base = APART[prover.group][0], problem.scenario
    rng = np.random.default_rng(tick)
    constant, carried = exact(motion.constant[tick, 0].item()), motion.carried[tick, :, 0]
    for _ in range(DRAWN):
        xi = rng.choice([-1.0, 1.0, 0.3], len(cell.centre) - n)
        point = np.array(cell.centre[n:]) + np.array(cell.half[n:]) * xi
        drawn = apart.scenario_in(problem, prover.group, point, base)
        force = exact(drawn.disturbance.force_n(base.time_s(tick))[axis])
        shares = exact(xi.tolist())
        ours = constant + sum(x * y for x, y in zip(shares, exact(carried.tolist()), strict=True))
        if abs(force - ours) > exact(motion.any_n):
            yield f'{where}: the force of a disturbance is not the one that is carried'
        b = cw.matrices(drawn.step)[1][np.ix_(APART[prover.group], [axis])][:, 0]
        light = 1 + exact(motion.mass) * (shares[-1] if motion.mass else 0)
        for theirs, mine in zip(exact(b.tolist()), exact(motion.b[:, 0].tolist()), strict=True):
            if abs(theirs - mine * light) > COEFFICIENT * abs(theirs):
                yield f'{where}: the mass of a flight is not the one that is carried'


def _push_faults(
    prover: Prover, motion: Motion, tick: int, bounds: list[list[float]], where: str
) -> Iterator[str]:
    """Compare the push of the other axis with what it does from the corners of its bounds."""
    problem = prover.problem
    own, other = APART[prover.group], APART['y' if prover.group == 'x' else 'x']
    a, b = cw.matrices(problem.scenario.step)
    strongest = exact(problem.scenario.max_force_n) + exact(problem.strongest_n)
    heavy = (1 + exact(problem.lightness)) * (strongest + exact(motion.any_n))
    for k, row in enumerate(own):
        middle, wide = exact(motion.pushed[tick, k].item()), exact(motion.shaken[tick, k].item())
        push = heavy * abs(exact(b[row, other[0]].item()))
        for corner in itertools.product((0, 1), repeat=2):
            far = sum(
                (
                    exact(a[row, column].item()) * exact(bounds[side][i])
                    for i, (column, side) in enumerate(zip(other, corner, strict=True))
                ),
                Fraction(0),
            )
            if abs(far - middle) + push > wide:
                yield f'{where}: the other axis pushes harder, component {k}'
