# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The checker's second look at sets, in rational numbers: ticks of tubes, strips, the table."""

from __future__ import annotations

import itertools
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.world import cw
from rpo_kernels.arrays import Floats
from rpo_proof import enclosure, per_axis, sets, tube
from rpo_proof.cells import VALUES, Cell, CellBounds, Prover
from rpo_proof.enclosure import Law
from rpo_proof.exact import FLIGHT, UNIT, ExactStrip, Matrix, Row, exact, law_holds, output
from rpo_proof.folder import table_arrays
from rpo_proof.per_axis import set_of
from rpo_proof.problem import PER_AXIS, Problem
from rpo_proof.slew import Strip
from rpo_proof.tube import Motion


@dataclass(frozen=True)
class Tick:
    """A tick of a tube, before small generators become a box.

    c (n,), g (n, m), d (n,) : the set; laws (p, 4) : of its axes
    """

    number: int
    c: Floats
    g: Floats
    d: Floats
    laws: Floats


def stepped(
    problem: Problem, motion: Motion, number: int, c: Floats, g: Floats, d: Floats, m: int
) -> tuple[Tick, Tick, int]:
    """Move a set by a tick with the prover's kernel; return before, after, and generators."""
    n = len(c)
    p = n // 2
    low, high, laws = np.empty(n), np.empty(n), np.empty((p, 6))
    sets.box_of(c, g, d, m, low, high)
    before = Tick(number, c.copy(), g[:, :m].copy(), d.copy(), laws)
    m = tube.step(
        problem.table, motion, number, c, g, d, m, low, high, laws, np.empty(p), np.empty(p)
    )
    return before, Tick(number + 1, c.copy(), g[:, : max(m, 0)].copy(), d.copy(), laws), m


Start = tuple[Floats, Floats, Floats, int]
"""A set: centre, generators, box, number of generators."""


def set_faults(
    problem: Problem, motion: Motion, start: Start, numbers: range, ticks: set[int], name: str
) -> Generator[str, None, int]:
    """Move a set in place; yield what is wrong at some ticks, return its number of generators."""
    c, g, d, m = start
    fixed = m
    for number in numbers:
        where = f'{name}, tick {number}'
        before, after, m = stepped(problem, motion, number, c, g, d, m)
        if m < 0:
            yield f'{where}: it has no law'
            return 0
        if number in ticks:
            yield from law_faults(problem, before, where)
            yield from step_faults(motion, before, after, where)
        m = sets.tidy(number - numbers.start, g, d, fixed, m)
        if number in ticks:
            tidied = replace(after, g=g[:, :m].copy(), d=d.copy())
            yield from tidy_faults(after, tidied, fixed, where)
    return m


def law_faults(problem: Problem, tick: Tick, where: str) -> Iterator[str]:
    """Yield axes whose law does not hold on the set."""
    c, g, d = exact(tick.c.tolist()), exact(tick.g.tolist()), exact(tick.d.tolist())
    slack = exact(problem.table.slack)
    for axis, numbers in enumerate(tick.laws.tolist()):
        strip = ExactStrip(c, g, d, axis)
        if not law_holds(problem.controller, problem.table, Law(*numbers[:4]), strip, slack):
            yield f'{where}: the law of axis {axis} does not hold'


def step_faults(motion: Motion, before: Tick, after: Tick, where: str) -> Iterator[str]:
    """Yield components in which the next set does not hold the image of the set."""
    a, b = exact(motion.a.tolist()), exact(motion.b.tolist())
    c, g, d = exact(before.c.tolist()), exact(before.g.tolist()), exact(before.d.tolist())
    new_c, new_g, new_d = exact(after.c.tolist()), exact(after.g.tolist()), exact(after.d.tolist())
    laws = exact(before.laws.tolist())
    n, m = len(c), len(g[0])
    p = n // 2
    constant = exact(motion.constant[before.number].tolist())
    carried = exact(motion.carried[before.number].tolist())
    any_n, mass = exact(motion.any_n), exact(motion.mass)
    coupling = exact(motion.coupling[before.number].tolist())
    coupling_half = exact(motion.coupling_half[before.number].tolist())
    closed: Matrix = [list(row) for row in a]
    for k in range(n):
        for i in range(p):
            closed[k][i] += b[k][i] * laws[i][0]
            closed[k][p + i] += b[k][i] * laws[i][1]
    sizes = [abs(c[i]) + d[i] + sum(map(abs, g[i])) for i in range(n)]
    command = [laws[i][2] + laws[i][0] * c[i] + laws[i][1] * c[p + i] for i in range(p)]
    spread = [_spread(laws[i], c, g, d, i) for i in range(p)]
    known = [sum((abs(column[i]) for column in carried), Fraction(0)) for i in range(p)]
    rho = [laws[i][3] + any_n + mass * (spread[i] + known[i] + any_n) for i in range(p)]
    for k in range(n):
        centre = sum(closed[k][i] * c[i] for i in range(n))
        centre += sum(b[k][i] * (laws[i][2] + constant[i]) for i in range(p)) + coupling[k]
        gap = (
            abs(new_c[k] - centre)
            + coupling_half[k]
            + sum(abs(closed[k][i]) * d[i] for i in range(n))
        )
        for j in range(m):
            image = sum(closed[k][i] * g[i][j] for i in range(n))
            if j < len(carried):
                image += sum(b[k][i] * carried[j][i] for i in range(p))
                if mass and j == len(carried) - 1:
                    image += sum(b[k][i] * mass * (command[i] + constant[i]) for i in range(p))
            gap += abs(new_g[k][j] - image)
        gap += sum(abs(abs(new_g[k][m + i]) - abs(b[k][i]) * rho[i]) for i in range(p))
        terms = sum(abs(a[k][i]) * sizes[i] for i in range(n)) + abs(coupling[k]) + coupling_half[k]
        terms += sum(
            abs(b[k][i]) * (abs(command[i]) + spread[i] + abs(constant[i]) + known[i] + any_n)
            for i in range(p)
        )
        if not gap + FLIGHT * terms <= new_d[k]:
            yield f'{where}: the next set does not hold the image, component {k}'


def _spread(law: Row, c: Row, g: Matrix, d: Row, axis: int) -> Fraction:
    """Return the half-width of the command of an axis over a set."""
    p = len(c) // 2
    found = law[3] + abs(law[0]) * d[axis] + abs(law[1]) * d[p + axis]
    pairs = zip(g[axis], g[p + axis], strict=True)
    return Fraction(found + sum(abs(law[0] * x + law[1] * y) for x, y in pairs))


def tidy_faults(before: Tick, after: Tick, fixed: int, where: str) -> Iterator[str]:
    """Yield components in which fewer generators hold less."""
    old, new = exact(before.g.T.tolist()), exact(after.g.T.tolist())
    if old[:fixed] != new[:fixed]:
        yield f'{where}: a generator that is carried along has changed'
        return
    n, left = len(before.c), [tuple(column) for column in new]
    boxed = [exact(float(x)) for x in before.d]
    for column in map(tuple, old):
        if column in left:
            left.remove(column)
        else:
            boxed = [x + abs(y) for x, y in zip(boxed, column, strict=True)]
    for k in range(n):
        room = exact(float(after.d[k])) + sum(
            (abs(column[k]) for column in left if not any(column[:k] + column[k + 1 :])),
            Fraction(0),
        )
        if boxed[k] > room:
            yield f'{where}: fewer generators hold less, component {k}'


def table_faults(problem: Problem, arrays: Mapping[str, NDArray[Any]]) -> Iterator[str]:
    """Yield which arrays of a table are not what the controller gives."""
    for name, theirs in arrays.items():
        ours = np.asarray(table_arrays(problem.table)[name])
        if theirs.dtype != ours.dtype or not np.array_equal(theirs, ours):
            yield f'table: `{name}` is not what the controller gives'


def surface_faults(problem: Problem, rng: np.random.Generator, count: int) -> Iterator[str]:
    """Yield what the table that the checker made says wrongly of the surface."""
    table = problem.table
    rows, columns = table.bend.shape
    for i, j in zip(rng.integers(rows, size=count), rng.integers(columns, size=count), strict=True):
        yield from _surface_cell(problem, table, int(i), int(j), rng)
    divided = np.argwhere(table.division >= 0)
    for i, j in divided[rng.permutation(len(divided))[:count]].tolist():
        yield from _divided_cell(problem, table, i, j, rng)


def _divided_cell(
    problem: Problem, table: enclosure.Table, i: int, j: int, rng: np.random.Generator
) -> Iterator[str]:
    """Compare a part of a divided cell with the inference in rational numbers."""
    parts, number = table.part_slopes.shape[1], table.division[i, j]
    at = rng.integers(parts, size=2).tolist()
    shares = [exact(float(x)) for x in rng.uniform(0.01, 0.99, 2)]
    point, small = [], []
    for edges, cell, part, share in zip((table.e, table.w), (i, j), at, shares, strict=True):
        left, right = exact(edges[cell : cell + 2].tolist())
        point.append(left + (right - left) * (part + share) / parts)
        small.append((right - left) / parts / 2**20)
    limit, slack = exact(table.limit), exact(table.slack)
    u = output(problem.controller, point[0], point[1], limit)
    least, most = exact(table.part_range[number, at[0], at[1]].tolist())
    if not least - slack <= u <= most + slack:
        yield f'table: the range of a part of cell {i}, {j} does not hold its values'
    slopes = exact(table.part_slopes[number, at[0], at[1]].tolist())
    for axis in range(2):
        moved = [x + small[axis] if k == axis else x for k, x in enumerate(point)]
        slope = (output(problem.controller, moved[0], moved[1], limit) - u) / small[axis]
        if not slopes[2 * axis] <= slope <= slopes[2 * axis + 1]:
            yield f'table: a slope of a part of cell {i}, {j} is out of bounds'


def _surface_cell(
    problem: Problem, table: enclosure.Table, i: int, j: int, rng: np.random.Generator
) -> Iterator[str]:
    """Compare a cell of the table with the inference in rational numbers."""
    limit, slack = exact(table.limit), exact(table.slack)
    sides = exact(table.e[i : i + 2].tolist()), exact(table.w[j : j + 2].tolist())
    one = Fraction(1)
    ends = [[min(max(x, -one), one) for x in side] for side in sides]

    def value(e: Fraction, w: Fraction) -> Fraction:
        return output(problem.controller, e, w, limit)

    least_e, most_e, least_w, most_w = (exact(float(s)) for s in table.slopes[i, j])
    corners = [[value(e, w) for w in ends[1]] for e in ends[0]]
    for k, line in enumerate(corners):
        for n, u in enumerate(line):
            if abs(u - exact(float(table.u[i + k, j + n]))) > slack:
                yield f'table: the value at {float(ends[0][k])}, {float(ends[1][n])} is wrong'
    for _ in range(3):
        s, t = (exact(float(share)) for share in rng.uniform(0.01, 0.99, 2))
        e = ends[0][0] + s * (ends[0][1] - ends[0][0])
        w = ends[1][0] + t * (ends[1][1] - ends[1][0])
        mean = (1 - s) * ((1 - t) * corners[0][0] + t * corners[0][1])
        mean += s * ((1 - t) * corners[1][0] + t * corners[1][1])
        u = value(e, w)
        if abs(u - mean) > exact(float(table.bend[i, j])) + slack:
            yield f'table: the bend at {float(e)}, {float(w)} is more than {table.bend[i, j]}'
        for least, most, (low, high), axis in (
            (least_e, most_e, ends[0], 0),
            (least_w, most_w, ends[1], 1),
        ):
            small = (high - low) / 2**20
            if small:
                moved = value(e + small, w) if axis == 0 else value(e, w + small)
                if not least <= (moved - u) / small <= most:
                    yield f'table: a slope at {float(e)}, {float(w)} is out of bounds'


DRAWN = 4
"""Constants of a cell that are drawn for each tick."""

COEFFICIENT = 32 * UNIT
"""Share by which a coefficient of the flight, or of the motion of a cell, may be rounded."""


def empty_faults(problem: Problem, group: str, found: CellBounds) -> Iterator[str]:
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
        elif not (
            problem.settings.axes_apart and per_axis.is_outside(problem, group, centre, half)
        ):
            yield f'{group} cell {k}: is not empty'
        elif not np.array_equal(found.values[k, 2:], nothing):
            yield f'{group} cell {k}: says something of what is empty'


def motion_faults(
    prover: Prover, cell: Cell, motion: Motion, tick: int, where: str
) -> Iterator[str]:
    """Yield what the motion of a cell does not hold at a tick: forces, masses, the other axis."""
    yield from _force_faults(prover, cell, motion, tick, where)
    if prover.other_axis.states is not None:
        bounds = prover.other_axis.states[:, tick].tolist()
        yield from _push_faults(prover, motion, tick, bounds, where)


def _force_faults(
    prover: Prover, cell: Cell, motion: Motion, tick: int, where: str
) -> Iterator[str]:
    """Compare the force of drawn constants, as it is flown, with that of the set."""
    problem, n = prover.problem, len(motion.a)
    axis, base = PER_AXIS[prover.group][0], problem.scenario
    rng = np.random.default_rng(tick)
    constant, carried = exact(motion.constant[tick, 0].item()), motion.carried[tick, :, 0]
    for _ in range(DRAWN):
        xi = rng.choice([-1.0, 1.0, 0.3], len(cell.centre) - n)
        point = np.array(cell.centre[n:]) + np.array(cell.half[n:]) * xi
        drawn = per_axis.scenario_in(problem, prover.group, point, base)
        force = exact(drawn.disturbance.force_n(base.time_s(tick))[axis])
        shares = exact(xi.tolist())
        ours = constant + sum(x * y for x, y in zip(shares, exact(carried.tolist()), strict=True))
        if abs(force - ours) > exact(motion.any_n):
            yield f'{where}: the force of a disturbance is not in the set'
        b = cw.matrices(drawn.step)[1][np.ix_(PER_AXIS[prover.group], [axis])][:, 0]
        light = 1 + exact(motion.mass) * (shares[-1] if motion.mass else 0)
        for theirs, mine in zip(exact(b.tolist()), exact(motion.b[:, 0].tolist()), strict=True):
            if not abs(theirs - mine * light) <= COEFFICIENT * abs(theirs):
                yield f'{where}: the mass of a flight is not in the set'


def _push_faults(
    prover: Prover, motion: Motion, tick: int, bounds: list[list[float]], where: str
) -> Iterator[str]:
    """Compare the coupling with the effect of the other axis at the corners of its bounds."""
    problem = prover.problem
    own, other = PER_AXIS[prover.group], PER_AXIS['y' if prover.group == 'x' else 'x']
    a, b = cw.matrices(problem.scenario.step)
    strongest = exact(problem.scenario.max_force_n) + exact(problem.strongest_n)
    heavy = (1 + exact(problem.inverse_mass_share)) * (strongest + exact(motion.any_n))
    for k, row in enumerate(own):
        middle, wide = (
            exact(motion.coupling[tick, k].item()),
            exact(motion.coupling_half[tick, k].item()),
        )
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
                yield f'{where}: the coupling of the other axis exceeds its bound, component {k}'


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
