# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""ARCH-COMP's rendezvous, proven: every start, every moment of an abort (numbers in `peers`)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from rpo_core.files.scenario import Scenario
from rpo_judge.safety import peers
from rpo_proof.abort import (
    CAPACITY,
    DRIFT_S,
    TICK_S,
    Laws,
    Tables,
    Trace,
    fly,
    nearest,
    tables_of,
    tick,
)
from rpo_proof.sets import ROUND, box_of

Start = tuple[float, float, float, float]
"""A cell: the middle of x and y, and their half-widths [m]."""

ACROSS = (50, 4)
"""First cells along x and y: where the laws switch, x must be known well."""

MOST_CELLS = 2000
"""Cells after which nothing is halved any more."""

PROVEN, REFUTED, OPEN = 'proven', 'refuted', 'open'


def laws_of(scenario: Scenario) -> Laws:
    """Return ARCH-COMP's closed loops about the scenario's target, and its drift."""
    n, zero, one = Fraction(scenario.mean_motion_rad_s), Fraction(0), Fraction(1)
    free = [
        [zero, zero, one, zero],
        [zero, zero, zero, one],
        [3 * n * n, zero, zero, 2 * n],
        [zero, zero, -2 * n, zero],
    ]

    def closed(gains: peers.Gains) -> list[list[Fraction]]:
        mass = Fraction(repr(scenario.mass_kg))
        rows = [list(row) for row in free]
        for row, per_axis in zip(rows[2:], gains, strict=True):
            for i, gain in enumerate(per_axis):
                row[i] += Fraction(repr(gain)) * (60 if i > 1 else 1) / 3600 / mass
        return rows

    return Laws(closed(peers.K_FAR), closed(peers.K_NEAR), free, -peers.CONE_M)


@dataclass
class Proof:
    """What holds of every flight from the set of starts, tick by tick, and of every drift.

    trace : the worst of all cells; where : (M, 4) the cell of the least distance; cells : how many
    """

    tables: Tables
    trace: Trace
    where: NDArray[np.float64] = field(repr=False)
    cells: int = 0

    def merge(self, cell: Start, trace: Trace) -> None:
        """Add a cell."""
        np.maximum(self.trace.cone, trace.cone, out=self.trace.cone)
        np.maximum(self.trace.speed, trace.speed, out=self.trace.speed)
        self.where[trace.near < self.trace.near] = cell
        np.minimum(self.trace.near, trace.near, out=self.trace.near)
        self.cells += 1


def _ticks(minutes: float) -> int:
    return round(60.0 * minutes / TICK_S)


def _latest(names: str) -> int:
    """Return the tick of the last abort of the instances that begin so."""
    spans = (span for name, span in peers.ABORT_MIN.items() if name.startswith(names))
    return _ticks(max(span[1] for span in spans if span))


def _empty() -> Trace:
    ticks, drifts = _ticks(peers.HORIZON_MIN), _latest('SR')
    return Trace(np.zeros(ticks), np.zeros(ticks), np.full(drifts + 1, math.inf))


def wanted() -> Trace:
    """Return what is asked for at each tick: the wide box until the last abort that misses it."""
    limits = _empty()
    limits.cone[:], limits.speed[:] = math.radians(peers.CONE_DEG), peers.CONE_M_S
    limits.near[:] = min(peers.BOXES_M)
    limits.near[: _latest('SRA') + 1] = max(peers.BOXES_M)
    return limits


def set_of(cell: Start) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return centre (4,), generators (4, CAPACITY) and box of rounding (4,) of a cell at rest."""
    x, y, a, b = cell
    g = np.zeros((4, CAPACITY))
    g[0, 0], g[1, 1] = a, b
    rounding = np.array([abs(x) + a, abs(y) + b, 0.0, 0.0]) * ROUND  # of the cell's own numbers
    return np.array([x, y, 0.0, 0.0]), g, rounding


def first_cells() -> list[Start]:
    """Return cells that cover the set of starts."""
    (x, y), half = peers.STARTS_M, peers.STARTS_HALF_M
    across, up = ACROSS
    a, b = half / across, half / up
    columns = [x + a * (2 * i + 1 - across) for i in range(across)]
    return [(at, y + b * (2 * j + 1 - up), a, b) for at in columns for j in range(up)]


def _halves(cell: Start) -> Iterator[Start]:
    """Yield the halves of a cell, across x until it is eight times thinner than y."""
    x, y, a, b = cell
    for s in (-0.5, 0.5):
        yield (x + s * a, y, 0.5 * a, b) if 8.0 * a > b else (x, y + s * b, a, 0.5 * b)


def prove(laws: Laws, show: Callable[[str, float, float], None]) -> Proof:
    """Fly all cells; those that say too little are halved.

    show : gets what is in work, and how much of how much is done
    """
    limits, ticks = wanted(), _ticks(peers.HORIZON_MIN)
    proof = Proof(
        tables_of(laws, 60.0 * peers.HORIZON_MIN), _empty(), np.zeros((len(limits.near), 4))
    )
    left = first_cells()[::-1]
    while left:
        cell, trace = left.pop(), _empty()
        show('cells of starts', proof.cells, proof.cells + len(left) + 1)
        until = fly(proof.tables, *set_of(cell), limits, ticks, trace)
        if until < ticks and proof.cells + len(left) < MOST_CELLS:
            left.extend(_halves(cell))
            continue
        trace.cone[until:], trace.speed[until:] = math.inf, math.inf  # nothing is known from here
        trace.near[until:] = 0.0
        proof.merge(cell, trace)
    return proof


def prepare(scenario: Scenario) -> None:
    """Compile the kernels: fly one tick."""
    tables, trace = tables_of(laws_of(scenario), DRIFT_S), Trace(*np.ones((3, 1)))
    fly(tables, *set_of(first_cells()[0]), trace, 1, trace)


def surely(tables: Tables, start: Start, ticks: int) -> float:
    """Return a distance [m] to which the drift from a start, after so many ticks, comes."""
    c, g, d = set_of(start)
    low, high, least, most = np.empty((4, 4))
    m = 2
    for _ in range(ticks):
        box_of(c, g, d, m, low, high)
        m = tick(tables, c, g, d, m, low, high, least, most)
    box_of(c, g, d, m, low, high)
    left = int((_ticks(peers.HORIZON_MIN) - ticks) * TICK_S / DRIFT_S)
    return float(nearest(tables, low, high, left)[1])


@dataclass(frozen=True)
class Verdict:
    """What is known of an instance.

    cone_deg, speed_m_s, near_m : bounds; near_m is infinite without an abort
    boxes : (box [m], proven, refuted or open) of each box
    flight : x and y of a start [m], moment of the abort [min] and the distance [m] to which that
        flight certainly comes, if it refutes
    """

    name: str
    span_min: tuple[float, float] | None
    cone_deg: float
    speed_m_s: float
    near_m: float
    boxes: tuple[tuple[float, str], ...]
    flight: tuple[float, float, float, float] | None

    @property
    def as_expected(self) -> bool:
        """Whether each is as its name says: of a U, the wide box is hit."""
        wide = REFUTED if self.name.startswith('SRU') else PROVEN
        return all(v == (wide if b == max(peers.BOXES_M) else PROVEN) for b, v in self.boxes)


def verdict(proof: Proof, name: str) -> Verdict:
    """Return what a proof says of an instance."""
    span = peers.ABORT_MIN[name]
    end = _ticks(span[1] if span else peers.HORIZON_MIN)
    cone = math.degrees(float(proof.trace.cone[: end + 1].max()))
    speed = float(proof.trace.speed[: end + 1].max())
    fixed = cone <= peers.CONE_DEG and speed <= peers.CONE_M_S
    near, flight, certain = math.inf, None, math.inf
    if span:
        first = _ticks(span[0])
        at = first + int(np.argmin(proof.trace.near[first : end + 1]))
        near = float(proof.trace.near[at])
        if near <= max(peers.BOXES_M):
            x, y = proof.where[at, :2].tolist()
            certain = surely(proof.tables, (x, y, 0.0, 0.0), at)
            flight = (x, y, at * TICK_S / 60.0, certain)
    boxes = []
    for box in sorted(peers.BOXES_M):
        said = PROVEN if fixed and near > box else REFUTED if certain < box else OPEN
        boxes.append((box, said))
    refutes = any(said == REFUTED for _, said in boxes)
    return Verdict(name, span, cone, speed, near, tuple(boxes), flight if refutes else None)


HEADINGS = (
    'instance',
    'thrusters fail, min',
    'angle off the axis',
    'speed, m/min',
    'nearest drift',
    *(f'target of {2.0 * box:g} m' for box in sorted(peers.BOXES_M)),
)


def _outwards(value: float, digits: int, up: bool) -> str:
    """Return a bound as text, never sharper than it is."""
    scaled = value * 10**digits
    return f'{(math.ceil(scaled) if up else math.floor(scaled)) / 10**digits:.{digits}f}'


def cells_of(found: Verdict) -> tuple[str, ...]:
    """Return a verdict as a line of the table."""
    when, near = '-', '-'
    if found.span_min is not None:
        when = '-'.join(f'{t:g}' for t in sorted(set(found.span_min)))
        near = f'{_outwards(found.near_m, 3, up=False)} m'
    cone, speed = _outwards(found.cone_deg, 2, up=True), _outwards(60 * found.speed_m_s, 3, up=True)
    bounds = f'{cone} of {peers.CONE_DEG:g} deg', f'{speed} of {60.0 * peers.CONE_M_S:.1f}'
    return (found.name, when, *bounds, near, *(said for _, said in found.boxes))


def flight_of(found: Verdict) -> str:
    """Return a sentence about the flight that refutes an instance, or nothing."""
    if found.flight is None:
        return ''
    x, y, after, near = found.flight
    return (
        f'{found.name}: the flight from ({x:g}, {y:g}) m whose thrusters fail after {after:.6g} '
        f'min comes to |x|, |y| <= {_outwards(near, 4, up=True)} m'
    )
