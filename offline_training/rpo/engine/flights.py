# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Whole flights of a set from the engine: the bits of `rpo_core.chain.flight.fly`, many at once."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rpo.engine import lanes
from rpo.engine.cases import case_of_set
from rpo.engine.counters import Trace
from rpo.engine.parts.approach import guiding_of
from rpo.engine.parts.control import control_of
from rpo.engine.parts.estimation import errors_part
from rpo.engine.support import announce, why_not
from rpo.engine.tick import Batch
from rpo.engine.tick import fly as fly_lanes
from rpo_core.chain.flight import Flight, fly
from rpo_core.control.controller import AnyController
from rpo_core.control.controller_file import ControllerFile
from rpo_core.scenario.scenario import SET_SECTIONS, Scenario, ScenarioSet


def flights_of(controller: AnyController, found: Scenario | ScenarioSet) -> Iterator[Flight]:
    """Yield the flight of each member; raises InputError if a controller does not fit."""
    if isinstance(found, Scenario):
        yield fly(found, controller)
        return
    members, case = found.scenarios(), case_of_set(found)
    if reason := why_not(members[0], controller, SET_SECTIONS):
        announce(reason)
        yield from (fly(scenario, controller) for scenario in members)
        return
    control, ticks = control_of(controller), case.longer.ticks
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
        trace = Trace(ticks, runs.lanes)
        fly_lanes(runs, [control.part(runs), trace.part], ticks, lanes.make_scratch())
        for scenario, at in zip(some, lanes.paired_lanes(len(some)).tolist(), strict=True):
            states = np.hstack([trace.states[:, at, 0], trace.states[:, at, 1]])
            yield Flight(scenario, states, trace.forces[:, at], case.base.disturbances_n)
