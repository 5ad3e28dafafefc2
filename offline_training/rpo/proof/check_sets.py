# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The checker's second look at sets, in rational numbers: ticks of tubes, strips, the table.

In this arithmetic nothing is rounded. The inference is written anew from the controller file,
without the kernels or their tables.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo.proof import enclosure, per_axis, tube
from rpo.proof.cells import VALUES, Cell, CellBounds, Prover
from rpo.proof.enclosure import Law, Table
from rpo.proof.folder import table_arrays
from rpo.proof.per_axis import set_of
from rpo.proof.problem import PER_AXIS, Problem
from rpo.proof.slew import Strip
from rpo.proof.tube import Motion, Zonotope
from rpo_core.control.controller import FuzzyController
from rpo_core.control.fuzzy import MembershipFunctions
from rpo_core.kernels.arrays import Floats
from rpo_core.world import cw

Exact = Any
"""A row or matrix of rational numbers: an array of objects."""

UNIT = Fraction(1, 2**53)

FLIGHT = 16 * UNIT
"""Share of the sizes of its terms by which a tick of a flight may be rounded.

A component is a sum of five products: 6 roundings, and 8 of the coefficients.
"""


_fractions = np.frompyfunc(Fraction, 1, 1)


def exact(values: Any) -> Exact:
    """Return a float as a rational number; a row or matrix of floats as an array of them."""
    return Fraction(values) if isinstance(values, (float, int)) else _fractions(np.asarray(values))


def _triangle(x: Fraction, left: Fraction, centre: Fraction, right: Fraction) -> Fraction:
    if x == centre:
        return Fraction(1)
    share = (x - left) / (centre - left) if x < centre else (right - x) / (right - centre)
    return max(share, Fraction(0))


def grades(x: Fraction, functions: MembershipFunctions) -> list[Fraction]:
    """Return the memberships in LN, SN, Z, SP, LP of an error in [-1, 1]."""
    f = [exact(value) for value in vars(functions).values()][:5]
    one, two = Fraction(1), Fraction(2)
    words = {
        'Z': _triangle(abs(x), -f[0], Fraction(0), f[0]),
        'S': _triangle(abs(x), f[1], f[2], f[3]),
        'L': _triangle(abs(x), f[4], one, two),
    }
    none = Fraction(0)
    right = [words['S'], words['L']] if x >= 0 else [none, none]
    left = [words['L'], words['S']] if x < 0 else [none, none]
    return [*left, words['Z'], *right]


def output(controller: FuzzyController, e: Fraction, w: Fraction, limit: Fraction) -> Fraction:
    """Return the inference at two errors, saturated at `limit`."""
    system, one = controller.system, Fraction(1)
    position = grades(min(max(e, -one), one), system.position)
    velocity = grades(min(max(w, -one), one), system.velocity)
    strength = [Fraction(0)] * 5
    for row, line in enumerate(system.rules.codes.tolist()):
        for column, word in enumerate(line):
            strength[word] = max(strength[word], min(velocity[row], position[column]))
    half = (system.samples - 1) // 2
    moment = area = Fraction(0)
    for i in range(-half, half + 1):
        y = exact(float(i / half))
        clipped = map(min, grades(y, system.force), strength)
        grade = max(clipped)
        moment, area = moment + y * grade, area + grade
    u = moment / area if area else Fraction(0)
    return min(max(u, -limit), limit)


class ExactStrip:
    """The strip in r, v of an axis that holds a zonotope, in rational numbers.

    r, v : middle; half_r : half-width; tilt, half : |v' - v - tilt (r' - r)| <= half
    """

    def __init__(self, c: Exact, g: Exact, d: Exact, axis: int) -> None:
        (self.r, self.v), (d_r, d_v) = c[axis :: len(c) // 2], d[axis :: len(c) // 2]
        along, across = g[axis :: len(c) // 2]
        squares = sum(float(x) ** 2 for x in along)
        products = sum(float(x) * float(y) for x, y in zip(along, across, strict=True))
        self.tilt = Fraction(products / squares) if squares else Fraction(0)
        self.half_r = d_r + abs(along).sum()
        self.half = d_v + abs(self.tilt) * d_r + abs(across - self.tilt * along).sum()


def law_holds(
    controller: FuzzyController, table: Table, law: Law, strip: ExactStrip, slack: Fraction
) -> bool:
    """Whether a law holds on a strip, by what the table says of its cells.

    Either the bilinear pieces, with their bends, are within rho of the law at the corners of the
    cells' parts; or the output in the middle of the strip, with the slopes of all its cells.
    """
    position, velocity, force = map(exact, controller.scales)
    k_r, k_v, k_0, rho = exact(law)
    a, b, c = -k_r * position / force, -k_v * velocity / force, k_0 / force
    room = rho / force
    e, w = -strip.r / position, -strip.v / velocity
    half_e, half_w = strip.half_r / position, strip.half / velocity
    tilt = strip.tilt * position / velocity
    error = Fraction(0)
    slopes = []
    for i, left, right in _cells(table.e, e - half_e, e + half_e):
        ends = [w + tilt * (x - e) for x in (left, right)]
        for j, low, high in _cells(table.w, min(ends) - half_w, max(ends) + half_w):
            slopes.append(exact(table.slopes[i, j]))
            for x in (left, right):
                for y in (low, high):
                    rest = _bilinear(table, i, j, x, y) - a * x - b * y - c
                    error = max(error, abs(rest) + exact(float(table.bend[i, j])) + slack)
    if error <= room:
        return True
    middle = output(controller, e, w, exact(table.limit)) - a * e - b * w - c
    least, greatest = np.min(slopes, axis=0)[::2], np.max(slopes, axis=0)[1::2]
    radii = np.maximum(greatest - (a, b), (a, b) - least)
    spread = (radii[0] + abs(tilt) * radii[1]) * half_e + radii[1] * half_w
    return bool(abs(middle) + slack + spread <= room)


def _cells(edges: Any, low: Fraction, high: Fraction) -> list[tuple[int, Fraction, Fraction]]:
    """Return the cells that a range touches, and what it is in each."""
    return [
        (i, max(low, exact(left)), min(high, exact(right)))
        for i, (left, right) in enumerate(itertools.pairwise(edges.tolist()))
        if left <= high and right >= low
    ]


def _bilinear(table: Table, i: int, j: int, x: Fraction, y: Fraction) -> Fraction:
    (e0, e1), (w0, w1) = exact(table.e[i : i + 2]), exact(table.w[j : j + 2])
    s, t = (x - e0) / (e1 - e0), (y - w0) / (w1 - w0)
    (u00, u01), (u10, u11) = exact(table.u[i : i + 2, j : j + 2])
    low, high = u00 + s * (u10 - u00), u01 + s * (u11 - u01)
    return Fraction(low + t * (high - low))


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
    problem: Problem, motion: Motion, number: int, z: Zonotope, m: int
) -> tuple[Tick, Tick, int]:
    """Move a set by a tick with the prover's kernel; return before, after, and generators."""
    trace = tube.Trace.empty(1, len(z.c), 0)
    tube.box_of(z, m, trace.low[0], trace.high[0])
    before = Tick(number, z.c.copy(), z.g[:, :m].copy(), z.d.copy(), trace.laws[0])
    m = tube.step(problem.table, motion, number, z, m, trace, 0)
    generators = z.g[:, : max(m, 0)].copy()
    return before, Tick(number + 1, z.c.copy(), generators, z.d.copy(), trace.laws[0]), m


Start = tuple[Zonotope, int]
"""A set, and the number of its generators."""


def set_faults(
    problem: Problem, motion: Motion, start: Start, numbers: range, ticks: set[int], name: str
) -> Generator[str, None, int]:
    """Move a set in place; yield what is wrong at some ticks, return its number of generators."""
    z, m = start
    fixed = m
    for number in numbers:
        where = f'{name}, tick {number}'
        before, after, m = stepped(problem, motion, number, z, m)
        if m < 0:
            yield f'{where}: it has no law'
            return 0
        if number in ticks:
            yield from law_faults(problem, before, where)
            yield from step_faults(motion, before, after, where)
        m = tube.tidy(number - numbers.start, z, fixed, m)
        if number in ticks:
            tidied = replace(after, g=z.g[:, :m].copy(), d=z.d.copy())
            yield from tidy_faults(after, tidied, fixed, where)
    return m


def law_faults(problem: Problem, tick: Tick, where: str) -> Iterator[str]:
    """Yield axes whose law does not hold on the set."""
    c, g, d, slack = map(exact, (tick.c, tick.g, tick.d, problem.table.slack))
    for axis, numbers in enumerate(tick.laws.tolist()):
        strip = ExactStrip(c, g, d, axis)
        if not law_holds(problem.controller, problem.table, Law(*numbers[:4]), strip, slack):
            yield f'{where}: the law of axis {axis} does not hold'


def step_faults(motion: Motion, before: Tick, after: Tick, where: str) -> Iterator[str]:
    """Yield components in which the next set does not hold the image of the set."""
    a, b, any_n, mass = map(exact, (motion.a, motion.b, motion.any_n, motion.mass))
    columns = motion.constant, motion.carried, motion.coupling, motion.coupling_half
    constant, carried, coupling, coupling_half = (exact(rows[before.number]) for rows in columns)
    c, g, d, laws = map(exact, (before.c, before.g, before.d, before.laws))
    new_c, new_g, new_d = map(exact, (after.c, after.g, after.d))
    (p, m), q = (len(laws), g.shape[1]), len(carried)
    k_r, k_v, k_0, law_rho, *_ = laws.T
    gains = np.hstack([np.diag(k_r), np.diag(k_v)])
    closed = a + b @ gains
    command, disturbance = k_0 + gains @ c, abs(carried).sum(axis=0)
    spread = law_rho + abs(gains) @ d + abs(gains @ g).sum(axis=1)
    rho = law_rho + any_n + mass * (spread + disturbance + any_n)
    image = closed @ g
    image[:, :q] += b @ carried.T
    if mass:
        image[:, q - 1] += mass * b @ (command + constant)
    gap = abs(new_c - closed @ c - b @ (k_0 + constant) - coupling) + coupling_half
    gap = gap + abs(closed) @ d + abs(new_g[:, :m] - image).sum(axis=1)
    gap = gap + abs(abs(new_g[:, m : m + p]) - abs(b) * rho).sum(axis=1)
    forces = abs(command) + spread + abs(constant) + disturbance + any_n
    terms = abs(a) @ (abs(c) + d + abs(g).sum(axis=1)) + abs(coupling) + coupling_half
    for k, wide in enumerate(gap + FLIGHT * (terms + abs(b) @ forces)):
        if not wide <= new_d[k]:
            yield f'{where}: the next set does not hold the image, component {k}'


def tidy_faults(before: Tick, after: Tick, fixed: int, where: str) -> Iterator[str]:
    """Yield components in which fewer generators hold less."""
    old, new = ([tuple(column) for column in tick.g.T.tolist()] for tick in (before, after))
    if old[:fixed] != new[:fixed]:
        yield f'{where}: a generator that is carried along has changed'
        return
    left, boxed, room = new, exact(before.d), exact(after.d)
    for column in old:
        if column in left:
            left.remove(column)
        else:
            boxed = boxed + abs(exact(column))
    for column in left:
        if np.count_nonzero(column) == 1:
            room = room + abs(exact(column))
    for k in np.flatnonzero(boxed > room).tolist():
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
    parts, at = table.part_slopes.shape[1], rng.integers(table.part_slopes.shape[1], size=2)
    ends, slack = exact([table.e[i : i + 2], table.w[j : j + 2]]), exact(table.slack)
    wide = (ends[:, 1] - ends[:, 0]) / parts
    point = ends[:, 0] + wide * (at + exact(rng.uniform(0.01, 0.99, 2)))
    value, part = _value_of(problem, table), (table.division[i, j], *at)
    least, most = exact(table.part_range[part])
    if not least - slack <= value(*point) <= most + slack:
        yield f'table: the range of a part of cell {i}, {j} does not hold its values'
    where = f'of a part of cell {i}, {j}'
    yield from _slope_faults(value, point, wide, table.part_slopes[part], where)


def _surface_cell(
    problem: Problem, table: enclosure.Table, i: int, j: int, rng: np.random.Generator
) -> Iterator[str]:
    """Compare a cell of the table with the inference in rational numbers."""
    slack, value = exact(table.slack), _value_of(problem, table)
    ends = exact(np.clip([table.e[i : i + 2], table.w[j : j + 2]], -1.0, 1.0))
    corners = np.array([[value(e, w) for w in ends[1]] for e in ends[0]])
    for k, n in np.argwhere(abs(corners - exact(table.u[i : i + 2, j : j + 2])) > slack).tolist():
        yield f'table: the value at {float(ends[0, k])}, {float(ends[1, n])} is wrong'
    wide = ends[:, 1] - ends[:, 0]
    for _ in range(3):
        s, t = exact(rng.uniform(0.01, 0.99, 2))
        point = ends[:, 0] + wide * (s, t)
        mean, where = (1 - s, s) @ corners @ (1 - t, t), ', '.join(map(str, point.astype(float)))
        if abs(value(*point) - mean) > exact(float(table.bend[i, j])) + slack:
            yield f'table: the bend at {where} is more than {table.bend[i, j]}'
        yield from _slope_faults(value, point, wide, table.slopes[i, j], f'at {where}')


Value = Callable[[Fraction, Fraction], Fraction]
"""The output of the inference at two errors."""


def _value_of(problem: Problem, table: enclosure.Table) -> Value:
    return partial(output, problem.controller, limit=exact(table.limit))


def _slope_faults(
    value: Value, point: Exact, wide: Exact, slopes: Floats, where: str
) -> Iterator[str]:
    """Yield slopes from a point (2,) of a box of some widths (2,) that leave their bounds (4,)."""
    for small, way, (least, most) in zip(
        wide / 2**20, np.eye(2, dtype=int), exact(slopes).reshape(2, 2), strict=True
    ):
        if small:
            slope = (value(*(point + small * way)) - value(*point)) / small
            if not least <= slope <= most:
                yield f'table: a slope {where} is out of bounds'


DRAWN = 4
"""Constants of a cell that are drawn for each tick."""

COEFFICIENT = 32 * UNIT
"""Share by which a coefficient of the flight, or of the motion of a cell, may be rounded."""


def empty_faults(problem: Problem, group: str, bounds: CellBounds) -> Iterator[str]:
    """Yield cells without a tube that say something, or are said to hold nothing, and do."""
    nothing = np.array([np.inf, *np.zeros(len(VALUES) - 3)])
    for k in np.flatnonzero(~(bounds.column('last_s') > 0.0)).tolist():
        centre, half = bounds.centre[k], bounds.half[k]
        if bounds.column('last_s')[k] == 0.0:
            if not (bounds.values[k, 2:] == np.inf).all():
                yield f'{group} cell {k}: is bounded without a tube'
            if not (bounds.tail == np.inf).all(axis=(1, 2)).any():
                yield f'{group} cell {k}: its norms are bounded without a tube'
            if not np.isinf(bounds.reach[:, 1:]).all():
                yield f'{group} cell {k}: is said to reach something, without a tube'
        elif not (
            problem.settings.axes_apart and per_axis.is_outside(problem, group, centre, half)
        ):
            yield f'{group} cell {k}: is not empty'
        elif not np.array_equal(bounds.values[k, 2:], nothing):
            yield f'{group} cell {k}: says something of what is empty'


def motion_faults(
    prover: Prover, cell: Cell, motion: Motion, tick: int, where: str
) -> Iterator[str]:
    """Yield what the motion of a cell does not hold at a tick: forces, masses, the other axis.

    The force of drawn constants, as it is flown, is compared with that of the set.
    """
    problem, n = prover.problem, len(motion.a)
    axis, base = PER_AXIS[prover.group][0], problem.scenario
    rng = np.random.default_rng(tick)
    constant, carried = exact(motion.constant[tick, 0]), exact(motion.carried[tick, :, 0])
    for _ in range(DRAWN):
        xi = rng.choice([-1.0, 1.0, 0.3], len(cell.centre) - n)
        point = np.array(cell.centre[n:]) + np.array(cell.half[n:]) * xi
        drawn = per_axis.scenario_in(problem, prover.group, point, base)
        force = exact(drawn.disturbance.over([tick], base.dt_ns)[0, axis])
        if abs(force - constant - carried @ exact(xi)) > exact(motion.any_n):
            yield f'{where}: the force of a disturbance is not in the set'
        b = exact(cw.matrices(drawn.step)[1][np.ix_(PER_AXIS[prover.group], [axis])])
        light = 1 + (exact(motion.mass) * exact(xi[-1]) if motion.mass else 0)
        if (abs(b - exact(motion.b) * light) > COEFFICIENT * abs(b)).any():
            yield f'{where}: the mass of a flight is not in the set'
    if prover.other_axis.states is not None:
        bounds = prover.other_axis.states[:, tick]
        yield from _push_faults(prover, motion, tick, bounds, where)


def _push_faults(
    prover: Prover, motion: Motion, tick: int, bounds: Floats, where: str
) -> Iterator[str]:
    """Compare the coupling with the effect of the other axis at the corners of its bounds."""
    problem = prover.problem
    axis, other = PER_AXIS[prover.group], PER_AXIS['y' if prover.group == 'x' else 'x']
    a, b = cw.matrices(problem.scenario.step)
    a, b = exact(a[np.ix_(axis, other)]), exact(b[np.ix_(axis, other[:1])])
    strongest = exact(problem.scenario.max_force_n) + exact(problem.strongest_n)
    push = (1 + exact(problem.inverse_mass_share)) * (strongest + exact(motion.any_n)) * abs(b)
    corners = exact(list(itertools.product(*bounds.T))).T
    far = abs(a @ corners - exact(motion.coupling[tick])[:, None]) + push
    beyond = (far > exact(motion.coupling_half[tick])[:, None]).any(axis=1)
    for k in np.flatnonzero(beyond).tolist():
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
        z, m = set_of(one.strip, motion.carried.shape[1])
        yield from start_faults(one.strip, z, m, where)
        m = yield from set_faults(prover.problem, motion, (z, m), numbers, drawn, name)
        yield from end_faults(one.end, z, m, where)


def start_faults(strip: Strip, z: Zonotope, m: int, where: str) -> Iterator[str]:
    """Yield why a set does not hold the strip that it begins as."""
    r, v, half_m, tilt, half = exact(strip)
    (along, up), across = exact(z.g[:, m - 2]), exact(z.g[:, m - 1])
    same = [*exact(z.c), along, *across] == [r, v, half_m, 0, half]
    if not same or abs(up - tilt * half_m) > exact(z.d[1]):
        yield f'{where}: the set is not the strip'


def end_faults(strip: Strip, z: Zonotope, m: int, where: str) -> Iterator[str]:
    """Yield why a strip does not hold the set that another one has become."""
    r, v, half_m, tilt, half = exact(strip)
    (c_r, c_v), (d_r, d_v), (along, across) = exact(z.c), exact(z.d), exact(z.g[:, :m])
    away = abs(c_r - r) + d_r + abs(along).sum()
    off = abs(c_v - v - tilt * (c_r - r)) + d_v + abs(tilt) * d_r
    off += abs(across - tilt * along).sum()
    if away > half_m or off > half:
        yield f'{where}: the next ones do not begin where they end'


Point = tuple[Fraction, Fraction]


def is_covered(strip: Strip, strips: Sequence[Strip]) -> bool:
    """Whether others hold all of a strip, in rational numbers.

    A convex piece is held by the strip that holds its middle, or is cut where that one ends.
    """
    rows = [exact(other) for other in strips if _near(strip, other)]
    r, v, half_m, tilt, half = exact(strip)
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
    points: list[Point] = []
    depths = [sign * _inside(strip, side, at) for at in piece]
    if max(depths) <= 0:
        return []
    for k, (one, f) in enumerate(zip(piece, depths, strict=True)):
        other, g = piece[k - 1], depths[k - 1]
        if (f > 0 > g) or (f < 0 < g):
            share = f / (f - g)
            points.append(
                (one[0] + share * (other[0] - one[0]), one[1] + share * (other[1] - one[1]))
            )
        if f >= 0:
            points.append(one)
    return points
