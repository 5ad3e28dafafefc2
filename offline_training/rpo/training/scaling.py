# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A controller scaled for another vehicle and another mission, without training.

The mass is that of the vehicle, and the force follows from the authority that the controller was
made for. Two numbers are free, its units of length L and time T (`control.similarity`). They
are chosen on a grid around those of the scenario, by flying it: from its start and, as in a search,
around it (`rpo.training.fitting`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import product
from typing import NamedTuple

from rpo.training.fitting import around, refuse_impossible
from rpo_core.chain.flight import flights_of
from rpo_core.control.controller import AnyController
from rpo_core.control.controller_file import Scaling
from rpo_core.files.validation import InputError, quoted
from rpo_core.judge import similarity
from rpo_core.judge.similarity import SCALED, Units, base_of, units_of
from rpo_core.judge.verdicts import Verdict, number, verdicts
from rpo_core.scenario.scenario import Scenario, ScenarioSet
from rpo_core.world.starts import Box, Grid, Starts

TIMES = (0.4, 0.55, 0.7, 0.85, 1.0, 1.25, 1.8, 3.0)
LENGTHS = (0.4, 0.6, 1.0, 1.6, 2.5)
"""Shares of the scenario's own units that are flown first."""

STEPS = (1.12, 1.05, 1.02)
"""Then, ratios to the best so far."""

_RANDOM = 19  # random starts of a box that are flown for the choice


class Flown(NamedTuple):
    """One scaling, flown: in `units` the controller is what it was in its own.

    worst : of each requirement, the verdict of the flights that takes most of its limit
    """

    controller: AnyController
    units: Units
    worst: list[Verdict]

    @property
    def rank(self) -> tuple[int, list[float]]:
        """The order in which scalings are chosen, the least is best: misses, then shares of limits.

        The largest share decides; of scalings that agree to a hundredth, the next largest.
        """
        shares = sorted((round(_share(verdict), 2) for verdict in self.worst), reverse=True)
        return sum(verdict.holds is False for verdict in self.worst), shares


class Found(NamedTuple):
    """The scaling that was chosen.

    tried : scalings that were flown, each from so many `starts`
    why : they still miss requirements, a sentence for each
    trained_for : the scenario that the controller was trained for, before any scaling
    multiples : of the units that it was trained in
    made, here : similarity numbers of that training and of the scenario
    """

    best: Flown
    tried: int
    starts: int
    why: list[str]
    trained_for: str
    multiples: Units
    made: dict[str, float | None]
    here: dict[str, float | None]

    def named(self, name: str, given: str, scenario: str, command: str) -> AnyController:
        """Return the controller with a name and a provenance.

        given : the controller that was scaled; scenario : what for; command : that scaled it
        """
        length, time, mass = self.multiples
        scaled = {
            'from': given,
            'trained_for': self.trained_for,
            'length': length,
            'time': time,
            'mass': mass,
        }
        provenance = {'method': 'rpo scale', 'command': command, 'scenario': scenario}
        return replace(
            self.best.controller,
            name=name,
            description=f'{quoted(given)}, scaled for {quoted(scenario)}.',  # not `trained for`
            provenance={**provenance, SCALED: scaled},
        )


def search(
    controller: AnyController,
    found: Scenario | ScenarioSet,
    report: Callable[[str, float, float], None],
) -> Found:
    """Return the scaling of a controller that flies a scenario or a set best.

    Raises InputError where it does not scale, or the scenario has no requirements.
    """
    base = base_of(found)
    if base.requirements is None:
        raise InputError(
            f'scenario {found.name} has no requirements to scale for: add the section '
            '`requirements` (docs/file_formats.md)'
        )
    name, trained, own, made_numbers = similarity.made_for(controller)
    starts, wanted = _starts(found), units_of(found)
    alone = not isinstance(starts, ScenarioSet)
    most = 1 + (1 if alone else len(LENGTHS)) * len(TIMES) + (3 if alone else 9) * len(STEPS)
    flown: dict[Units, Flown] = {}
    refused: list[InputError] = []

    def fly(units: Units) -> None:
        if units in flown:
            return
        try:
            made = scaled_to(controller, own, units, base)
            report(f'scalings of {controller.name}', len(flown), most)
            rows = [verdicts(flight) for flight in flights_of(made, starts)]
        except InputError as error:
            refused.append(error)
            return
        worst = [max(row, key=_share) for row in zip(*rows, strict=True)]
        flown[units] = Flown(made, units, worst)

    def best() -> Flown:
        return min(flown.values(), key=lambda each: each.rank)

    fly(own._replace(mass_kg=base.mass_kg))
    for length, time in product((1.0,) if alone else LENGTHS, TIMES):
        fly(_multiple(wanted, length, time))
    if not flown:
        raise refused[0]
    for step in STEPS:
        near, ratios = best().units, (1.0 / step, 1.0, step)
        for length, time in product((1.0,) if alone else ratios, ratios):
            fly(_multiple(near, length, time))
    units = best().units
    force_n = similarity.force_of(controller) / own.force_n * units.force_n
    return Found(
        best(),
        len(flown),
        len(starts.initial_positions_m) if isinstance(starts, ScenarioSet) else 1,
        _why(best(), list(flown.values()), found),
        name,
        Units(
            units.length_m / trained.length_m,
            units.time_s / trained.time_s,
            units.mass_kg / trained.mass_kg,
        ),
        made_numbers,
        similarity.numbers(found, units, force_n),
    )


def scaled_to(
    controller: AnyController, own: Units, units: Units, vehicle: Scenario
) -> AnyController:
    """Return a controller in other units than its own; raises InputError."""
    length, time = units.length_m / own.length_m, units.time_s / own.time_s
    force = units.mass_kg / own.mass_kg * length / (time * time)
    scaling = Scaling(length, time, force, vehicle)
    return controller.scaled(scaling)


def _multiple(units: Units, length: float, time: float) -> Units:
    """Return multiples of units, rounded to four digits: a person reads the file."""
    length_m, time_s = units.length_m * length, units.time_s * time
    return Units(float(f'{length_m:.4g}'), float(f'{time_s:.4g}'), units.mass_kg)


def _share(verdict: Verdict) -> float:
    """Return how much of its limit a flight takes."""
    if verdict.holds is None or verdict.value <= 0.0:
        return 0.0
    return verdict.value / verdict.limit if verdict.limit else math.inf


def _starts(found: Scenario | ScenarioSet) -> Scenario | ScenarioSet:
    """Return what is flown for the choice; a scenario with sections alone, as it takes long."""
    if isinstance(found, ScenarioSet):
        return replace(found, starts=_few(found.starts))
    return found if found.sections else ScenarioSet(found, around(found))


def _few(starts: Starts) -> Starts:
    """Return the outermost starts of a set, and some between."""
    if isinstance(starts, Box):
        return replace(starts, random=min(starts.random, _RANDOM))
    axes = vars(starts).values()
    return Grid(*(tuple(sorted({min(a), sorted(a)[len(a) // 2], max(a)})) for a in axes))


def _why(best: Flown, flown: list[Flown], found: Scenario | ScenarioSet) -> list[str]:
    """Return a sentence for each requirement that the best scaling misses."""
    places = [place for place, verdict in enumerate(best.worst) if verdict.holds is False]
    if not places:
        return []
    try:
        refuse_impossible(found)
    except InputError as error:
        return [str(error)]
    sentences = []
    for place in places:
        other = min(flown, key=lambda each: (not each.worst[place].holds, each.rank))
        lost = sorted((v for v in other.worst if v.holds is False), key=_share)
        units = f'L = {other.units.length_m:g} m and T = {other.units.time_s:g} s'
        rest = f', and {len(lost) - 1} more are missed' if len(lost) > 1 else ''
        said = f'with {units} it holds, but then {_said(lost[-1])}{rest}' if lost else units
        if not other.worst[place].holds:
            other = min(flown, key=lambda each: _share(each.worst[place]))
            said = f'no scaling that was flown keeps it; at the least, {_said(other.worst[place])}'
        sentences.append(f'{best.worst[place].statement}: {said}')
    return sentences


def _said(verdict: Verdict) -> str:
    value, limit = (number(x, verdict.unit) for x in (verdict.value, verdict.limit))
    return f'{verdict.statement} is {value} (limit {limit})'
