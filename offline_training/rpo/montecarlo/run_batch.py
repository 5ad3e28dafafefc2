# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""From drawn runs to results; a thread or worker flies a unit of 200 runs at a time.

A run is a scenario too (`scenario_of`): the core and the nodes fly it to the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from concurrent.futures import CancelledError
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from rpo.montecarlo.config import METRICS, Campaign
from rpo.montecarlo.faults import LinkStage
from rpo.montecarlo.sampling import PARAMETERS, STARTS, STRATA, DrawnRuns, draw, parameters_of
from rpo.montecarlo.variations import Draw, sections_of
from rpo_core.chain.flight import JUDGED, Flight, fly
from rpo_core.control.controller import Controller
from rpo_core.files.validation import within
from rpo_core.judge.metrics import FINAL
from rpo_core.judge.verdicts import values_of
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place, Stage
from rpo_core.wire.interfaces import APPLIED_FORCE

UNIT = 200
"""Runs of a unit; a whole number of them is one Latin hypercube."""

AT_ONCE = 16
"""Scenarios that are made before their flights: what their checks compute is then still known."""

assert STRATA % UNIT == 0

COLUMNS = (*PARAMETERS, *METRICS, *FINAL)
"""Columns of the results of every campaign: drawn parameters, metrics, final state."""

Stages = Iterable[tuple[Place, Stage]]


def units(runs: int) -> int:
    """Return the number of units of a campaign."""
    return -(-runs // UNIT)


def columns_of(campaign: Campaign) -> tuple[str, ...]:
    """Return the columns of results: those of every campaign, then what else is known of its runs.

    Those are the metrics of its thrusters, what it judges by, and the draws of its world.
    """
    drawn = parameters_of(campaign.config)[len(PARAMETERS) :]
    return (*COLUMNS, *campaign.more, *drawn)


def fly_unit(
    campaign: Campaign, unit: int, is_stopped: Callable[[], bool] = lambda: False
) -> Floats:
    """Return the results (columns, n) of the runs of a unit.

    is_stopped : asked before each run; raises CancelledError where nobody wants the results
    """
    first = unit * UNIT
    drawn = draw(campaign, first, min(UNIT, campaign.config.runs - first))
    return _fly(campaign, drawn, is_stopped)


def fly_runs(campaign: Campaign, first: int, count: int) -> dict[str, Floats]:
    """Return the results of some runs, column by column (count,)."""
    results = _fly(campaign, draw(campaign, first, count))
    return dict(zip(columns_of(campaign), results, strict=True))


def _fly(
    campaign: Campaign, drawn: DrawnRuns, is_stopped: Callable[[], bool] = lambda: False
) -> Floats:
    values = _known(flights_drawn(campaign, drawn, kept=JUDGED, is_stopped=is_stopped))
    values |= zip(drawn.names, drawn.parameters.T, strict=True)
    return np.array([values[name] for name in columns_of(campaign)])


def fly_drawn(
    campaign: Campaign,
    drawn: DrawnRuns,
    controller: Controller | None = None,
    more: Callable[[int], Stages] | None = None,
) -> dict[str, Floats]:
    """Fly drawn runs; return what is known (n,) of them, by name.

    controller, more : see `flights_drawn`
    """
    return _known(flights_drawn(campaign, drawn, controller, more, JUDGED))


def _known(flights: Iterable[Flight]) -> dict[str, Floats]:
    """Return what is known (n,) of flights, by name."""
    runs = [values_of(flight) for flight in flights]
    return {name: np.array([values[name] for values in runs]) for name in runs[0]}


def flights_drawn(
    campaign: Campaign,
    drawn: DrawnRuns,
    controller: Controller | None = None,
    more: Callable[[int], Stages] | None = None,
    kept: Collection[str] | None = None,
    is_stopped: Callable[[], bool] = lambda: False,
) -> Iterator[Flight]:
    """Yield the flights of drawn runs, one after the other.

    With message faults, their forces are those held at each tick.

    controller : in the place of the campaign's
    more : from the index of a run to stages that no section of its scenario names, with their
        places
    kept : signals that the flights keep; None: all
    is_stopped : asked before each run; CancelledError where nobody wants the results
    """
    flying = controller or campaign.controller
    firsts = range(0, len(drawn.numbers), AT_ONCE)
    some = (drawn.some(slice(first, first + AT_ONCE)) for first in firsts)
    scenarios = chain.from_iterable(scenarios_of(campaign, runs) for runs in some)
    for index, scenario in enumerate(scenarios):
        if is_stopped():
            raise CancelledError
        stages = [*(more(index) if more else ()), *faulty(campaign, drawn, index)]
        yield as_flown(fly(scenario, flying, stages, kept))


def faulty(campaign: Campaign, drawn: DrawnRuns, index: int) -> Stages:
    """Return the stage of the message faults of a drawn run, if the campaign has any."""
    faults, (k0, k1) = campaign.config.faults, drawn.keys[index].tolist()
    turns = campaign.scenario.named('attitude_control') is not None
    return [(Place.UNLOADING, LinkStage(faults, (k0, k1), turns))] if faults else []


def as_flown(flight: Flight) -> Flight:
    """Return a flight with the forces that are held at each tick, where messages are faulty."""
    held = flight.signals.get(APPLIED_FORCE)
    return flight if held is None else replace(flight, forces_n=held)


def fly_run(campaign: Campaign, number: int) -> Flight:
    """Return the flight of run `number`, tick by tick through the core.

    With message faults, its forces are those held at each tick.
    """
    return next(flights_drawn(campaign, draw(campaign, number, 1)))


def scenario_of(campaign: Campaign, number: int) -> Scenario:
    """Return the scenario of run `number`."""
    return scenarios_of(campaign, draw(campaign, number, 1))[0]


def scenarios_of(campaign: Campaign, runs: DrawnRuns) -> list[Scenario]:
    """Return the scenarios of drawn runs: their starts, masses, orbits, disturbances, stages."""
    named = [within(f'run {number}') for number in runs.numbers.tolist()]  # in what is refused
    found = [by(_changes)(campaign, runs, index) for index, by in enumerate(named)]
    return [
        by(replace)(campaign.scenario, **changes) for by, changes in zip(named, found, strict=True)
    ]


def _changes(campaign: Campaign, runs: DrawnRuns, index: int) -> dict[str, Any]:
    """Return what a drawn run changes of the scenario."""
    nominal, number = campaign.scenario, int(runs.numbers[index])
    values = dict(zip(runs.names, runs.parameters[index].tolist(), strict=True))
    dispersed = {name: d.spread for name, d in campaign.config.dispersions.items()}
    k0, k1 = runs.keys[index].tolist()
    start = [values[name] for name in STARTS]
    varied = Draw(values, dispersed, (k0, k1))
    disturbance = nominal.disturbance.varied(
        values['disturbance_amplitude_share'],
        phase_rad=values['disturbance_phase_rad'],
        frequency_share=values['disturbance_frequency_share'],
    )
    return {
        'name': f'{nominal.name}_run_{number}',
        'description': f'run {number} of campaign {campaign.config.name}, '
        f'seed {campaign.config.seed}',
        'initial_position_m': tuple(start[:3]),
        'initial_velocity_m_s': tuple(start[3:]),
        'mass_kg': values['mass_kg'],
        'orbit_radius_m': values['orbit_radius_m'],
        'disturbance': disturbance,
        'sections': sections_of(nominal, varied),
    }
