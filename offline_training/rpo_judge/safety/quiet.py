# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How often runtime assurance would act in flights that need no help."""

from __future__ import annotations

import time
from typing import Any, NamedTuple

import numpy as np

from rpo_core.control.controller import AnyController
from rpo_core.files.scenario import Scenario, ScenarioSet
from rpo_core.kernels import CwStep
from rpo_core.kernels.jit import as_table
from rpo_montecarlo.engine.flights import flights_of
from rpo_montecarlo.engine.lanes import compiled
from rpo_safety.filters import assure
from rpo_safety.guard import guard_of
from rpo_safety.kernels import OPEN, Guard
from rpo_safety.settings import Assurance


class Quiet(NamedTuple):
    """What assurance would do in some flights.

    flights, interventions : numbers; disturbed : flights with an intervention
    margin_m_s : the least margin to the speed limit, of any tick
    """

    flights: int
    interventions: int
    disturbed: int
    margin_m_s: float


def quiet(found: Scenario | ScenarioSet, controller: AnyController, settings: Assurance) -> Quiet:
    """Fly without assurance, and count the commands that it would change."""
    flights = interventions = disturbed = 0
    margin = float('inf')
    for flight in flights_of(controller, found):
        guard = guard_of(settings, flight.scenario)
        acted, least = _count(flight.states[:-1], flight.forces_n[:-1], flight.scenario.step, guard)
        flights += 1
        interventions += acted
        disturbed += acted > 0
        margin = min(margin, least)
    return Quiet(flights, interventions, disturbed, margin)


@compiled
def _count(states: Any, forces: Any, c: CwStep, g: Guard) -> tuple[int, float]:
    """Return how many commands (n, 3) to states (n, 6) would be changed; the least margin."""
    acted, least = 0, 1e30
    for i in range(len(states)):
        s, f = states[i], forces[i]
        state = (s[0], s[1], s[2], s[3], s[4], s[5])
        command = (f[0], f[1], f[2])
        found = assure(state, command, command, OPEN, c, g)
        acted += found[4] != 0
        least = found[6] if found[6] < least else least
    return acted, least


def speeds(guard: Guard, scenario: Scenario) -> tuple[float, float]:
    """Return the time [us] of a step of the filter where a command passes, and where it acts.

    Of a loop over 2000 states, the best of five.
    """
    random = np.random.default_rng(1)
    directions = random.normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    found = []
    for rho, speed in ((200.0, 0.0), (guard.keep_out_m + 1.0, 0.28)):
        states = as_table(np.hstack([rho * directions, -speed * directions]))
        forces = as_table(-guard.limit_n * directions)
        _count(states, forces, scenario.step, guard)
        begun = []
        for _ in range(5):
            start = time.perf_counter()
            _count(states, forces, scenario.step, guard)
            begun.append(time.perf_counter() - start)
        found.append(1e6 * min(begun) / len(states))
    return found[0], found[1]
