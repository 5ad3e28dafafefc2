# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The independent checker of a proof: `rpo prove --check`.

All cells: they cover the box, their bounds give the claims; the flights of the claims are flown
again. The table: made by the checker itself, and at random cells compared with the inference in
rational numbers. Random cells of starts: their tubes are made anew, with the same bounds; at random
ticks the law is valid, and the next set holds the image of the set, in rational numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.flight import Flight
from rpo_proof import apart, cells, probing, rest
from rpo_proof.cells import Cell, Found
from rpo_proof.check_apart import empty_faults, merging_faults
from rpo_proof.check_claims import Follows, Written, flights_again, what_follows
from rpo_proof.check_ticks import (
    law_faults,
    set_faults,
    step_faults,
    stepped,
    surface_faults,
    table_faults,
)
from rpo_proof.claims import Claim, Range, nowhere
from rpo_proof.corridor import around_of
from rpo_proof.exact import exact
from rpo_proof.folder import Folder
from rpo_proof.problem import Problem
from rpo_proof.prover import Prover
from rpo_proof.sets import Rest
from rpo_proof.tube import Trace

FLIGHTS_EACH = 50
"""Flights from each cell that is drawn."""

MOST_FAULTS = 20
"""Faults of each step of the check that are listed; the first step with a fault is the last one."""

OVERLAPPING = 1e-10
"""Cells may overlap by so much of the box, a tenth of what a mean is widened for it."""

Floats = NDArray[np.float64]
Say = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Sample:
    """How much is checked in rational numbers, at random.

    starts : cells of starts, 0: all; ticks : of each; surface : cells of the table
    flights : that are compared with the tubes of their cells at every tick
    """

    starts: int = 20
    ticks: int = 10
    surface: int = 40
    flights: int = 0
    seed: int = 1


@dataclass(frozen=True)
class Checked:
    """What the checker found.

    faults : what is wrong, a sentence each; then nothing else counts
    claims, ranges : what it computed itself, from the cells and from flights
    drawn : group -> cells whose tubes it made anew, and all cells that have one
    """

    faults: list[str]
    claims: list[Claim]
    ranges: dict[str, Range]
    drawn: dict[str, tuple[int, int]]

    @property
    def whole(self) -> bool:
        """Whether all tubes were made anew."""
        return all(some == every for some, every in self.drawn.values())


def check(folder: Folder, sample: Sample, say: Say = lambda what, done, total: None) -> Checked:
    """Check a finished proof; raises InputError if it cannot be read."""
    problem = replace(folder.problem)  # without what a prover has computed in it
    written = Written.of(folder)
    groups = {group: folder.cells(group) for group in problem.groups}
    arrays = folder.table()
    follows = Follows([], {}, [])
    faults = _first(
        fault
        for group, found in groups.items()
        for fault in (*cover_faults(problem, group, found), *empty_faults(problem, group, found))
    )
    if not faults:
        flown, faults = flights_again(folder, written)
        follows = what_follows(problem, groups, written, flown)
        faults = [*faults, *follows.faults][:MOST_FAULTS]
    for step in _steps(problem, groups, written.rest, arrays, sample, say):
        faults = faults or _first(step)
    drawn = {
        group: (min(sample.starts or count, count), count)
        for group, count in ((g, len(_flown(found))) for g, found in groups.items())
    }
    return Checked(faults, follows.claims, follows.ranges, drawn)


def _first(faults: Iterable[str]) -> list[str]:
    return list(islice(faults, MOST_FAULTS))


def _steps(
    problem: Problem,
    groups: Mapping[str, Found],
    at_rest: Rest | None,
    arrays: Mapping[str, NDArray[Any]],
    sample: Sample,
    say: Say,
) -> Iterator[Iterable[str]]:
    """Yield the steps of a check that take long, each an iterator of faults."""
    rng = np.random.default_rng(sample.seed)
    say('the surface', 0, 1)
    yield table_faults(problem, arrays)
    yield surface_faults(problem, rng, sample.surface)
    if at_rest is not None:
        yield rest_faults(problem, at_rest)
    before: dict[str, Found] = {}
    for group, found in groups.items():
        around = around_of(problem, group, before)
        before[group] = found
        prover = Prover(problem, group, at_rest or nowhere(problem), *around)
        yield tube_faults(prover, found, rng, sample, say)
        yield flight_faults(prover, found, rng, sample.flights, say)


def cover_faults(problem: Problem, group: str, found: Found) -> Iterator[str]:
    """Yield a place of the box of starts that no cell holds, or that cells lie on each other.

    A box is held by one cell, or is cut where a cell ends, or holds a gap.
    """
    chosen, settings = list(problem.groups[group]), problem.settings
    centre, half = np.array(settings.centre)[chosen], np.array(settings.half)[chosen]
    if settings.axes_apart:
        unknown = np.array(apart.ranges(problem, group)).reshape(-1, 2)
        centre = np.concatenate([centre, unknown.mean(axis=1)])
        half = np.concatenate([half, np.diff(unknown)[:, 0] / 2])
    low, high = np.nextafter(centre - half, -np.inf), np.nextafter(centre + half, np.inf)
    low, high = np.where(half > 0.0, low, centre), np.where(half > 0.0, high, centre)
    if problem.odd:
        low[0] = centre[0]
    wide = half > 0.0
    with np.errstate(over='ignore'):
        shares = (2.0 * found.half[:, wide] / (high - low)[wide]).prod(axis=1)
        total = float(shares.sum())
    if not total <= 1.0 + OVERLAPPING or found.half[:, ~wide].any():
        yield f'{group} cells: they hold more than the box, or some of it twice'
        return
    # The edges of a cell are rounded here; it reaches further than that into its neighbours.
    room = (np.abs(found.centre) + found.half) * 2.0**-50 * (found.half > 0.0)
    lows, highs = found.centre - found.half + room, found.centre + found.half - room
    todo = [(low, high, np.arange(len(lows)))]
    while todo:
        low, high, near = todo.pop()
        near = near[((lows[near] <= high) & (highs[near] >= low)).all(axis=1)]
        if ((lows[near] <= low) & (high <= highs[near])).all(axis=1).any():
            continue
        ends = [
            np.unique(edge[(edge > x) & (edge < y)])
            for edge, x, y in zip(highs[near].T, low, high, strict=True)
        ]
        axis = max(range(len(ends)), key=lambda i: len(ends[i]))
        if not len(ends[axis]):
            yield f'{group} cells: none holds all from {low.tolist()} to {high.tolist()}'
            return
        cut = ends[axis][len(ends[axis]) // 2]
        left, right = high.copy(), low.copy()
        left[axis] = right[axis] = cut
        todo += [(low, left, near), (right, high, near)]


def rest_faults(problem: Problem, at_rest: Rest) -> Iterator[str]:
    """Yield why the set of rest is not mapped into itself, in rational numbers."""
    if problem.settings.axes_apart:
        yield 'set of rest: axes apart have none, for it would have to hold x and y together'
        return
    radius, rate, speed = (exact(number) for number in at_rest)
    for group in problem.groups:
        motion = rest.motion_at_rest(problem, group)
        c, g, d, m = rest.as_set(motion, at_rest)
        before, after, m = stepped(problem, motion, 0, c, g, d, m)
        if m < 0:
            yield f'{group} set of rest: it has no law'
            continue
        yield from law_faults(problem, before, f'{group} set of rest')
        yield from step_faults(motion, before, after, f'{group} set of rest')
        p = len(c) // 2
        c_, g_, d_ = exact(after.c.tolist()), exact(after.g.tolist()), exact(after.d.tolist())
        for i in range(p):
            far = abs(c_[i]) + d_[i] + sum(map(abs, g_[i]))
            fast = abs(c_[p + i] + rate * c_[i]) + d_[p + i] + rate * d_[i]
            fast += sum(abs(y + rate * x) for x, y in zip(g_[i], g_[p + i], strict=True))
            if not (far <= radius and fast <= speed):
                yield f'{group} set of rest: a tick leaves it'


def _flown(found: Found) -> NDArray[np.intp]:
    """Return the numbers of the cells that have a tube; `empty_faults` looks at the others."""
    return np.flatnonzero(found.column('last_s') > 0.0)


def tube_faults(
    prover: Prover, found: Found, rng: np.random.Generator, sample: Sample, say: Say
) -> Iterator[str]:
    """Yield what is wrong with the tubes of some cells."""
    problem, group = prover.problem, prover.group
    flown = _flown(found)
    chosen = rng.permutation(flown)[: sample.starts or len(flown)]
    for number, k in enumerate(chosen.tolist()):
        say(f'{group} tubes', number, len(chosen))
        depth = int(found.column('depth')[k])
        cell = Cell(tuple(found.centre[k].tolist()), tuple(found.half[k].tolist()), depth)
        name = f'{group} cell {k}'
        values, boxes, tail, reach = prover.values(cell)
        if not ((found.reach[0] <= reach[0]) & (reach[1] <= found.reach[1])).all():
            yield f'{name}: leaves what its group reaches'
        if not (tail <= found.tail).all(axis=(1, 2)).any():
            yield f'{name}: its norms exceed those of the group'
        if not np.array_equal(values, found.values[k]):
            wrong = cells.VALUES[int((values != found.values[k]).argmax())]
            yield f'{name}: its {wrong} is not {found.column(wrong)[k]!r}'
        if not np.array_equal(boxes, found.boxes[k], equal_nan=True):
            yield f'{name}: its boxes are others'
        last = round(values[1] / problem.scenario.dt_s)
        ticks = set(rng.integers(max(last, 1), size=sample.ticks).tolist())
        if prover.apart:
            yield from merging_faults(prover, cell, ticks, rng, name)
            continue
        motion, start = prover.motion_of(cell), prover.start(cell)
        yield from set_faults(
            problem, motion, start, range(max(ticks, default=-1) + 1), ticks, name
        )


def flight_faults(
    prover: Prover, found: Found, rng: np.random.Generator, count: int, say: Say
) -> Iterator[str]:
    """Yield cells one of whose random flights leaves its tube: states, commands or slew."""
    problem, chosen, done = prover.problem, list(prover.problem.groups[prover.group]), 0
    half = np.array(problem.settings.half) * problem.settings.axes_apart
    flown = _flown(found)
    while done < count and len(flown):
        say(f'{prover.group} flights', done, count)
        k = int(rng.choice(flown))
        cell = Cell(tuple(found.centre[k].tolist()), tuple(found.half[k].tolist()))
        tubes = _tubes(prover, cell)
        for _ in range(min(FLIGHTS_EACH, count - done)):
            point = found.centre[k] + found.half[k] * rng.uniform(-1.0, 1.0, len(cell.centre))
            start = np.array(problem.settings.centre) + half * rng.uniform(-1.0, 1.0, 6)
            start[chosen] = point[: len(chosen)]
            drawn = probing.varied(problem, rng, start)
            unknown = point[len(chosen) :]
            if len(unknown):
                drawn = apart.scenario_in(problem, prover.group, unknown, drawn)
            if not _in_some(prover, probing.fly(problem, drawn), tubes):
                yield f'{prover.group} cell {k}: the flight from {start.tolist()} leaves its tube'
            done += 1


Tubes = list[tuple[int, int, list[Trace]]]
"""From a tick to a tick: a flight is in one of some tubes."""


def _tubes(prover: Prover, cell: Cell) -> Tubes:
    """Return the tubes of a cell, as far as all of them last."""
    if prover.apart:
        return [
            (stage.first, stage.last, [one.trace for one in stage.moved])
            for stage in prover.stages(cell)
            if stage.lasts
        ]
    last, _ = prover.fly(cell)
    return [(0, min(last, prover.problem.scenario.ticks), [prover.trace])]


def _in_some(prover: Prover, flight: Flight, tubes: Tubes) -> bool:
    """Whether a flight is in a tube of a cell at every tick."""
    chosen = list(prover.problem.groups[prover.group])
    states, commands = flight.states[:, chosen], flight.forces_n[:, chosen[: len(chosen) // 2]]
    dt = prover.problem.scenario.dt_s
    return all(
        any(_holds(one, states[first : last + 1], commands[first : last + 1], dt) for one in some)
        for first, last, some in tubes
    )


def _holds(trace: Trace, states: Floats, commands: Floats, dt_s: float) -> bool:
    """Whether a tube holds states (k+1, n), commands of k ticks (or one more), and their slew."""
    ticks, n = len(states) - 1, states.shape[1]
    p = n // 2
    least, most, some = trace.force_low[:ticks], trace.force_high[:ticks], commands[:ticks]
    if not ((least <= some) & (some <= most)).all():
        return False
    slew = np.abs(np.diff(commands, axis=0)) / dt_s
    if not (slew <= trace.slew[: len(slew)]).all():
        return False
    low, high = trace.low[: ticks + 1], trace.high[: ticks + 1]
    if not ((low <= states) & (states <= high)).all():
        return False
    away = states[:ticks] - (low[:ticks] + high[:ticks]) / 2
    tilt, half = trace.laws[:ticks, :, 4], trace.laws[:ticks, :, 5]
    return bool((np.abs(away[:, p:] - tilt * away[:, :p]) <= half + 1e-12).all())
