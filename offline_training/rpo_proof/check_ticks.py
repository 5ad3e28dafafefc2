# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The checker's second look at single ticks of tubes, and at the table, in rational numbers."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_proof import sets, tables, tube
from rpo_proof.exact import FLIGHT, Matrix, Row, Strip, exact, law_holds, output
from rpo_proof.laws import Law
from rpo_proof.problem import Problem
from rpo_proof.tube import Motion

Floats = NDArray[np.float64]


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
    n, kept = len(c), m
    p = n // 2
    for number in numbers:
        where, low, high = f'{name}, tick {number}', np.empty(n), np.empty(n)
        if number in ticks:
            before, after, m = stepped(problem, motion, number, c, g, d, m)
            if m < 0:
                yield f'{where}: it has no law'
                return 0
            yield from law_faults(problem, before, where)
            yield from step_faults(motion, before, after, where)
            m = sets.tidy(number - numbers.start, g, d, kept, m)
            tidied = replace(after, g=g[:, :m].copy(), d=d.copy())
            yield from tidy_faults(after, tidied, kept, where)
            continue
        sets.box_of(c, g, d, m, low, high)
        laws, force = np.empty((p, 6)), np.empty((2, p))
        m = tube.step(
            problem.table, motion, number, c, g, d, m, low, high, laws, force[0], force[1]
        )
        if m < 0:
            yield f'{where}: it has no law'
            return 0
        m = sets.tidy(number - numbers.start, g, d, kept, m)
    return m


def law_faults(problem: Problem, tick: Tick, where: str) -> Iterator[str]:
    """Yield axes whose law does not hold on the set."""
    c, g, d = exact(tick.c.tolist()), exact(tick.g.tolist()), exact(tick.d.tolist())
    slack = exact(problem.table.slack)
    for axis, numbers in enumerate(tick.laws.tolist()):
        strip = Strip(c, g, d, axis)
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
    pushed = exact(motion.pushed[before.number].tolist())
    shaken = exact(motion.shaken[before.number].tolist())
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
        centre += sum(b[k][i] * (laws[i][2] + constant[i]) for i in range(p)) + pushed[k]
        gap = abs(new_c[k] - centre) + shaken[k] + sum(abs(closed[k][i]) * d[i] for i in range(n))
        for j in range(m):
            image = sum(closed[k][i] * g[i][j] for i in range(n))
            if j < len(carried):
                image += sum(b[k][i] * carried[j][i] for i in range(p))
                if mass and j == len(carried) - 1:
                    image += sum(b[k][i] * mass * (command[i] + constant[i]) for i in range(p))
            gap += abs(new_g[k][j] - image)
        gap += sum(abs(abs(new_g[k][m + i]) - abs(b[k][i]) * rho[i]) for i in range(p))
        terms = sum(abs(a[k][i]) * sizes[i] for i in range(n)) + abs(pushed[k]) + shaken[k]
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


def tidy_faults(before: Tick, after: Tick, kept: int, where: str) -> Iterator[str]:
    """Yield components in which fewer generators hold less."""
    old, new = exact(before.g.T.tolist()), exact(after.g.T.tolist())
    if old[:kept] != new[:kept]:
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
        ours = np.asarray(getattr(problem.table, name))
        if theirs.dtype != ours.dtype or not np.array_equal(theirs, ours):
            yield f'table: `{name}` is not what the controller gives'


def surface_faults(problem: Problem, rng: np.random.Generator, count: int) -> Iterator[str]:
    """Yield what the table that the checker made says wrongly of the surface."""
    table = problem.table
    rows, columns = table.bend.shape
    for i, j in zip(rng.integers(rows, size=count), rng.integers(columns, size=count), strict=True):
        yield from _surface_cell(problem, table, int(i), int(j), rng)
    steep = np.argwhere(table.steep >= 0)
    for i, j in steep[rng.permutation(len(steep))[:count]].tolist():
        yield from _steep_cell(problem, table, i, j, rng)


def _steep_cell(
    problem: Problem, table: tables.Table, i: int, j: int, rng: np.random.Generator
) -> Iterator[str]:
    """Compare a part of a steep cell with the inference in rational numbers."""
    parts, number = table.part_slopes.shape[1], table.steep[i, j]
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
    problem: Problem, table: tables.Table, i: int, j: int, rng: np.random.Generator
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
