# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The enclosure of the control surface: a table of cells, and affine laws from it.

U(e, w) is the output of the inference at the normalised errors of position and velocity, saturated
where the thrusters saturate. Each cell of the table has the values at its corners, bounds of both
slopes, and a bound of how far U is from the bilinear interpolation of the corners. All of it comes
from `surface`, which rounds outwards.

With the middle slopes taken off, the rest of U changes by at most the radii a, b of the slopes.
At (s h, t k) in a cell of widths h, k it differs from the bilinear mean of the corners by at most
2 a h s (1 - s) + 2 b k t (1 - t) <= (a h + b k) / 2.

A law encloses the force of an axis on a strip: F(r, v) is within k_r r + k_v v + k_0 +- rho.
"""

from __future__ import annotations

import itertools
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo.proof import surface
from rpo_core.control.controller import FuzzyController
from rpo_core.control.fuzzy import MembershipFunctions
from rpo_core.control.inference import infer
from rpo_core.files.validation import InputError
from rpo_core.kernels.arithmetic import saturate
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import unlocked

Cells = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns (k,) of cells."""

PARTS = 16
"""Parts of a divided cell, along each error."""

SHARE = 0.9
"""A cell is divided where the command may change by so much of the limit of slew."""

MOST = 512
"""Cells that are divided, at most: those with the largest rates."""

FASTEST = 1.5
"""Velocity error at which the rates of cells without end are taken."""

DRIFT_M_S2 = 0.0035
"""Acceleration beside the control's own, which the choice of the cells assumes."""

CHANGE = 0.01
"""Change of the output in a tick, which the choice of the cells assumes."""

FINEST = 2.0**-11
"""Width of the cells at error 0, where the surface bends most."""

COARSEST = 2.0**-8
GROWTH = 1 / 16
"""Between the two, a cell is at most so much wider than it is far from error 0."""

BEYOND = 2.0**20
"""Largest error that the table knows; from 1 on the input is saturated."""


class Table(NamedTuple):
    """The surface, in m x n cells; cell i, j is e[i]..e[i+1], w[j]..w[j+1].

    e, w : (m+1,), (n+1,) ascending edges, errors of position and velocity
    u : (m+1, n+1) outputs at the corners
    bend : (m, n) greatest distance from the bilinear interpolation
    slopes : (m, n, 4) least and greatest slope in e, then in w
    slack : greatest error of a computed output, at a corner or by the kernel
    limit : |U| is saturated here
    position_m, velocity_m_s, force_n : scales
    fis : what the kernel reads
    division : (m, n) number of a divided cell among the parts, -1: it is not divided
    part_range, part_slopes : (k, p, p, 2), (k, p, p, 4) of U on its parts, along e, then along w
    """

    e: Any
    w: Any
    u: Any
    bend: Any
    slopes: Any
    slack: float
    limit: float
    position_m: float
    velocity_m_s: float
    force_n: float
    fis: Any
    division: Any
    part_range: Any
    part_slopes: Any


def table_of(controller: FuzzyController, max_force_n: float, coarseness: float = 1.0) -> Table:
    """Return the table of a controller whose force is saturated at `max_force_n` [N].

    No cell of it is divided. Raises InputError if the surface jumps, or may jump, and where.

    coarseness : cells are so many times as wide as they are by default
    """
    system = controller.system
    refuse_jumps(controller)
    e, w = (edges(f, coarseness) for f in (system.position, system.velocity))
    points = np.clip(e, -1.0, 1.0), np.clip(w, -1.0, 1.0)
    corners = (axis.ravel() for axis in np.meshgrid(*points, indexing='ij'))
    u = surface.values(system, *corners).reshape(len(e), len(w))
    limit = max_force_n / controller.force_scale_n
    slopes = _slopes(controller, points, limit)
    radii = (slopes[..., 1::2] - slopes[..., ::2]) / 2
    widths = np.diff(points[0])[:, None], np.diff(points[1])
    bend = (radii[..., 0] * widths[0] + radii[..., 1] * widths[1]) / 2 * (1.0 + 1e-14)
    steepest = float(np.abs(slopes).max())
    # The kernel's errors -r / scale are right to one rounding; it multiplies by the force scale.
    slack = surface.rounding(system) + 8.0 * surface.UNIT_ROUNDOFF * (1.0 + steepest)
    surfaces = e, w, np.clip(u, -limit, limit), bend, slopes
    undivided = np.full(bend.shape, -1, np.int32), np.empty((0, 1, 1, 2)), np.empty((0, 1, 1, 4))
    return Table(*surfaces, slack, limit, *controller.scales, system.tables, *undivided)


def refuse_jumps(controller: FuzzyController) -> None:
    """Raise InputError where a membership function of an input has a vertical edge."""
    for name in ('position', 'velocity'):
        functions = getattr(controller.system, name)
        if not surface.is_continuous(functions):
            raise InputError(
                f'controller {controller.name} must be continuous; SP of its {name} has a vertical '
                f'edge at {functions.sp_centre:g} of its scale'
            )


def edges(functions: MembershipFunctions, coarseness: float = 1.0) -> Floats:
    """Return the edges of the grid along one error: finer near 0, at every breakpoint."""
    parts = []
    points = surface.breakpoints(functions)
    for left, right in itertools.pairwise(points[points >= 0.0]):
        at = left
        while at < right:
            parts.append(at)
            at += coarseness * min(max(GROWTH * at, FINEST), COARSEST)
    half = np.array([*parts[1:], 1.0, BEYOND])
    return np.concatenate([-half[::-1], [0.0], half])


def _slopes(controller: FuzzyController, points: tuple[Floats, Floats], limit: float) -> Floats:
    """Return the slopes (m, n, 4) in each cell; those of an odd surface are even."""
    e, w = points
    odd, middle = controller.system.rules.is_odd, len(e) // 2
    e = e[middle:] if odd else e
    columns, rows = len(w) - 1, len(e) - 1
    boxes = surface.Boxes(
        np.repeat(e[:-1], columns),
        np.repeat(e[1:], columns),
        np.tile(w[:-1], rows),
        np.tile(w[1:], rows),
    )
    half = saturated(enclosed(controller, boxes), limit).reshape(-1, columns, 4)
    return np.concatenate([half[::-1, ::-1], half]) if odd else half


def enclosed(controller: FuzzyController, boxes: surface.Boxes) -> surface.Enclosure:
    """Return the enclosure of each box of [-1, 1] x [-1, 1]; along no width nothing changes."""
    enclosure = surface.enclose(controller.system, boxes)
    for bound in enclosure:
        if not np.isfinite(bound).all():
            i = int(np.flatnonzero(~np.isfinite(bound))[0])
            raise InputError(
                f'controller {controller.name} must be continuous; it may jump near a position '
                f'error of {boxes.e_low[i]:g} and a velocity error of {boxes.v_low[i]:g}'
            )
    still = boxes.e_low == boxes.e_high, boxes.v_low == boxes.v_high
    low, high, *slopes = enclosure
    e_slopes = (np.where(still[0], 0.0, slope) for slope in slopes[:2])
    v_slopes = (np.where(still[1], 0.0, slope) for slope in slopes[2:])
    return surface.Enclosure(low, high, *e_slopes, *v_slopes)


def saturated(enclosure: surface.Enclosure, limit: float) -> Floats:
    """Return the slopes (n, 4) of the output saturated at `limit`."""
    slopes = np.stack(enclosure[2:], axis=1)
    outside = (enclosure.low > limit) | (enclosure.high < -limit)
    slopes[outside] = 0.0
    # An output is at most 1, but for rounding, which saturates by nothing that has a slope.
    if limit < 1.0:
        partly = ~outside & ((enclosure.high > limit) | (enclosure.low < -limit))
        slopes[partly, ::2] = np.minimum(slopes[partly, ::2], 0.0)
        slopes[partly, 1::2] = np.maximum(slopes[partly, 1::2], 0.0)
    return slopes


def divided(controller: FuzzyController, table: Table, limit_n_s: float, mass_kg: float) -> Table:
    """Return a table whose cells with large rates are divided: limit of slew [N/s], mass [kg].

    Which cells are divided changes how sharp a bound is, never whether it holds.
    """
    rates = _rates(table, mass_kg)
    places = np.flatnonzero(rates > SHARE * limit_n_s)
    places = np.sort(places[np.argsort(-rates.ravel()[places], kind='stable')[:MOST]])
    if not len(places):
        return table
    cells = np.unravel_index(places, rates.shape)
    number = np.full(rates.shape, -1, np.int32)
    number[cells] = np.arange(len(places))
    ranges, slopes = parts_of(controller, table, (cells[0], cells[1]))
    return table._replace(division=number, part_range=ranges, part_slopes=slopes)


def parts_of(controller: FuzzyController, table: Table, cells: Cells) -> tuple[Floats, Floats]:
    """Return ranges (k, p, p, 2) and slopes (k, p, p, 4) on the parts of some cells."""
    shape = len(cells[0]), PARTS, PARTS
    share = np.arange(PARTS + 1) / PARTS
    sides = []
    for edges, some in zip((table.e, table.w), cells, strict=True):
        at = edges[some][:, None] + np.diff(edges)[some][:, None] * share
        sides.append(np.clip(at, -1.0, 1.0))
    e, w = sides
    ends = (e[:, :-1, None], e[:, 1:, None], w[:, None, :-1], w[:, None, 1:])
    boxes = surface.Boxes(*(np.broadcast_to(end, shape).ravel() for end in ends))
    enclosure = enclosed(controller, boxes)
    ranges = np.clip(np.stack([enclosure.low, enclosure.high], axis=1), -table.limit, table.limit)
    return ranges.reshape(*shape, 2), saturated(enclosure, table.limit).reshape(*shape, 4)


def _rates(table: Table, mass_kg: float) -> Floats:
    """Return about the greatest rate (m, n) of the command in each cell [N/s]."""
    u, room = table.u, table.bend + table.slack + CHANGE
    corners = np.stack([u[:-1, :-1], u[1:, :-1], u[:-1, 1:], u[1:, 1:]])
    forces = (
        table.force_n * (corners.min(axis=0) - room),
        table.force_n * (corners.max(axis=0) + room),
    )
    fast = np.clip(table.w, -FASTEST, FASTEST) * table.velocity_m_s / table.position_m
    pulls = (
        -(DRIFT_M_S2 + forces[1] / mass_kg) / table.velocity_m_s,
        (DRIFT_M_S2 - forces[0] / mass_kg) / table.velocity_m_s,
    )
    s = table.slopes
    by_e = np.stack([s[..., k] * v for k in (0, 1) for v in (fast[:-1], fast[1:])])
    by_w = np.stack([s[..., k] * a for k in (2, 3) for a in pulls])
    rise, fall = by_e.max(axis=0) + by_w.max(axis=0), by_e.min(axis=0) + by_w.min(axis=0)
    return np.asarray(table.force_n * np.maximum(rise, -fall))


TINY = 2.0**-47
"""Relative rounding of a few operations, with room: 64 units of 2^-53."""

FEW = 36
"""Cells; in a box of no more, the bounds of the slopes are tried too."""


class Law(NamedTuple):
    """F in k_r r + k_v v + k_0 +- rho [N]; r [m], v [m/s]."""

    k_r: float
    k_v: float
    k_0: float
    rho: float


@unlocked
def cell_of(edges: Any, x: float) -> int:
    """Return the cell that holds x: edges[i] <= x < edges[i+1], the last one included."""
    low, high = 0, len(edges) - 1
    while high - low > 1:
        middle = (low + high) // 2
        if edges[middle] <= x:
            low = middle
        else:
            high = middle
    return low


@unlocked
def bilinear(table: Table, i: int, j: int, e: float, w: float) -> float:
    """Interpolate the corners of a cell."""
    s = (e - table.e[i]) / (table.e[i + 1] - table.e[i])
    t = (w - table.w[j]) / (table.w[j + 1] - table.w[j])
    low = table.u[i, j] + s * (table.u[i + 1, j] - table.u[i, j])
    high = table.u[i, j + 1] + s * (table.u[i + 1, j + 1] - table.u[i, j + 1])
    return low + t * (high - low)


@unlocked
def law_of(table: Table, r0: float, r1: float, v: float, tilt: float, half: float) -> Law:
    """Return a law of the strip r0 <= r <= r1 [m], |v' - v - tilt (r' - r)| <= half [m/s].

    r is the middle of r0 and r1; rho < 0: the strip leaves the table. Two laws are tried. One has
    the slopes between the corners of the strip, and what is left is the extreme of bilinear pieces,
    at their corners, plus their bends. The other has the middle slopes of the cells and the
    kernel's own value in the middle of the strip.
    """
    e0, e1 = -r1 / table.position_m, -r0 / table.position_m
    e, w = 0.5 * (e0 + e1), -v / table.velocity_m_s
    e0, e1 = e0 - abs(e0) * TINY, e1 + abs(e1) * TINY
    tilt = tilt * table.position_m / table.velocity_m_s
    reach = abs(tilt) * (e1 - e0)
    half = half / table.velocity_m_s + TINY * (abs(w) + reach + abs(tilt * e))
    half = half * (1.0 + TINY) + 1e-300
    most_w = abs(w) + half + 0.5 * reach
    if not (e0 > table.e[0] and e1 < table.e[-1] and most_w < table.w[-1]):
        return Law(0.0, 0.0, 0.0, -1.0)
    i0, i1 = cell_of(table.e, e0), cell_of(table.e, e1)
    w0, w1 = w + tilt * (e0 - e), w + tilt * (e1 - e)
    u00, u01 = value(table, i0, e0, w0 - half), value(table, i0, e0, w0 + half)
    u10, u11 = value(table, i1, e1, w1 - half), value(table, i1, e1, w1 + half)
    b = 0.25 * ((u01 - u00) + (u11 - u10)) / half if half > 1e-200 else 0.0
    a = 0.5 * ((u10 - u00) + (u11 - u01)) / (e1 - e0) - b * tilt if e1 > e0 else 0.0
    least, most = 1e300, -1e300
    a0, a1, b0, b1 = 1e300, -1e300, 1e300, -1e300
    cells = 0
    for i in range(i0, i1 + 1):
        left, right = max(e0, table.e[i]), min(e1, table.e[i + 1])
        w0, w1 = w + tilt * (left - e), w + tilt * (right - e)
        w0, w1 = min(w0, w1) - half, max(w0, w1) + half
        j0, j1 = cell_of(table.w, w0), cell_of(table.w, w1)
        cells += j1 - j0 + 1
        for j in range(j0, j1 + 1):
            low, high = max(w0, table.w[j]), min(w1, table.w[j + 1])
            bend = table.bend[i, j]
            for x in (left, right):
                for y in (low, high):
                    rest = bilinear(table, i, j, x, y) - a * x - b * y
                    least, most = min(least, rest - bend), max(most, rest + bend)
            a0, a1 = min(a0, table.slopes[i, j, 0]), max(a1, table.slopes[i, j, 1])
            b0, b1 = min(b0, table.slopes[i, j, 2]), max(b1, table.slopes[i, j, 3])
    c, rho = 0.5 * (least + most), 0.5 * (most - least)
    if cells <= FEW:
        other = 0.25 * ((a1 - a0) + abs(tilt) * (b1 - b0)) * (e1 - e0) + 0.5 * (b1 - b0) * half
        if other < rho:
            a, b, rho = 0.5 * (a0 + a1), 0.5 * (b0 + b1), other
            u = infer(saturate(e, 1.0), saturate(w, 1.0), table.fis)
            c = saturate(u, table.limit) - a * e - b * w
    return _physical(table, a, b, c, rho, max(abs(e0), abs(e1)), most_w)


@unlocked
def value(table: Table, i: int, e: float, w: float) -> float:
    """Return the bilinear value at e, which is in row i, and w."""
    return bilinear(table, i, cell_of(table.w, w), e, w)


@unlocked
def _physical(table: Table, a: float, b: float, c: float, rho: float, e: float, w: float) -> Law:
    """Return a law of errors as one of position and velocity; e, w : their greatest sizes."""
    room = table.slack + TINY * (1.0 + abs(a) * e + abs(b) * w + abs(c) + rho)
    return Law(
        -table.force_n * a / table.position_m,
        -table.force_n * b / table.velocity_m_s,
        table.force_n * c,
        table.force_n * (rho * (1.0 + TINY) + room + TINY * (abs(a) * e + abs(b) * w)),
    )
