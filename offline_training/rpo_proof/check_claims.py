# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The checker's own claims: from the cells, and from flights that it flies again."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rpo_core.chain.flight import fly
from rpo_core.files import scenario
from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import quoted, shown
from rpo_core.world.disturbance import Disturbance
from rpo_judge.analysis.certificate import REFUTED
from rpo_proof.cells import Found
from rpo_proof.claims import Claim, Range, claims_of, ranges_of, summary_of, values_of
from rpo_proof.folder import Folder
from rpo_proof.problem import Problem
from rpo_proof.sets import Rest

ROOM = 2.0**-44
"""Share of place and width by which a start that is drawn from a cell may be outside the box."""

Flown = dict[str, tuple[float, tuple[float, ...]]]
"""Requirement -> value and start of a flight."""


@dataclass(frozen=True)
class Written:
    """What a summary says.

    document : all of it; rest : its set of rest; flown : its flights
    """

    document: dict[str, Any]
    rest: Rest | None
    flown: Flown

    @classmethod
    def of(cls, folder: Folder) -> Written:
        """Read the summary of a folder; raises InputError."""
        document = folder.summary()
        rest = None if document['rest'] is None else Rest(**document['rest'])
        flown = {k: (c['found'], tuple(c['start'])) for k, c in document['claims'].items()}
        return cls(document, rest, flown)


@dataclass(frozen=True)
class Follows:
    """What follows from cells and flights.

    faults : what the summary says else
    """

    claims: list[Claim]
    ranges: dict[str, Range]
    faults: list[str]


def what_follows(
    problem: Problem, groups: Mapping[str, Found], written: Written, flown: Flown
) -> Follows:
    """Return the claims of cells and flights, and where the summary says something else."""
    claims = claims_of(problem, groups, written.rest, flown)
    ranges = ranges_of(problem, groups)
    ours, faults = summary_of(claims, written.rest, ranges, groups), list[str]()
    for claim in claims:
        value, start = written.flown.get(claim.key, (claim.found, claim.start))
        if not value <= claim.bound:
            faults.append(f'claim {claim.key}: a flight reaches {value!r}, beyond its bound')
        if claim.key not in flown:  # not in the folder: the figure is not checked
            ours['claims'][claim.key].update(found=value, start=list(start))
    return Follows(claims, ranges, [*differences(written.document, ours, ''), *faults])


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


def flights_again(folder: Folder, written: Written) -> tuple[Flown, list[str]]:
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
        wrong = strayed(folder.problem, flight)
        if wrong:
            faults.append(f'claim {key}: its flight {wrong}')
            continue
        found = values_of(folder.problem, fly(flight, folder.problem.controller))
        if found.get(key) != value or flight.start != start:
            faults.append(
                f'claim {key}: its flight reaches {found.get(key)!r} from {flight.start}, '
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
    known = problem.settings.mass_share == problem.settings.disturbance_share == 0.0
    if not (known and len(start) == 6):
        return None
    x, y, z, vx, vy, vz = start
    return replace(
        problem.scenario, initial_position_m=(x, y, z), initial_velocity_m_s=(vx, vy, vz)
    )


def strayed(problem: Problem, flight: Scenario) -> str:
    """Return how a flight is none of those that a proof is about, '' if it is one."""
    base, settings = problem.scenario, problem.settings
    alike = replace(
        flight,
        initial_position_m=base.initial_position_m,
        initial_velocity_m_s=base.initial_velocity_m_s,
        mass_kg=base.mass_kg,
        disturbance=base.disturbance,
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


def _is_within(one: Disturbance, other: Disturbance, most: float) -> bool:
    """Whether a disturbance is another one, at any phase and up to so many times; 0: the same."""
    if most == 0.0:
        return one == other
    terms = [
        [replace(h, amplitude_n=0.0, phase_rad=0.0) for h in found.harmonics]
        for found in (one, other)
    ]
    sizes = [
        [*found.constant_n, *(h.amplitude_n for h in found.harmonics)] for found in (one, other)
    ]
    return terms[0] == terms[1] and all(
        abs(ours) <= most * abs(theirs) * (1.0 + ROOM) for ours, theirs in zip(*sizes, strict=True)
    )
