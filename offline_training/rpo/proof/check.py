# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The independent checker of a proof: `rpo prove --check`.

All cells: they cover the box, their bounds give the claims; the flights of the claims are flown
again. The table: made by the checker itself, and at random cells compared with the inference in
rational numbers. Random cells of starts: their tubes are made anew, with the same bounds; at random
ticks the law is valid, and the next set holds the image of the set, in rational numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo.proof import cells, flights, invariant, per_axis
from rpo.proof.cells import Cell, CellBounds, Prover
from rpo.proof.certificate import REFUTED
from rpo.proof.check_sets import (
    empty_faults,
    exact,
    law_faults,
    merging_faults,
    set_faults,
    step_faults,
    stepped,
    surface_faults,
    table_faults,
)
from rpo.proof.claims import Claim, Range, claims_of, empty_set, ranges_of, summary_of, values_of
from rpo.proof.flights import context_of
from rpo.proof.folder import Folder
from rpo.proof.problem import Problem
from rpo.proof.tube import InvariantSet, Trace
from rpo_core.chain.flight import Flight, fly
from rpo_core.files.validation import InputError, quoted, shown
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario import scenario
from rpo_core.scenario.scenario import Scenario
from rpo_core.world.disturbance import Disturbance

FLIGHTS_EACH = 50
"""Flights from each cell that is drawn."""

MOST_FAULTS = 20
"""Faults of each step of the check that are listed; the first step with a fault is the last one."""

OVERLAPPING = 1e-10
"""Cells may overlap by so much of the box, a tenth of what a mean is widened for it."""

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


@dataclass(frozen=True, repr=False)
class Checked:
    """What the checker found.

    faults : what is wrong, a sentence each; then nothing else counts
    claims, ranges : what it computed itself, from the cells and from flights
    drawn : group -> cells whose tubes it made anew, and all cells that have one
    sample : what was drawn
    """

    faults: list[str]
    claims: list[Claim]
    ranges: dict[str, Range]
    drawn: dict[str, tuple[int, int]]
    sample: Sample = Sample()

    def __repr__(self) -> str:
        drawn = ', '.join(f'{some} of {every} {g}' for g, (some, every) in self.drawn.items())
        return f'<Checked {drawn} cells: {"; ".join(self.faults) or "nothing wrong was found"}>'

    @property
    def ok(self) -> bool:
        """Whether nothing wrong was found."""
        return not self.faults

    @property
    def whole(self) -> bool:
        """Whether all tubes were made anew."""
        return all(some == every for some, every in self.drawn.values())


def check(folder: Folder, sample: Sample, say: Say = lambda what, done, total: None) -> Checked:
    """Check a finished proof; raises InputError if it cannot be read."""
    problem = replace(folder.problem)  # without what a prover has computed in it
    written = WrittenSummary.of(folder)
    groups = {group: folder.cells(group) for group in problem.groups}
    arrays = folder.table()
    follows = Checked([], [], {}, {})
    faults = _first(
        fault
        for group, bounds in groups.items()
        for fault in (*cover_faults(problem, group, bounds), *empty_faults(problem, group, bounds))
    )
    if not faults:
        flown, faults = fly_again(folder, written)
        follows = recompute(problem, groups, written, flown)
        faults = [*faults, *follows.faults][:MOST_FAULTS]
    for step in _steps(problem, groups, written.omega, arrays, sample, say):
        faults = faults or _first(step)
    drawn = {
        group: (min(sample.starts or count, count), count)
        for group, count in ((g, len(_flown(bounds))) for g, bounds in groups.items())
    }
    return Checked(faults, follows.claims, follows.ranges, drawn, sample)


def _first(faults: Iterable[str]) -> list[str]:
    return list(islice(faults, MOST_FAULTS))


def _steps(
    problem: Problem,
    groups: Mapping[str, CellBounds],
    omega: InvariantSet | None,
    arrays: Mapping[str, NDArray[Any]],
    sample: Sample,
    say: Say,
) -> Iterator[Iterable[str]]:
    """Yield the steps of a check that take long, each an iterator of faults."""
    rng = np.random.default_rng(sample.seed)
    say('the surface', 0, 1)
    yield table_faults(problem, arrays)
    yield surface_faults(problem, rng, sample.surface)
    if omega is not None:
        yield invariant_faults(problem, omega)
    before: dict[str, CellBounds] = {}
    for group, bounds in groups.items():
        around = context_of(problem, group, before)
        before[group] = bounds
        prover = Prover(problem, group, omega or empty_set(problem), *around)
        yield tube_faults(prover, bounds, rng, sample, say)
        yield flight_faults(prover, bounds, rng, sample.flights, say)


def cover_faults(problem: Problem, group: str, cover: CellBounds) -> Iterator[str]:
    """Yield a place of the box of starts that no cell holds, or that cells lie on each other.

    A box is held by one cell, or is cut where a cell ends, or holds a gap.
    """
    chosen, settings = list(problem.groups[group]), problem.settings
    centre, half = np.array(settings.centre)[chosen], np.array(settings.half)[chosen]
    if settings.axes_apart:
        unknown = np.array(per_axis.ranges(problem, group)).reshape(-1, 2)
        centre = np.concatenate([centre, unknown.mean(axis=1)])
        half = np.concatenate([half, np.diff(unknown)[:, 0] / 2])
    low, high = np.nextafter(centre - half, -np.inf), np.nextafter(centre + half, np.inf)
    low, high = np.where(half > 0.0, low, centre), np.where(half > 0.0, high, centre)
    if problem.odd:
        low[0] = centre[0]
    wide = half > 0.0
    with np.errstate(over='ignore'):
        shares = (2.0 * cover.half[:, wide] / (high - low)[wide]).prod(axis=1)
        total = float(shares.sum())
    if not total <= 1.0 + OVERLAPPING or cover.half[:, ~wide].any():
        yield f'{group} cells: they hold more than the box, or some of it twice'
        return
    # The edges of a cell are rounded here; it reaches further than that into its neighbours.
    room = (np.abs(cover.centre) + cover.half) * 2.0**-50 * (cover.half > 0.0)
    lows, highs = cover.centre - cover.half + room, cover.centre + cover.half - room
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


def invariant_faults(problem: Problem, omega: InvariantSet) -> Iterator[str]:
    """Yield why the set of omega is not mapped into itself, in rational numbers."""
    if problem.settings.axes_apart:
        yield 'set of omega: a proof per axis has none, for it would have to hold x and y together'
        return
    radius, rate, speed = (exact(number) for number in omega)
    for group in problem.groups:
        motion = invariant.motion_inside(problem, group)
        before, after, m = stepped(problem, motion, 0, *invariant.as_set(motion, omega))
        if m < 0:
            yield f'{group} set of omega: it has no law'
            continue
        yield from law_faults(problem, before, f'{group} invariant set')
        yield from step_faults(motion, before, after, f'{group} invariant set')
        p = len(after.c) // 2
        to_speed = np.hstack([np.diag([rate] * p), np.eye(p, dtype=int)])
        middle, wide, box = map(exact, (after.c, after.g, after.d))
        far = (abs(middle) + box + abs(wide).sum(axis=1))[:p]
        fast = abs(to_speed @ middle) + to_speed @ box + abs(to_speed @ wide).sum(axis=1)
        if (far > radius).any() or (fast > speed).any():
            yield f'{group} set of omega: a tick leaves it'


def _flown(bounds: CellBounds) -> NDArray[np.intp]:
    """Return the numbers of the cells that have a tube; `empty_faults` looks at the others."""
    return np.flatnonzero(bounds.column('last_s') > 0.0)


def tube_faults(
    prover: Prover, bounds: CellBounds, rng: np.random.Generator, sample: Sample, say: Say
) -> Iterator[str]:
    """Yield what is wrong with the tubes of some cells."""
    problem, group = prover.problem, prover.group
    flown = _flown(bounds)
    chosen = rng.permutation(flown)[: sample.starts or len(flown)]
    for number, k in enumerate(chosen.tolist()):
        say(f'{group} tubes', number, len(chosen))
        depth = int(bounds.column('depth')[k])
        cell = Cell(tuple(bounds.centre[k].tolist()), tuple(bounds.half[k].tolist()), depth)
        name = f'{group} cell {k}'
        values, boxes, tail, reach = prover.values(cell)
        if not ((bounds.reach[0] <= reach[0]) & (reach[1] <= bounds.reach[1])).all():
            yield f'{name}: leaves what its group reaches'
        if not (tail <= bounds.tail).all(axis=(1, 2)).any():
            yield f'{name}: its norms exceed those of the group'
        if not np.array_equal(values, bounds.values[k]):
            wrong = cells.VALUES[int((values != bounds.values[k]).argmax())]
            yield f'{name}: its {wrong} is not {bounds.column(wrong)[k]!r}'
        if not np.array_equal(boxes, bounds.boxes[k], equal_nan=True):
            yield f'{name}: its boxes are others'
        last = round(values[1] / problem.scenario.dt_s)
        ticks = set(rng.integers(max(last, 1), size=sample.ticks).tolist())
        if prover.per_axis:
            yield from merging_faults(prover, cell, ticks, rng, name)
            continue
        motion, start = prover.motion_of(cell), prover.start(cell)
        yield from set_faults(
            problem, motion, start, range(max(ticks, default=-1) + 1), ticks, name
        )


def flight_faults(
    prover: Prover, bounds: CellBounds, rng: np.random.Generator, count: int, say: Say
) -> Iterator[str]:
    """Yield cells one of whose random flights leaves its tube: states, commands or slew."""
    problem, chosen, done = prover.problem, list(prover.problem.groups[prover.group]), 0
    half = np.array(problem.settings.half) * problem.settings.axes_apart
    flown = _flown(bounds)
    while done < count and len(flown):
        say(f'{prover.group} flights', done, count)
        k = int(rng.choice(flown))
        cell = Cell(tuple(bounds.centre[k].tolist()), tuple(bounds.half[k].tolist()))
        tubes = _tubes(prover, cell)
        for _ in range(min(FLIGHTS_EACH, count - done)):
            point = bounds.centre[k] + bounds.half[k] * rng.uniform(-1.0, 1.0, len(cell.centre))
            start = np.array(problem.settings.centre) + half * rng.uniform(-1.0, 1.0, 6)
            start[chosen] = point[: len(chosen)]
            drawn = flights.vary(problem, rng, start)
            unknown = point[len(chosen) :]
            if len(unknown):
                drawn = per_axis.scenario_in(problem, prover.group, unknown, drawn)
            if not _in_some(prover, fly(drawn, problem.controller), tubes):
                yield f'{prover.group} cell {k}: the flight from {start.tolist()} leaves its tube'
            done += 1


Tubes = list[tuple[int, int, list[Trace]]]
"""From a tick to a tick: a flight is in one of some tubes."""


def _tubes(prover: Prover, cell: Cell) -> Tubes:
    """Return the tubes of a cell, as far as all of them last."""
    if prover.per_axis:
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
    dt, limit = prover.problem.scenario.dt_s, prover.problem.scenario.max_force_n
    states, commands = flight.states[:, chosen], flight.forces_n[:, chosen[: len(chosen) // 2]]
    commands = np.clip(commands, -limit, limit)  # a tube has forces that thrusters exert
    return all(
        any(_holds(one, states[first : last + 1], commands[first : last + 1], dt) for one in some)
        for first, last, some in tubes
    )


def _holds(trace: Trace, states: Floats, commands: Floats, dt_s: float) -> bool:
    """Whether a tube holds states (k+1, n), commands of k ticks (or one more), and their slew."""
    ticks, n = len(states) - 1, states.shape[1]
    p = n // 2
    low_n, high_n, some = trace.force_low[:ticks], trace.force_high[:ticks], commands[:ticks]
    if not ((low_n <= some) & (some <= high_n)).all():
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


ROOM = 2.0**-44
"""Share of place and width by which a start that is drawn from a cell may be outside the box."""

Flown = dict[str, tuple[float, tuple[float, ...]]]
"""Requirement -> value and start of a flight."""


@dataclass(frozen=True)
class WrittenSummary:
    """What a summary says.

    document : all of it; omega : its invariant set; flown : its flights
    """

    document: dict[str, Any]
    omega: InvariantSet | None
    flown: Flown

    @classmethod
    def of(cls, folder: Folder) -> WrittenSummary:
        """Read the summary of a folder; raises InputError."""
        document = folder.summary()
        omega = None if document['rest'] is None else InvariantSet(**document['rest'])
        flown = {k: (c['found'], tuple(c['start'])) for k, c in document['claims'].items()}
        return cls(document, omega, flown)


def recompute(
    problem: Problem, groups: Mapping[str, CellBounds], written: WrittenSummary, flown: Flown
) -> Checked:
    """Return the claims of cells and flights, and where the summary says something else."""
    claims = claims_of(problem, groups, written.omega, flown)
    ranges = ranges_of(problem, groups)
    ours, faults = summary_of(claims, written.omega, ranges, groups), list[str]()
    for claim in claims:
        value, start = written.flown.get(claim.key, (claim.found, claim.start))
        if not value <= claim.bound:
            faults.append(f'claim {claim.key}: a flight reaches {value!r}, beyond its bound')
        if claim.key not in flown:  # not in the folder: the figure is not checked
            ours['claims'][claim.key].update(found=value, start=list(start))
    return Checked([*differences(written.document, ours, ''), *faults], claims, ranges, {})


def followed(folder: Folder) -> tuple[WrittenSummary, dict[str, CellBounds], Checked]:
    """Return what a finished proof says, its cells, and what follows; the cells are taken as true.

    Raises InputError where the folder says something else than follows.
    """
    written = WrittenSummary.of(folder)
    groups = {group: folder.cells(group) for group in folder.problem.groups}
    flown, faults = fly_again(folder, written)
    follows = recompute(folder.problem, groups, written, flown)
    for fault in (*faults, *follows.faults):
        raise InputError(f'{folder.path}: {fault}')
    return written, groups, follows


def differences(theirs: Any, ours: Any, where: str) -> Iterator[str]:
    """Yield where a document is not what it should be: other keys, types, lengths or values."""
    if type(theirs) is not type(ours):
        yield f'summary.yaml: {quoted(where)} is {shown(theirs)}; the cells say {shown(ours)}'
    elif isinstance(ours, dict):
        for key in sorted(theirs.keys() | ours.keys()):
            place = f'{where}.{key}'.lstrip('.')
            if key not in theirs or key not in ours:
                what = 'is missing' if key in ours else 'is not what the cells say anything of'
                yield f'summary.yaml: {quoted(place)} {what}'
            else:
                yield from differences(theirs[key], ours[key], place)
    elif theirs != ours:  # or it is not a number
        yield f'summary.yaml: {quoted(where)} is {shown(theirs)}; the cells say {shown(ours)}'


def fly_again(folder: Folder, written: WrittenSummary) -> tuple[Flown, list[str]]:
    """Fly the flights of a summary again.

    Returns
    -------
    flown : what they reach; without those that are not in the folder
    faults : flights that do not fit the proof, or reach something else
    """
    flown, faults = Flown(), list[str]()
    for key, (value, start) in written.flown.items():
        flight = _flight(folder, key, start)
        if flight is None:
            if written.document['claims'][key]['verdict'] == REFUTED:
                faults.append(f'claim {key}: is refuted, and its flight is not in the folder')
            continue
        wrong = why_outside(folder.problem, flight)
        if wrong:
            faults.append(f'claim {key}: its flight {wrong}')
            continue
        values = values_of(folder.problem, fly(flight, folder.problem.controller))
        if values.get(key) != value or flight.start != start:
            faults.append(
                f'claim {key}: its flight reaches {values.get(key)!r} from {flight.start}, '
                f'not {value!r} from {start}'
            )
            continue
        flown[key] = value, start
    return flown, faults


def _flight(folder: Folder, key: str, start: Sequence[float]) -> Scenario | None:
    """Return the flight of a claim; None if it is not in the folder, nor follows from its start."""
    problem = folder.problem
    for path in folder.flights(key):
        if path.is_file():
            return scenario.load_scenario(path)
    undisturbed = problem.settings.mass_share == problem.settings.disturbance_share == 0.0
    if not (undisturbed and len(start) == 6):
        return None
    return problem.scenario.starting_at(start)


def why_outside(problem: Problem, flight: Scenario) -> str:
    """Return how a flight is none of those that a proof is about, '' if it is one."""
    base, settings = problem.scenario, problem.settings
    alike = replace(
        flight.starting_at(base.start), mass_kg=base.mass_kg, disturbance=base.disturbance
    )
    if scenario.dumps(alike) != scenario.dumps(base):
        return 'is of another scenario'
    for number, centre, half in zip(flight.start, settings.centre, settings.half, strict=True):
        if not abs(number - centre) <= half + ROOM * (abs(centre) + half):
            return f'starts outside the box, at {flight.start}'
    if not abs(flight.mass_kg / base.mass_kg - 1.0) <= settings.mass_share * (1.0 + ROOM) + ROOM:
        return f'is of another mass, {flight.mass_kg} kg'
    if not _is_within(flight.disturbance, base.disturbance, settings.disturbance_share):
        return 'is under another disturbance'
    return ''


def _is_within(one: Disturbance, other: Disturbance, share: float) -> bool:
    """Whether a disturbance is another one, at any phase and up to so many times; 0: the same."""
    if share == 0.0:
        return one == other
    terms = [
        [replace(h, amplitude_n=0.0, phase_rad=0.0) for h in force.harmonics]
        for force in (one, other)
    ]
    sizes = [
        [*force.constant_n, *(h.amplitude_n for h in force.harmonics)] for force in (one, other)
    ]
    return terms[0] == terms[1] and all(
        abs(ours) <= share * abs(theirs) * (1.0 + ROOM) for ours, theirs in zip(*sizes, strict=True)
    )
