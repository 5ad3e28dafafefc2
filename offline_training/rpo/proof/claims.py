# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What follows for every start of the box: each claim proven, refuted by a flight, or open."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from typing import Any

import numpy as np

from rpo.proof.cells import CellBounds
from rpo.proof.certificate import PROVEN, REFUTED, UNDECIDED, verdict_of
from rpo.proof.problem import HOLD, Problem, number
from rpo.proof.proven import ProvenClaim
from rpo.proof.tube import InvariantSet
from rpo_core.chain.flight import Flight
from rpo_core.files.validation import InputError
from rpo_core.judge import metrics, verdicts
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.requirements import Requirements

Groups = Mapping[str, CellBounds]
"""Cells of each group, in the order in which they are proven."""


ROOM = 1e-9
"""Share by which a mean is widened, for cells that overlap."""


@dataclass(frozen=True)
class Claim(ProvenClaim):
    """A claim over all starts of the box; `bound` is infinite where none is known.

    key : the requirement of `rpo_core.scenario.requirements` that it is
    start : (6,) of the flight that reached `found` [m, m/s]
    open_cells : cells whose bound exceeds the limit
    """

    start: tuple[float, ...]
    open_cells: int

    @property
    def verdict(self) -> str:
        """`PROVEN`, `REFUTED` or `UNDECIDED`."""
        return verdict_of(self.limit, self.bound, self.found)


def main(groups: Groups) -> CellBounds:
    """Return the cells of the group that is proven last, on which those before it add."""
    return groups[list(groups)[-1]]


BOUNDS = {
    HOLD: ('hold_error_m', 'greatest'),
    'hold_speed_per_axis_m_s': ('hold_speed_m_s', 'greatest'),
    'mean_error_norm_m': ('mean_error_m', 'counted'),
    'mean_speed_norm_m_s': ('mean_speed_m_s', 'counted'),
    'slew_per_axis_n_s': ('slew_n_s', 'greatest'),
    'energy_n2s': ('energy_high_n2s', 'sum'),
}
"""Requirement -> column of the cells, and what the groups before the last one add to its bounds: of
a norm they are counted in it, of what is per axis the greatest counts, of a sum the sum."""


def bounds_of(groups: Groups, key: str) -> Floats:
    """Return the bound (k,) of each cell of the last group, whatever the start of the others."""
    name, way = BOUNDS[key]
    *others, own = (found.column(name) for found in groups.values())
    greatest = [float(other.max()) for other in others]
    if way == 'greatest':
        return np.asarray(np.maximum(own, max(greatest, default=0.0)))
    return np.asarray(own + sum(greatest)) if way == 'sum' else own


def of_planar(groups: Groups, key: str) -> Floats:
    """Return the bound (k,) of each planar cell, where nothing moves on z."""
    still = {
        k: replace(found, values=np.zeros_like(found.values[:1])) for k, found in groups.items()
    }
    return bounds_of({**still, list(groups)[-1]: main(groups)}, key)


def unknown(problem: Problem) -> list[str]:
    """Return the requirements of the scenario that the proof says nothing about."""
    return [key for key in problem.limits if key not in BOUNDS]


def requirements_of(problem: Problem) -> list[str]:
    """Return the requirements that the proof is about; raises InputError if there are none."""
    keys = [key for key in problem.limits if key in BOUNDS]
    if not keys:
        asked = ', '.join(problem.limits)
        raise InputError(f'`claim` must be one of {", ".join(BOUNDS)}; got {asked}')
    return keys


def values_of(problem: Problem, flight: Flight) -> dict[str, float]:
    """Return requirement -> value of a flight, of all that the proof is about."""
    values = {verdict.key: verdict.value for verdict in verdicts.verdicts(flight)}
    if HOLD not in values:
        late = flight.errors[problem.hold_tick :, :3]
        values[HOLD] = float(np.abs(late).max())
    asked = problem.limits
    return {key: value for key, value in values.items() if key in BOUNDS and key in asked}


def claims_of(
    problem: Problem,
    groups: Groups,
    omega: InvariantSet | None,
    flown: Mapping[str, tuple[Any, ...]],
) -> list[Claim]:
    """Return the claims; flown : requirement -> greatest value, its start, and what else it is."""
    assumed: dict[str, Any] = {HOLD: 0.0}
    required = problem.scenario.requirements or Requirements(hold_from_s=0.0, **assumed)
    claims = []
    for key in requirements_of(problem):
        limit = problem.limits[key]
        statement = verdicts.statement(key, required, problem.scenario.duration_s)
        if key == HOLD:
            hold_s = problem.hold_tick * problem.scenario.dt_s
            ever = ', for ever' if holds_for_ever(problem, groups, omega) else ''
            statement = f'position error per axis, from {hold_s:g} s on{ever}'
        value, start, *_ = flown.get(key, (0.0, ()))
        unit = metrics.UNITS[key]
        bound = bound_of(problem, groups, omega, key)
        claims.append(
            Claim(key, statement, unit, limit, bound, value, start, _open(groups, key, limit))
        )
    return claims


def bound_of(problem: Problem, groups: Groups, omega: InvariantSet | None, key: str) -> float:
    """Return what no start exceeds; what is held for ever, in the invariant set too."""
    bound = float(bounds_of(groups, key).max())
    if key == HOLD and omega is not None and holds_for_ever(problem, groups, omega):
        return max(bound, omega.radius_m)
    return bound


def _open(groups: Groups, key: str, limit: float) -> int:
    """Return the number of cells that exceed a limit: of the last group, and of those before it."""
    earlier = [bounds_of({name: groups[name]}, key) for name in list(groups)[:-1]]
    return sum(int((bounds > limit).sum()) for bounds in [of_planar(groups, key), *earlier])


def holds_for_ever(problem: Problem, groups: Groups, omega: InvariantSet | None) -> bool:
    """Whether every tube ends in an invariant set that is small enough to hold."""
    if omega is None or omega.radius_m > problem.hold_error_m:
        return False
    return all(np.isfinite(found.column('inside_s')).all() for found in groups.values())


@dataclass(frozen=True)
class Range:
    """What the tubes say of every flight beside the claims.

    low, high : no flight is outside; infinite where a tube does not last
    """

    statement: str
    unit: str
    low: float
    high: float


def ranges_of(problem: Problem, groups: Groups) -> dict[str, Range]:
    """Return what the tubes say of every flight: energy, its mean, force, speed, arrival.

    The mean is over starts that are equally likely everywhere in the box; cells overlap by less
    than is added here. A proof per axis has no mean: their cells are not of starts.
    """
    low, high, mean_low, mean_high = 0.0, 0.0, 0.0, 0.0
    for every in groups.values():
        cells = every.flown
        least, most = cells.column('energy_low_n2s'), cells.column('energy_high_n2s')
        least = np.where(np.isfinite(least), least, 0.0)
        low, high = low + float(least.min()), high + float(most.max())
        sides = np.where(cells.half > 0.0, cells.half, 1.0)
        share = np.ldexp(sides, -np.frexp(sides.max(axis=0))[1]).prod(axis=1)  # not rounded by this
        share = share / math.fsum(share)
        # Exact sums: those of NumPy differ in the last digit where the memory is another.
        mean_low += math.fsum(share * least)
        mean_high += math.fsum(share * most)

    def greatest(name: str) -> float:
        return max(float(cells.column(name).max()) for cells in groups.values())

    mean = Range(
        'energy, mean over the box', 'N^2 s', mean_low * (1.0 - ROOM), mean_high * (1.0 + ROOM)
    )
    return {
        'energy_n2s': Range('energy of each flight', 'N^2 s', low, high),
        **({} if problem.settings.axes_apart else {'mean_energy_n2s': mean}),
        'force_n': Range('force per axis', 'N', 0.0, greatest('force_n')),
        'speed_m_s': Range('speed per axis, on the way', 'm/s', 0.0, greatest('speed_m_s')),
        'arrival_s': Range('within 0.5 m per axis from', 's', 0.0, greatest('arrival_s')),
    }


def summary_of(
    claims: Sequence[Claim], omega: InvariantSet | None, ranges: Mapping[str, Range], groups: Groups
) -> dict[str, Any]:
    """Return the summary of a proof, as it is written."""
    return {
        'rest': None if omega is None else {k: float(v) for k, v in omega._asdict().items()},
        'cells': {group: len(found.values) for group, found in groups.items()},
        'claims': {
            claim.key: {
                'statement': claim.statement,
                'verdict': claim.verdict,
                'unit': claim.unit,
                'limit': float(claim.limit),
                'bound': float(claim.bound),
                'found': float(claim.found),
                'start': [float(x) for x in claim.start],
                'open_cells': claim.open_cells,
            }
            for claim in claims
        },
        'ranges': {key: vars(found) for key, found in ranges.items()},
    }


def empty_set(problem: Problem) -> InvariantSet:
    """Return an empty invariant set, for tubes that fly on to the end."""
    return InvariantSet(problem.hold_error_m, 0.06, 0.0)


def worst(claims: Sequence[Claim]) -> str:
    """Return the verdict over all claims: refuted before undecided before proven."""
    words = {claim.verdict for claim in claims}
    return next((v for v in (REFUTED, UNDECIDED) if v in words), PROVEN)


def upper(value: float) -> str:
    """Return a number in four digits, rounded up."""
    return _rounded(value, ROUND_CEILING)


def lower(value: float) -> str:
    """Return a number in four digits, rounded down."""
    return _rounded(value, ROUND_FLOOR)


def _rounded(value: float, way: str) -> str:
    return f'{float(Context(prec=4, rounding=way).create_decimal(repr(value))):.4g}'


def row_of(claim: Claim) -> tuple[str, ...]:
    """Return a claim as tables show it: what, limit, proven, flown, open cells, verdict."""
    return (
        claim.statement,
        f'{number(claim.limit)} {claim.unit}',
        upper(claim.bound),
        lower(claim.found) if claim.start else '',
        str(claim.open_cells),
        claim.verdict,
    )
