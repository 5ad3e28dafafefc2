# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""When a thruster silence would lead to the target: the unprotected time of flights."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from rpo_core.control.controller import AnyController
from rpo_core.files.scenario import Scenario, ScenarioSet
from rpo_montecarlo.engine.flights import flights_of
from rpo_montecarlo.engine.lanes import compiled
from rpo_safety.passive import clear_for


class Silence(NamedTuple):
    """What a silence would do in some flights.

    flights : number; unprotected : flights with a moment whose drift enters the sphere
    share : of the seconds spent beyond the range, those with such a drift
    """

    flights: int
    unprotected: int
    share: float


def silence(
    found: Scenario | ScenarioSet,
    controller: AnyController,
    radius_m: float,
    beyond_m: float,
    orbits: float,
    drag_m_s2: tuple[float, float],
) -> Silence:
    """Check the drift from each second that flights spend beyond a range.

    drag_m_s2 : bounds of the differential acceleration along the orbit; < 0: the chaser has more
    """
    flights = unprotected = looked = lost = 0
    for flight in flights_of(controller, found):
        n, every = flight.scenario.mean_motion_rad_s, max(1, round(1.0 / flight.scenario.dt_s))
        seen, bad = _count(
            flight.states[::every], radius_m, beyond_m, orbits * 2.0 * math.pi / n, n, *drag_m_s2
        )
        flights, unprotected = flights + 1, unprotected + (bad > 0)
        looked, lost = looked + seen, lost + bad
    return Silence(flights, unprotected, lost / looked if looked else 0.0)


@compiled
def _count(  # type: ignore[no-untyped-def]
    states: Any, radius: float, beyond: float, duration: float, n: float, least: float, most: float
):
    """Return of how many states (n, 6) the drift was checked, and of how many it enters."""
    seen = bad = 0
    for i in range(len(states)):
        s = states[i]
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] <= beyond * beyond:
            continue
        seen += 1
        state = (s[0], s[1], s[2], s[3], s[4], s[5])
        bad += clear_for(state, radius, duration, n, least, most) < duration
    return seen, bad
