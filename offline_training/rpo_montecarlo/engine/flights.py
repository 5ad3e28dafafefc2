# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Whole flights of a set from the engine: the bits of `rpo_core.chain.flight.fly`, many at once."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rpo_core.chain.flight import Flight, fly
from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.control.controller_file import ControllerFile
from rpo_core.files.scenario import SET_SECTIONS, Scenario, ScenarioSet
from rpo_guidance.plan import Guidance
from rpo_kernels.arrays import Floats
from rpo_montecarlo.engine import lanes
from rpo_montecarlo.engine.cases import Case, Crossed, case_of_set
from rpo_montecarlo.engine.counters import Trace
from rpo_montecarlo.engine.parts.approach import guiding_of
from rpo_montecarlo.engine.parts.control import Control, control_of
from rpo_montecarlo.engine.parts.estimation import errors_part
from rpo_montecarlo.engine.support import announce, why_not
from rpo_montecarlo.engine.tick import Batch, Runs
from rpo_montecarlo.engine.tick import fly as fly_lanes


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
    trace = _fly(case, crossed.runs, control_of(controller))
    for scenario, at in zip(members, crossed.lanes.tolist(), strict=True):
        yield _flight(scenario, trace, at, case.base.disturbances_n)


def _paired(controller: AnyController, case: Case, members: list[Scenario]) -> Iterator[Flight]:
    control = control_of(controller)
    if isinstance(controller, ControllerFile):
        controller.refuse_other_ticks(case.base.dt_s)
    for first, runs in enumerate(case.paired()):
        some = members[first * lanes.RUNS : (first + 1) * lanes.RUNS]
        starts = np.array([scenario.start for scenario in some])
        nothing = np.zeros((len(some), 2), np.int64)
        guiding = guiding_of(Batch(case.base, starts, some.copy, {}, nothing, {}))
        if guiding is not None:
            parts = [part for part in runs.parts if part.name != 'goal']
            perfect = errors_part(np.zeros((6, lanes.RUNS)))
            runs = runs._replace(parts=(*parts, perfect, guiding))
        trace = _fly(case, runs, control)
        lanes_of = lanes.paired_lanes(len(some)).tolist()
        for scenario, at in zip(some, lanes_of, strict=True):
            yield _flight(scenario, trace, at, case.base.disturbances_n)


def _fly(case: Case, runs: Runs, control: Control) -> Trace:
    ticks = case.longer.ticks
    trace = Trace(ticks, runs.lanes)
    fly_lanes(runs, [control.part(runs), trace.part], ticks, lanes.make_scratch())
    return trace


def _flight(scenario: Scenario, trace: Trace, at: list[int], disturbances_n: Floats) -> Flight:
    """Return the flight of three lanes: x, y, z; the disturbance is that of all members."""
    whole = np.hstack([trace.states[:, at, 0], trace.states[:, at, 1]])
    return Flight(scenario, whole, trace.forces[:, at], disturbances_n)
