# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The checker's look at axes that are proven alone: constants, masses, pushes, merged strips."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from rpo_core.world import cw
from rpo_proof import apart
from rpo_proof.cells import VALUES, Cell, Found
from rpo_proof.check_ticks import set_faults
from rpo_proof.exact import UNIT, exact
from rpo_proof.merging import set_of
from rpo_proof.problem import APART, Problem
from rpo_proof.prover import Prover
from rpo_proof.slew import Strip
from rpo_proof.tube import Motion

Floats = NDArray[np.float64]

DRAWN = 4
"""Constants of a cell that are drawn for each tick."""

COEFFICIENT = 32 * UNIT
"""Share by which a coefficient of the flight, or of the motion of a cell, may be rounded."""


def empty_faults(problem: Problem, group: str, found: Found) -> Iterator[str]:
    """Yield cells without a tube that say something, or are said to hold nothing, and do."""
    nothing = np.array([np.inf, *np.zeros(len(VALUES) - 3)])
    for k in np.flatnonzero(~(found.column('last_s') > 0.0)).tolist():
        centre, half = found.centre[k], found.half[k]
        if found.column('last_s')[k] == 0.0:
            if not (found.values[k, 2:] == np.inf).all():
                yield f'{group} cell {k}: is bounded without a tube'
            if not (found.tail == np.inf).all(axis=(1, 2)).any():
                yield f'{group} cell {k}: its norms are bounded without a tube'
            if not np.isinf(found.reach[:, 1:]).all():
                yield f'{group} cell {k}: is said to reach something, without a tube'
        elif not (problem.settings.axes_apart and apart.is_outside(problem, group, centre, half)):
            yield f'{group} cell {k}: is not empty'
        elif not np.array_equal(found.values[k, 2:], nothing):
            yield f'{group} cell {k}: says something of what is empty'


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
            if not abs(theirs - mine * light) <= COEFFICIENT * abs(theirs):
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


def merging_faults(
    prover: Prover, cell: Cell, ticks: set[int], rng: np.random.Generator, name: str
) -> Iterator[str]:
    """Yield what is wrong with the strips of a cell: their cover, and one of each stage moved."""
    motion = prover.motion_of(cell)
    (r, v), (half_m, half) = cell.centre[:2], cell.half[:2]
    held = [Strip(r, v, half_m, 0.0, half)]
    for stage in prover.stages(cell):
        where = f'{name}, strips of tick {stage.first}'
        strips = [one.strip for one in stage.moved]
        if stage.lasts and not all(is_covered(one, strips) for one in held):
            yield f'{where}: they do not hold what the earlier ones have become'
        held = stage.ends
        one = stage.moved[int(rng.integers(len(strips)))]
        if one.end is None:
            continue
        numbers = range(stage.first, stage.last)
        drawn = ticks & set(numbers)
        for tick in sorted(drawn):
            yield from motion_faults(prover, cell, motion, tick, f'{name}, tick {tick}')
        c, g, d, m = set_of(one.strip, motion.carried.shape[1])
        yield from start_faults(one.strip, c, g[:, :m], d, where)
        m = yield from set_faults(prover.problem, motion, (c, g, d, m), numbers, drawn, name)
        yield from end_faults(one.end, c, g[:, :m], d, where)


def start_faults(strip: Strip, c: Floats, g: Floats, d: Floats, where: str) -> Iterator[str]:
    """Yield why a set does not hold the strip that it begins as."""
    r, v, half_m, tilt, half = exact(list(strip))
    (along, up), across = exact(g[:, -2].tolist()), exact(g[:, -1].tolist())
    same = exact(c.tolist()) == [r, v] and along == half_m and across == [0, half]
    if not same or abs(up - tilt * half_m) > exact(d[1].item()):
        yield f'{where}: the set is not the strip'


def end_faults(strip: Strip, c: Floats, g: Floats, d: Floats, where: str) -> Iterator[str]:
    """Yield why a strip does not hold the set that another one has become."""
    r, v, half_m, tilt, half = exact(list(strip))
    (c_r, c_v), (d_r, d_v) = exact(c.tolist()), exact(d.tolist())
    along, across = exact(g.tolist())
    away = abs(c_r - r) + d_r + sum(map(abs, along))
    off = abs(c_v - v - tilt * (c_r - r)) + d_v + abs(tilt) * d_r
    off += sum(abs(y - tilt * x) for x, y in zip(along, across, strict=True))
    if away > half_m or off > half:
        yield f'{where}: the next ones do not begin where they end'


Point = tuple[Fraction, Fraction]


def is_covered(strip: Strip, strips: Sequence[Strip]) -> bool:
    """Whether others hold all of a strip, in rational numbers.

    A convex piece is held by the strip that holds its middle, or is cut where that one ends.
    """
    rows: list[list[Fraction]] = [exact(list(other)) for other in strips if _near(strip, other)]
    r, v, half_m, tilt, half = exact(list(strip))
    ends = [(-1, -1), (-1, 1), (1, 1), (1, -1)]
    todo = [[(r + a * half_m, v + tilt * a * half_m + b * half) for a, b in ends]]
    while todo:
        piece = todo.pop()
        middle = sum(x for x, _ in piece) / len(piece), sum(y for _, y in piece) / len(piece)
        holding = (row for row in rows if all(_inside(row, side, middle) >= 0 for side in _SIDES))
        row = next(holding, None)
        if row is None:
            return False
        for side in _SIDES:
            outside = _cut(piece, row, side, -1)
            if outside:
                todo.append(outside)
                piece = _cut(piece, row, side, 1)
    return True


def _near(one: Strip, other: Strip) -> bool:
    """Whether two strips may touch."""
    tall = [abs(s.tilt) * s.half_m + s.half for s in (one, other)]
    close = abs(one.r - other.r) <= 1.01 * (one.half_m + other.half_m) + 1e-9
    return close and abs(one.v - other.v) <= 1.01 * sum(tall) + 1e-9


_SIDES = ((1, 0), (-1, 0), (0, 1), (0, -1))


def _inside(strip: Sequence[Fraction], side: tuple[int, int], at: Point) -> Fraction:
    """Return how far inside a side of a strip a point is; negative outside."""
    r, v, half_m, tilt, half = strip
    along, across = at[0] - r, at[1] - v - tilt * (at[0] - r)
    return half_m - side[0] * along if side[0] else half - side[1] * across


def _cut(
    piece: Sequence[Point], strip: Sequence[Fraction], side: tuple[int, int], sign: int
) -> list[Point]:
    """Return the part of a convex piece that is inside a side (sign 1), or outside (-1).

    None of it, where that is no more than a line.
    """
    found: list[Point] = []
    depths = [sign * _inside(strip, side, at) for at in piece]
    if max(depths) <= 0:
        return []
    for k, (one, f) in enumerate(zip(piece, depths, strict=True)):
        other, g = piece[k - 1], depths[k - 1]
        if (f > 0 > g) or (f < 0 < g):
            share = f / (f - g)
            found.append(
                (one[0] + share * (other[0] - one[0]), one[1] + share * (other[1] - one[1]))
            )
        if f >= 0:
            found.append(one)
    return found
