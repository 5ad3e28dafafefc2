# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""From where an abort would be clear: states of a flight, and random ones, by their range."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from rpo_core.chain.flight import fly
from rpo_core.control.controller import AnyController
from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import InputError
from rpo_core.kernels import State
from rpo_guidance.plan import Guidance
from rpo_guidance.rehearsal import nominal
from rpo_safety.abort import AbortMachine
from rpo_safety.assurance import AssuranceStage
from rpo_safety.kernels import open_margins
from rpo_safety.settings import Assurance

STEPS_M = (1.0, 2.0, 5.0, 10.0, 30.0)
"""Widths of the bands of range outside the keep-out sphere; the last one has no end."""


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
    """Return states of the open set, as many in each band, moving in any direction."""
    random, guard = np.random.default_rng(seed), machine.guard
    found: list[State] = []
    edges = _edges(machine.keep_out_m)
    for least, most in zip(edges, [*edges[1:-1], 200.0], strict=False):
        wanted = len(found) + count // (len(edges) - 1)
        while len(found) < wanted:
            e, u = (v / np.linalg.norm(v) for v in random.normal(size=(2, 3)))
            position = (random.uniform(least, most) * e).tolist()
            state: Any = (*position, *(random.uniform(0.0, 1.0) * u).tolist())
            if min(open_margins(state, guard.here_m, guard.here_m_s, guard)) >= 0.0:
                found.append(state)
    return found


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
        Band(least, most, len(m), sum(x >= 0.0 for x in m), min(m, default=float('nan')))
        for least, most, m in zip(edges, edges[1:], margins, strict=False)
    ]


def _edges(keep_out_m: float) -> list[float]:
    return [keep_out_m, *(keep_out_m + step for step in STEPS_M), float('inf')]
