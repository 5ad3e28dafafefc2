# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Whole flights of a set from the engine: the bits of `rpo_core.chain.flight.fly`, many at once."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.flight import Flight, fly
from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.files.scenario import SET_SECTIONS, Scenario, ScenarioSet
from rpo_guidance.plan import Guidance
from rpo_montecarlo.engine import lanes, parts, tick
from rpo_montecarlo.engine.cases import Case, Crossed, case_of_set
from rpo_montecarlo.engine.judged import make_trace
from rpo_montecarlo.engine.parts import Control, Navigation, Runs
from rpo_montecarlo.engine.plans import guiding_of
from rpo_montecarlo.engine.population import population_of
from rpo_montecarlo.engine.simulator import Scratch
from rpo_montecarlo.engine.support import announce, why_not

Floats = NDArray[np.float64]


def flights_of(controller: AnyController, found: Scenario | ScenarioSet) -> Iterator[Flight]:
    """Yield the flight of each member; raises InputError if a controller does not fit."""
    members = found.scenarios() if isinstance(found, ScenarioSet) else [found]
    reason = '' if isinstance(found, Scenario) else why_not(members[0], controller, SET_SECTIONS)
    if reason:
        announce(reason)
    case = None if reason or isinstance(found, Scenario) else case_of_set(found)
    guided = members[0].section(Guidance) is not None
    if case is None:
        yield from (fly(scenario, controller) for scenario in members)
    elif isinstance(controller, FuzzyController) and case.full is not None and not guided:
        yield from _fuzzy(controller, case, case.full, members)
    else:
        yield from _paired(controller, case, members)


def _fuzzy(
    controller: FuzzyController, case: Case, crossed: Crossed, members: list[Scenario]
) -> Iterator[Flight]:
    law = population_of(controller).law(0, controller.system.samples)
    norms = Scratch(case.windows.tail).norms
    states, forces = _fly(case, crossed.runs, Control(law), norms)
    for scenario, at in zip(members, crossed.lanes.tolist(), strict=True):
        yield _flight(scenario, states, forces, at)


def _paired(controller: AnyController, case: Case, members: list[Scenario]) -> Iterator[Flight]:
    if isinstance(controller, FuzzyController):
        law = population_of(controller).law(0, controller.system.samples)
        control = Control(law)
    else:
        controller.refuse_other_ticks(case.base.dt_s)
        control = Control(None, controller.law)  # type: ignore[attr-defined]
    for first, runs in enumerate(case.paired()):
        some = members[first * parts.RUNS : (first + 1) * parts.RUNS]
        guiding = guiding_of(some, [scenario.start for scenario in some])
        if guiding is not None:
            runs = runs._replace(navigation=_perfect(), guiding=guiding)
        states, forces = _fly(case, runs, control, None)
        lanes_of = parts.paired_lanes(len(some)).tolist()
        for scenario, at in zip(some, lanes_of, strict=True):
            yield _flight(scenario, states, forces, at)


def _perfect() -> Navigation:
    """Return navigation without errors."""
    return Navigation(np.zeros((parts.RUNS, 6)), np.zeros(2), np.zeros((2, parts.RUNS), np.int64))


def _fly(case: Case, runs: Runs, control: Control, norms: Floats | None) -> tuple[Floats, Floats]:
    """Return states (N+1, lanes, 2) and commands (N+1, lanes) of loops."""
    n = 2 * len(runs.planar) + len(runs.vertical)
    states, forces = make_trace(case.longer.ticks, n)
    w = lanes.make_scratch(parts.ROWS)
    tick.fly(runs, control, case.plant, case.windows, w, norms, (states, forces))
    return states, forces


def _flight(scenario: Scenario, states: Floats, forces: Floats, at: list[int]) -> Flight:
    """Return the flight of three lanes: x, y, z."""
    whole = np.hstack([states[:, at, 0], states[:, at, 1]])
    disturbances = scenario.disturbance.over(scenario.times_s)
    return Flight(scenario, whole, forces[:, at], disturbances)
