# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""ARCH-COMP's rendezvous, proven: every start, every moment of an abort (numbers in `peers`).

Sets of a chaser in a plane under switched linear laws in continuous time, and their drifts.

A cell of starts is a zonotope (`rpo_proof.sets`) of (x, y, vx, vy). Under one law it moves by the
matrix exponential of a tick. Where it may touch the plane at which laws are switched, it moves by
their mean, and half of their difference is a force that may change at any moment. Between ticks a
flight is within h^2/8 |s''| of the straight line; by `grown`, no |s'| or |s''| of a tick exceeds
exp(Bh) times that of its beginning, B the larger of the absolute values of both laws (Gronwall's
lemma).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_cli.commands.shared import interruptible
from rpo_cli.display import print_table, progress
from rpo_core.files.scenario import Scenario, load_scenario
from rpo_core.files.validation import choice
from rpo_montecarlo.engine.lanes import compiled
from rpo_proof.exact import Exact, exact
from rpo_proof.sets import ROUND, box_of, reduce
from tools import peers

TICK_S = 0.25
"""Length of a tick of the closed loop."""

DRIFT_S, LEAP = 15.0, 40
"""Length of a tick of a drift; most ticks that are leapt over at once."""

CAPACITY, FEW = 64, 48
"""Generators: most, and at which the small ones become a box."""

SHARE = 0.01
"""Share of position, or of velocity, by which moments of an abort that share a drift may differ."""

Floats = NDArray[np.float64]


class Laws(NamedTuple):
    """Matrices (4, 4) of s' = A s, in m and s, rational; `near` acts beyond x = switch_m."""

    far: Exact
    near: Exact
    free: Exact
    switch_m: float


class Tables(NamedTuple):
    """What the kernels read, each entry right to a share of 2^-52; far, near, and their mean.

    moved : (3, 4, 4) exp(Ah); rate, bend : (3, 4, 4) A and A^2; push : (2, 4) half the difference
        of the accelerations; grown : (4, 4) exp(Bh)
    drift, off : (N+1, 4, 4) exp(A_free kH), and what it may be wrong by; leap : (4, 4) exp(|A|LH)
    curve : (4, 4) H^2/8 |A_free|^2 exp(|A_free|H)
    """

    moved: Any
    rate: Any
    bend: Any
    push: Any
    grown: Any
    drift: Any
    off: Any
    leap: Any
    curve: Any
    switch_m: float


def tables_of(laws: Laws, horizon_s: float) -> Tables:
    """Return the tables of some laws; drifts last until the horizon."""
    far, near, free = map(exact, laws[:3])
    flows = (far, near, (far + near) / 2)
    largest, sizes = np.maximum(abs(far), abs(near)), abs(free)
    drift = exponential(free, DRIFT_S)
    powers, off = [np.eye(4)], [np.zeros((4, 4))]
    for _ in range(math.ceil(horizon_s / DRIFT_S)):
        wrong = np.abs(drift) @ off[-1] + ROUND * (np.abs(drift) @ (np.abs(powers[-1]) + off[-1]))
        powers.append(drift @ powers[-1])
        off.append(wrong * (1.0 + ROUND))
    bent = (sizes @ sizes).astype(float) @ exponential(sizes, DRIFT_S)
    up = 1.0 + ROUND
    return Tables(
        np.array([exponential(flow, TICK_S) for flow in flows]),
        np.array(flows, float),
        np.array([flow @ flow for flow in flows], float),
        ((near - far) / 2)[2:].astype(float),
        exponential(largest, TICK_S) * up,
        np.array(powers),
        np.array(off),
        exponential(sizes, LEAP * DRIFT_S) * up,
        bent * (DRIFT_S**2 / 8.0 * up),
        laws.switch_m,
    )


@compiled
def largest_of(row: Any, c: Any, g: Any, d: Any, m: int) -> float:
    """Return a bound of |row s| over a set."""
    middle, size = 0.0, 0.0
    for i in range(len(c)):
        middle += row[i] * c[i]
        size += abs(row[i]) * (abs(c[i]) + d[i])
    total = abs(middle)
    for i in range(len(c)):
        total += abs(row[i]) * d[i]
    for j in range(m):
        value = 0.0
        for i in range(len(c)):
            value += row[i] * g[i, j]
            size += abs(row[i] * g[i, j])
        total += abs(value)
    return total + ROUND * size


@compiled
def _move(moved: Any, c: Any, g: Any, d: Any, m: int, low: Any, high: Any) -> None:
    """Move a set by a matrix; low, high : its box."""
    n = len(c)
    new, wide = np.empty(n), np.empty(n)
    for k in range(n):
        new[k], wide[k], size = 0.0, 0.0, 0.0
        for i in range(n):
            new[k] += moved[k, i] * c[i]
            wide[k] += abs(moved[k, i]) * d[i]
            size += abs(moved[k, i]) * max(abs(low[i]), abs(high[i]))
        wide[k] += ROUND * (size + wide[k])
    for k in range(n):
        c[k], d[k] = new[k], wide[k]
    for j in range(m):
        for k in range(n):
            new[k] = 0.0
            for i in range(n):
                new[k] += moved[k, i] * g[i, j]
        for k in range(n):
            g[k, j] = new[k]


@compiled
def tick(
    tables: Tables, c: Any, g: Any, d: Any, m: int, low: Any, high: Any, least: Any, most: Any
) -> int:
    """Move a set by a tick; return the number of its generators.

    low, high : (4,) box of the set; changed
    least, most : (4,) filled with a box of all states on the way
    """
    n = len(c)
    first, moved = np.zeros(n), np.zeros(n)
    for i in range(n):
        for law in range(2):
            first[i] = max(first[i], largest_of(tables.rate[law, i], c, g, d, m))
    for k in range(n):
        for i in range(n):
            moved[k] += TICK_S * tables.grown[k, i] * first[i]
        moved[k] *= 1.0 + ROUND
    law = 2
    if high[0] + moved[0] < tables.switch_m:
        law = 0
    elif low[0] - moved[0] > tables.switch_m:
        law = 1
    bent, push = np.zeros(n), np.zeros(n)
    for i in range(n):
        bend = largest_of(tables.bend[law, i], c, g, d, m)
        for k in range(n):
            bent[k] += TICK_S * TICK_S / 8.0 * tables.grown[k, i] * bend * (1.0 + ROUND)
    if law == 2:
        for i in range(2):
            force = largest_of(tables.push[i], c, g, d, m)
            for k in range(n):
                force += abs(tables.push[i, k]) * moved[k]
            for k in range(n):
                push[k] += TICK_S * tables.grown[k, 2 + i] * force * (1.0 + ROUND)
    least[:], most[:] = low, high
    _move(tables.moved[law], c, g, d, m, low, high)
    box_of(c, g, d, m, low, high)
    for k in range(n):
        least[k] = min(least[k], low[k]) - bent[k] - push[k]
        most[k] = max(most[k], high[k]) + bent[k] + push[k]
    if law == 2:
        for k in range(n):
            for i in range(n):
                g[i, m + k] = 0.0
            g[k, m + k] = push[k]
        m += n
    if m > FEW:
        m = reduce(g, d, 2, m)
    return m


@compiled
def nearest(tables: Tables, low: Any, high: Any, last: int) -> tuple[float, float]:
    """Return bounds of how near to the target drifts of some ticks come, from a box of states.

    The distance is the larger of |x| and |y|. No drift comes nearer than the first, and each one
    comes at least as near as the second.
    """
    n = len(low)
    c, d = 0.5 * (low + high), 0.5 * (high - low)
    for i in range(n):
        d[i] += ROUND * (abs(low[i]) + abs(high[i]))
    at, to = np.empty((2, n)), np.empty((2, n))
    least, sure, k = math.inf, math.inf, 0
    _drift(tables, k, c, d, at)
    while k < last:
        gap, inside, speed = 0.0, 0.0, 0.0
        for i in range(2):
            gap = max(gap, at[0, i], -at[1, i])
            inside = max(inside, -at[0, i], at[1, i])
            reach = 0.0
            for j in range(n):
                reach += tables.leap[2 + i, j] * max(abs(at[0, j]), abs(at[1, j]))
            speed = max(speed, reach * (1.0 + ROUND))
        sure = min(sure, inside)
        free = (gap - least) / (DRIFT_S * speed) * (1.0 - ROUND)
        if free >= 1.0:
            k += int(min(free, LEAP))
            _drift(tables, min(k, last), c, d, at)
            continue
        _drift(tables, k + 1, c, d, to)
        gap = 0.0
        for i in range(2):
            bent = 0.0
            for j in range(n):
                bent += tables.curve[i, j] * max(abs(at[0, j]), abs(at[1, j]))
            bent *= 1.0 + ROUND
            gap = max(gap, min(at[0, i], to[0, i]) - bent, -max(at[1, i], to[1, i]) - bent)
        least, k = min(least, gap), k + 1
        at, to = to, at
    return least, sure


@compiled
def _drift(tables: Tables, k: int, c: Any, d: Any, box: Any) -> None:
    """Fill the box of states after some ticks of a drift."""
    n = len(c)
    for i in range(n):
        middle, wide, size = 0.0, 0.0, 0.0
        for j in range(n):
            entry, far = tables.drift[k, i, j], abs(c[j]) + d[j]
            middle += entry * c[j]
            wide += abs(entry) * d[j] + tables.off[k, i, j] * far
            size += abs(entry) * far
        wide += ROUND * (size + wide)
        box[0, i], box[1, i] = middle - wide, middle + wide


class Trace(NamedTuple):
    """What is said of a cell, tick by tick, of the moments from its beginning to its end.

    cone : (N,) largest angle off the axis [rad]; speed : (N,) largest speed [m/s]; both where the
        second law may act, else 0
    near : (M,) least distance [m] of the drifts that begin there
    """

    cone: Any
    speed: Any
    near: Any


@compiled
def _stretched(start: Any, low: Any, high: Any) -> bool:
    """Whether a box holds motion by more than a share of where, and of how fast, it is."""
    for i in range(0, 4, 2):
        far, growth = 0.0, 0.0
        for k in range(i, i + 2):
            far = max(far, -low[k], high[k])
            growth = max(growth, high[k] - start[1, k], start[0, k] - low[k])
        if growth > SHARE * far:
            return True
    return False


@compiled
def fly(tables: Tables, c: Any, g: Any, d: Any, limits: Trace, ticks: int, trace: Trace) -> int:
    """Move a cell; return the tick from which on the trace says too little or nothing, N if none.

    c (4,), g (4, CAPACITY), d (4,) : the set, changed in place; its generators are the first two
    limits : what is asked for; ticks : at which drifts end
    """
    n = len(c)
    low, high, least, most = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    start, first, last = np.empty((2, n)), np.empty(n), np.empty(n)
    m, began = 2, 0
    for i in range(len(trace.cone)):
        box_of(c, g, d, m, low, high)
        m = tick(tables, c, g, d, m, low, high, least, most)
        if most[0] >= tables.switch_m:
            trace.cone[i] = math.atan2(max(-least[1], most[1]), -most[0]) * (1.0 + ROUND)
            vx, vy = max(-least[2], most[2]), max(-least[3], most[3])
            trace.speed[i] = math.sqrt(vx * vx + vy * vy) * (1.0 + ROUND)
            if trace.cone[i] > limits.cone[i] or trace.speed[i] > limits.speed[i]:
                return began
        if i >= len(trace.near):
            continue
        if i == began:
            start[0], start[1], first[:], last[:] = least, most, least, most
        for k in range(n):
            first[k], last[k] = min(first[k], least[k]), max(last[k], most[k])
        if i + 1 == len(trace.near) or _stretched(start, first, last):
            left = math.ceil((ticks - began) * TICK_S / DRIFT_S)
            near, _ = nearest(tables, first, last, left)
            trace.near[began : i + 1] = near
            if near < limits.near[began]:
                return began
            began = i + 1
    return len(trace.cone)


def _series(a: Exact, t: Fraction) -> tuple[Exact, Fraction]:
    """Return exp(A t), and a bound of what each entry may be wrong by.

    Up to |At| = 1 it is a sum of rational numbers, else a square; digits below 2^-300 are cut.
    """
    cut = np.frompyfunc(lambda v: Fraction(round(v * 2**300), 2**300), 1, 1)
    step = a * t
    if abs(step).sum(axis=1).max() > 1:
        half, wrong = _series(a, t / 2)
        far = abs(half).sum(axis=1).max()
        return cut(half @ half), (2 * far + 4 * wrong) * wrong + Fraction(1, 2**280)
    term = total = exact(np.eye(len(a)))
    for k in range(1, 60):
        term = cut(term @ step / k)
        total = total + term
    return total, Fraction(1, 2**250)


def exponential(a: Exact, time_s: float) -> Floats:
    """Return exp(A t), each entry right to a share of 2^-52.

    An entry that the first powers of A leave at 0 is 0.

    Raises
    ------
    ValueError
        If an entry is too small, or A t too large, for that.
    """
    total, wrong = _series(exact(a), Fraction(time_s))
    least = abs(total[total != 0]).min()
    if wrong > least / 2**54:
        raise ValueError(f'`a` must have an exponential without tiny entries; got {float(least):g}')
    return np.asarray(total.astype(float))


Start = tuple[float, float, float, float]
"""A cell: the middle of x and y, and their half-widths [m]."""

ACROSS = (50, 4)
"""First cells along x and y: where the laws switch, x must be known well."""

MOST_CELLS = 2000
"""Cells after which nothing is halved any more."""

PROVEN, REFUTED, OPEN = 'proven', 'refuted', 'open'


def laws_of(scenario: Scenario) -> Laws:
    """Return ARCH-COMP's closed loops about the scenario's target, and its drift."""
    n, mass = Fraction(scenario.mean_motion_rad_s), Fraction(repr(scenario.mass_kg))
    rows = [0, 0, 1, 0], [0, 0, 0, 1], [3 * n * n, 0, 0, 2 * n], [0, 0, -2 * n, 0]
    free = exact(rows)

    def closed(gains: peers.Gains) -> Exact:
        found = free.copy()
        for row, per_axis in zip(found[2:], gains, strict=True):
            for i, gain in enumerate(per_axis):
                row[i] += Fraction(repr(gain)) * (60 if i > 1 else 1) / 3600 / mass
        return found

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


def print_proofs(files: Sequence[str]) -> bool:
    """Prove ARCH-COMP's instances and print them; return whether one is not as it is named."""
    scenarios = [load_scenario(file) for file in files]
    for scenario in scenarios:
        choice('scenario', scenario.name, (peers.ARCH,))
    as_expected = True
    for scenario in scenarios:
        with interruptible(lambda: 'stopped'), progress() as show:
            proof = prove(laws_of(scenario), show)
        found = [verdict(proof, name) for name in peers.ABORT_MIN]
        title = f'{scenario.name}: {peers.arch_lqr().name}, from every start, {proof.cells} cells'
        print_table(HEADINGS, [cells_of(v) for v in found], title, left=2)
        for sentence in filter(None, map(flight_of, found)):
            print(sentence)
        as_expected &= all(v.as_expected for v in found)
    return not as_expected
