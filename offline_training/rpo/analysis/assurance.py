# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Counts over flights: commands that assurance would change, drifts that enter, clear aborts."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from rpo_core.assurance.abort import AbortMachine
from rpo_core.assurance.assurance import AssuranceStage
from rpo_core.assurance.filters import assure
from rpo_core.assurance.guard import guard_of
from rpo_core.assurance.kernels import OPEN, Guard, open_margins
from rpo_core.assurance.manoeuvre import clear_for
from rpo_core.assurance.settings import Assurance
from rpo_core.attitude.attitude_kernels import LVLH
from rpo_core.chain.flight import flights_of, fly
from rpo_core.control.controller import AnyController
from rpo_core.files.validation import InputError
from rpo_core.guidance.guidance import Guidance, nominal
from rpo_core.kernels.arithmetic import State
from rpo_core.kernels.jit import unlocked
from rpo_core.scenario.scenario import Scenario, ScenarioSet
from rpo_core.world.cw import CwStep


class Quiet(NamedTuple):
    """What assurance would do in some flights.

    flights, interventions : numbers; disturbed : flights with an intervention
    margin_m_s : the least margin to the speed limit, of any tick
    """

    flights: int
    interventions: int
    disturbed: int
    margin_m_s: float


def quiet(flown: Scenario | ScenarioSet, controller: AnyController, settings: Assurance) -> Quiet:
    """Fly without assurance, and count the commands that it would change."""
    flights = interventions = disturbed = 0
    margin = float('inf')
    for flight in flights_of(controller, flown):
        guard = guard_of(settings, flight.scenario)
        acted, min_margin_m_s = _count_changes(
            flight.states[:-1], flight.forces_n[:-1], flight.scenario.step, guard
        )
        flights += 1
        interventions += acted
        disturbed += acted > 0
        margin = min(margin, min_margin_m_s)
    return Quiet(flights, interventions, disturbed, margin)


@unlocked
def _count_changes(states: Any, forces: Any, c: CwStep, g: Guard) -> tuple[int, float]:
    """Return how many commands (n, 3) to states (n, 6) would be changed; the least margin."""
    acted, min_margin = 0, 1e30
    for i in range(len(states)):
        s, f = states[i], forces[i]
        state = (s[0], s[1], s[2], s[3], s[4], s[5])
        command = (f[0], f[1], f[2])
        answer = assure(state, command, command, OPEN, 0, LVLH, LVLH, c, g, g)
        acted += answer[4] != 0
        min_margin = answer[6] if answer[6] < min_margin else min_margin
    return acted, min_margin


class Silence(NamedTuple):
    """What a silence would do in some flights.

    flights : number; unprotected : flights with a moment whose drift enters the sphere
    share : of the seconds spent beyond the range, those with such a drift
    """

    flights: int
    unprotected: int
    share: float


def silence(
    flown: Scenario | ScenarioSet,
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
    for flight in flights_of(controller, flown):
        n, every = flight.scenario.mean_motion_rad_s, max(1, round(1.0 / flight.scenario.dt_s))
        seen, bad = _count_drifts(
            flight.states[::every], radius_m, beyond_m, orbits * 2.0 * math.pi / n, n, *drag_m_s2
        )
        flights, unprotected = flights + 1, unprotected + (bad > 0)
        looked, lost = looked + seen, lost + bad
    return Silence(flights, unprotected, lost / looked if looked else 0.0)


@unlocked
def _count_drifts(  # type: ignore[no-untyped-def]
    states: Any, radius: float, beyond: float, duration: float, n: float, low: float, high: float
):
    """Return of how many states (n, 6) the drift was checked, and of how many it enters."""
    seen = bad = 0
    for i in range(len(states)):
        s = states[i]
        if s[0] * s[0] + s[1] * s[1] + s[2] * s[2] <= beyond * beyond:
            continue
        seen += 1
        state = (s[0], s[1], s[2], s[3], s[4], s[5])
        bad += clear_for(state, radius, duration, n, low, high) < duration
    return seen, bad


STEPS_M = (1.0, 2.0, 5.0, 10.0, 30.0)
"""Widths of the bands of range outside the keep-out sphere; the last one has no end."""

MISSES = 10_000
"""After so many draws in a row outside the open set, a band gets no more random states."""


class Band(NamedTuple):
    """States of a band of range [m], and of how many an abort is clear; the least margin [m]."""

    least_m: float
    most_m: float
    states: int
    clear: int
    margin_m: float


def machine_of(scenario: Scenario) -> AbortMachine:
    """Return the abort table of a scenario; raises InputError if there is none, or no zone."""
    settings = scenario.section(Assurance)
    machine = AssuranceStage(settings, scenario).abort if settings is not None else None
    if machine is None or settings is None or settings.keep_out_m <= 0.0:
        raise InputError(
            f'scenario {scenario.name} must have `assurance.abort` and `assurance.keep_out_m`; '
            'it has not'
        )
    return machine


def of_flight(scenario: Scenario, controller: AnyController) -> list[State]:
    """Return the states of a flight, one a second; of a plan, each hold ended when it may be."""
    each, plan = max(1, round(1.0 / scenario.dt_s)), scenario.section(Guidance)
    if plan is not None:
        return nominal(plan, scenario).references[::each]
    states: list[Any] = fly(scenario, controller).states[::each].tolist()
    return states


def at_random(machine: AbortMachine, count: int, seed: int) -> list[State]:
    """Return states of the open set, moving in any direction, as many in each band.

    A band that the open set leaves out, or nearly, gets fewer: see `MISSES`.
    """
    random, guard = np.random.default_rng(seed), machine.guard
    states: list[State] = []
    edges = _edges(machine.keep_out_m)
    for low_m, high_m in zip(edges, [*edges[1:-1], edges[-2] + 160.0], strict=False):
        wanted, missed = len(states) + count // len(edges[1:]), 0
        while len(states) < wanted and missed < MISSES:
            e, u = (v / np.linalg.norm(v) for v in random.normal(size=(2, 3)))
            position = (random.uniform(low_m, high_m) * e).tolist()
            state: Any = (*position, *(random.uniform(0.0, 1.0) * u).tolist())
            missed += 1
            if min(open_margins(state, guard.here_m, guard.here_m_s, guard)) >= 0.0:
                states.append(state)
                missed = 0
    return states


def bands(machine: AbortMachine, states: Iterable[State]) -> list[Band]:
    """Choose an abort from each state outside the sphere, and count those that are clear."""
    edges = _edges(machine.keep_out_m)
    margins: list[list[float]] = [[] for _ in edges[1:]]
    for state in states:
        rho = float(np.linalg.norm(state[:3]))
        if rho > machine.keep_out_m:
            band = int(np.searchsorted(edges, rho)) - 1
            margins[band].append(machine.way_out(state, machine.guard, None).margin_m)
    return [
        Band(low_m, high_m, len(m), sum(x >= 0.0 for x in m), min(m, default=float('nan')))
        for low_m, high_m, m in zip(edges, edges[1:], margins, strict=False)
    ]


def _edges(keep_out_m: float) -> list[float]:
    return [keep_out_m, *(keep_out_m + step for step in STEPS_M), float('inf')]
