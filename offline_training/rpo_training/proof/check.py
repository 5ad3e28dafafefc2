# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The independent checker of a proof: `rpo prove --check`.

All cells: they cover the box, their bounds give the claims, refuting flights break their limits.
The table: made anew, the same bits; at random cells compared with the inference in rational
numbers. Random cells of starts: their tubes are made anew, with the same bounds; at random ticks
the law is valid, and the next set holds the image of the set, in rational numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core import files, scenario
from rpo_core.flight import Flight, fly
from rpo_core.validation import InputError
from rpo_training.analysis.certificate import REFUTED
from rpo_training.proof import apart, cells, probing, rest
from rpo_training.proof.cells import Cell, Found
from rpo_training.proof.check_apart import empty_faults, merging_faults
from rpo_training.proof.check_ticks import (
    law_faults,
    set_faults,
    step_faults,
    stepped,
    surface_faults,
)
from rpo_training.proof.claims import claims_of, nowhere, ranges_of, values_of
from rpo_training.proof.corridor import around_of
from rpo_training.proof.exact import exact
from rpo_training.proof.folder import Folder
from rpo_training.proof.problem import Problem
from rpo_training.proof.prover import Prover
from rpo_training.proof.sets import Rest
from rpo_training.proof.tube import Trace

FLIGHTS_EACH = 50
"""Flights from each cell that is drawn."""

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


def check(folder: Folder, sample: Sample, say: Say = lambda what, done, total: None) -> list[str]:
    """Return what is wrong with a finished proof, a sentence each; empty: nothing was found."""
    problem, summary = folder.problem, folder.summary()
    table = folder.table()
    problem.__dict__['table'] = table
    groups = {group: folder.cells(group) for group in problem.groups}
    found = [*claim_faults(problem, groups, summary), *_counterexamples(folder, summary)]
    for group, some in groups.items():
        say(f'{group} cells cover the box', 0, 1)
        found += [*cover_faults(problem, group, some), *empty_faults(problem, group, some)]
    rng = np.random.default_rng(sample.seed)
    say('the surface', 0, 1)
    found += surface_faults(problem, table, rng, sample.surface)
    at_rest = rest_of_summary(summary)
    if at_rest is not None:
        found += rest_faults(problem, at_rest)
    before: dict[str, Found] = {}
    for group in problem.groups:
        around = around_of(problem, group, before)
        before[group] = groups[group]
        prover = Prover(problem, group, at_rest or nowhere(problem), *around)
        found += tube_faults(prover, groups[group], rng, sample, say)
        found += flight_faults(prover, groups[group], rng, sample.flights, say)
    return found


def rest_of_summary(summary: Mapping[str, Any]) -> Rest | None:
    """Return the set of rest that a summary names, None if it names none."""
    return None if summary['rest'] is None else Rest(**summary['rest'])


def claim_faults(
    problem: Problem, groups: Mapping[str, Found], summary: Mapping[str, Any]
) -> Iterator[str]:
    """Yield claims that do not follow from the bounds of the cells."""
    written = summary['claims']
    flown = {key: (claim['found'], tuple(claim['start'])) for key, claim in written.items()}
    for claim in claims_of(problem, groups, rest_of_summary(summary), flown):
        theirs = written.get(claim.key)
        if theirs is None:
            yield f'claim {claim.key}: is missing'
        elif (theirs['bound'], theirs['verdict'], theirs['statement'], theirs['limit']) != (
            claim.bound,
            claim.verdict,
            claim.statement,
            claim.limit,
        ):
            yield (
                f'claim {claim.key}: is {theirs["verdict"]} with {theirs["bound"]!r}; '
                f'the cells say {claim.verdict} with {claim.bound!r}'
            )
    for key, found in ranges_of(groups).items():
        if summary['ranges'].get(key) != vars(found):
            yield f'range {key}: the cells say {found.low!r} to {found.high!r}'


def _counterexamples(folder: Folder, summary: Mapping[str, Any]) -> Iterator[str]:
    """Yield refuted claims whose flight does not break the limit."""
    for key, claim in summary['claims'].items():
        if claim['verdict'] != REFUTED:
            continue
        path = folder.path / f'counterexample_{key}.yaml'
        breaking = files.load(path, scenario.parse)
        if not isinstance(breaking, scenario.Scenario):
            raise InputError(f'{path}: must be a single flight')
        value = values_of(folder.problem, fly(breaking, folder.problem.controller))[key]
        if value != claim['found'] or not value > claim['limit']:
            yield f'claim {key}: its counterexample reaches {value!r}, not {claim["found"]!r}'


def cover_faults(problem: Problem, group: str, found: Found) -> Iterator[str]:
    """Yield a place of the box of starts that no cell holds.

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
    radius, rate, speed = (exact(number) for number in at_rest)
    for group in problem.groups:
        motion = rest.motion_at_rest(problem, group)
        c, g, d, m = rest.as_set(motion, at_rest)
        before, after, _ = stepped(problem, motion, 0, c, g, d, m)
        yield from law_faults(problem, before, f'{group} set of rest')
        yield from step_faults(motion, before, after, f'{group} set of rest')
        p = len(c) // 2
        c_, g_, d_ = exact(after.c.tolist()), exact(after.g.tolist()), exact(after.d.tolist())
        for i in range(p):
            far = abs(c_[i]) + d_[i] + sum(map(abs, g_[i]))
            fast = abs(c_[p + i] + rate * c_[i]) + d_[p + i] + rate * d_[i]
            fast += sum(abs(y + rate * x) for x, y in zip(g_[i], g_[p + i], strict=True))
            if far > radius or fast > speed:
                yield f'{group} set of rest: a tick leaves it'


def tube_faults(
    prover: Prover, found: Found, rng: np.random.Generator, sample: Sample, say: Say
) -> Iterator[str]:
    """Yield what is wrong with the tubes of some cells."""
    problem, group = prover.problem, prover.group
    flown = np.flatnonzero(found.column('last_s') > 0.0)
    chosen = rng.permutation(flown)[: sample.starts or len(flown)]
    for number, k in enumerate(chosen.tolist()):
        say(f'{group} tubes', number, len(chosen))
        depth = int(found.column('depth')[k])
        cell = Cell(tuple(found.centre[k].tolist()), tuple(found.half[k].tolist()), depth)
        name = f'{group} cell {k}'
        values, boxes, tail, reach = prover.values(cell)
        if (reach[0] < found.reach[0]).any() or (reach[1] > found.reach[1]).any():
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
    flown = np.flatnonzero(found.column('last_s') > 0.0)
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
