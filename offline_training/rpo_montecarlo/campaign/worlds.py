# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Drawn runs in true worlds, as the engine flies them side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.files.scenario import Scenario
from rpo_core.judge import requirements
from rpo_core.kernels.pulse_kernels import MEMORY
from rpo_core.world.dynamics import CLOHESSY_WILTSHIRE, steps_per_tick, target_start, world_of
from rpo_core.world.thrusters import tank_of, valves_of
from rpo_montecarlo.campaign.sampling import DrawnRuns
from rpo_montecarlo.engine import worlds as worlds_in_lanes
from rpo_montecarlo.engine.parts import RUNS, Firing, Orbits
from rpo_montecarlo.engine.worlds import THRUST

Floats = NDArray[np.float64]


def firing_of(scenarios: Sequence[Scenario]) -> Firing | None:
    """Return the thrusters of up to 40 runs; None without pulses and propellant."""
    first = scenarios[0].thrusters
    if first is None or not (first.pulses or first.propellant):
        return None
    tanks = _padded([tuple(tank_of(s.thrusters, s)) for s in scenarios], 1.0)
    memory = np.zeros((RUNS, MEMORY))
    if first.pulses is None:
        return Firing(None, None, None, tanks, memory, np.zeros(0))
    made = []
    for s in scenarios:
        assert s.thrusters is not None and s.thrusters.pulses is not None
        made.append(valves_of(s.thrusters, s.thrusters.pulses, s))
    return Firing(
        made[0]._replace(directions=None, failures=None),
        _padded([v.directions for v in made]),
        _padded([np.array(v.failures, np.int64).reshape(-1, 5) for v in made]),
        tanks,
        memory,
        np.zeros(made[0].number),
    )


def spent_of(firing: Firing | None) -> dict[str, Floats]:
    """Return what runs that have flown have spent: a requirement of `THRUST` -> (40,)."""
    places = {} if firing is None else dict(zip(requirements.THRUST, THRUST, strict=True))
    return {name: firing.memory[:, place] for name, place in places.items()} if firing else {}


def uneven_steps(scenario: Scenario, drawn: DrawnRuns) -> str:
    """Return why runs cannot fly side by side: their ticks have different numbers of steps."""
    settings = scenario.dynamics
    if settings is None:
        return ''
    radii = {float(f(drawn.parameters[:, 22])) for f in (np.min, np.max)}
    steps = {steps_per_tick(settings, replace(scenario, orbit_radius_m=r)) for r in radii}
    few = len(steps) == 1
    return '' if few else f'campaign of {scenario.name} has orbits that need other steps in a tick'


def orbits_of(scenarios: Sequence[Scenario]) -> Orbits | None:
    """Return the dynamics of up to 40 runs; None where they are those of Clohessy and Wiltshire."""
    first = scenarios[0].dynamics
    if first is None or first.kind == CLOHESSY_WILTSHIRE:
        return None
    worlds, starts = [], []
    for s in scenarios:
        assert s.dynamics is not None
        worlds.append(world_of(s.dynamics, s))
        starts.append(target_start(s.dynamics, s))
    steps = steps_per_tick(first, scenarios[0])

    def lanes(values: Sequence[Any]) -> Floats:
        """Return tables with 40 lanes as their last axis; lanes without a run are the first's."""
        given = [np.array(value, np.float64) for value in values]
        return np.stack([*given, *([given[0]] * (RUNS - len(given)))], axis=-1)

    table = np.zeros((worlds_in_lanes.ROWS, RUNS))
    for at, values in (
        (worlds_in_lanes.DENSITY, [w.density for w in worlds]),
        (worlds_in_lanes.CHASER, [w.chaser for w in worlds]),
        (worlds_in_lanes.FIRST_MASS, [s.mass_kg for s in scenarios]),
    ):
        table.ravel()[at : at + RUNS] = lanes(values)
    return Orbits(worlds[0], table.ravel(), lanes(starts), steps, scenarios[0].dt_s / steps)


def _padded(values: Any, rest: float = 0.0) -> NDArray[Any]:
    """Return an array with a row for each of 40 lanes; lanes without a run get `rest`."""
    given = np.array(values)
    full = np.full((RUNS, *given.shape[1:]), rest, given.dtype)
    full[: len(given)] = given
    return full
