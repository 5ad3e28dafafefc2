# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The energy of a plan beside other paths of the same begin, end and time out of the same zones.

Others are all paths of Clohessy and Wiltshire with a force that is held for each tick, that at each
tick keep out of the sphere or are in the cone of the corridor. Two numbers frame the least energy
of these: a lower bound, below all of them (`branching`), and the best that a search found
(`best_path`), which is one of them, and keeps to the force of the thrusters too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import inf
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.files.scenario import Scenario
from rpo_core.files.validation import InputError
from rpo_core.kernels import cw_step
from rpo_guidance.plan import Guidance
from rpo_guidance.rehearsal import Checked, nominal
from rpo_judge.evaluation.best_path import Found, best_path
from rpo_judge.evaluation.branching import lower_bound
from rpo_judge.evaluation.bridge import Bridge
from rpo_judge.evaluation.keep_out import KeepOut
from rpo_montecarlo.campaign.single import scenario_of
from rpo_montecarlo.campaign.store import Store

Floats = NDArray[np.float64]

BOUND_TICKS, PATH_TICKS = 60, 150
"""At about so many ticks the bound, and the programs of the best path, look at the zones."""


class Bound(NamedTuple):
    """Energies [N^2 s] from the start to the end of the last leg.

    plan : of the reference; best : of the best path found; lower : no path needs less
    positions_m : (n, 3) of the best path found, each tick
    duration_s : of all
    closed : whether the search for the bound came to its end
    """

    plan: float
    best: float
    lower: float
    positions_m: Floats
    duration_s: float
    closed: bool


def bound(settings: Guidance, scenario: Scenario, margins: bool = False) -> tuple[Checked, Bound]:
    """Return the plan, flown without errors, and its bounds.

    margins : whether the zones of others are those that transfers plan with

    The best path has energy inf and no positions if none is found.
    """
    told = scenario if settings.mass_kg is None else replace(scenario, mass_kg=settings.mass_kg)
    found = nominal(settings, scenario)
    over = len(found.changes) > len(settings.legs)
    last = found.changes[len(settings.legs)].tick if over else scenario.ticks
    end = cw_step(found.references[last - 1], found.forces[last - 1], told.step)
    # who was told another mass commands another force; the flight needs that of its own
    forces = np.array(found.forces[:last]) * (scenario.mass_kg / told.mass_kg)
    states = np.array([*found.references[:last], end])
    zone = KeepOut.of(settings, margins)
    coarse, fine = (
        Bridge(states[0], states[-1], scenario.step, scenario.dt_s, last, -(-last // ticks))
        for ticks in (BOUND_TICKS, PATH_TICKS)
    )
    lower = lower_bound(coarse, zone)
    seen = np.vstack([states[0, :3], lower.path, states[-1, :3]])
    ticks = [0, *coarse.ticks.tolist(), last]
    guess = np.column_stack([np.interp(fine.ticks, ticks, axis) for axis in seen.T])
    plan = Found(fine.energy(forces), states, forces)
    others = [best_path(fine, zone, guess, scenario.max_force_n), plan]
    known = [path for path in others if path and path.keeps(zone, scenario.max_force_n)]
    best = min(known, key=lambda path: path.energy, default=Found(inf, np.empty((0, 6)), forces))
    energies = (plan.energy, best.energy, lower.energy, best.states[:, :3])
    return found, Bound(*energies, last * scenario.dt_s, lower.closed)


def rows(found: Checked, scenario: Scenario) -> list[tuple[str, ...]]:
    """Return a row of text for each phase: name, times, energy, least range, largest force, why."""
    ends = [*(change.tick for change in found.changes[1:]), scenario.ticks + 1]
    table: list[tuple[str, ...]] = []
    for change, end in zip(found.changes, ends, strict=True):
        states = np.array(found.references[change.tick : end])
        forces = np.array(found.forces[change.tick : end])
        numbers = (
            f'{change.tick * scenario.dt_s:.1f}',
            f'{(end - 1) * scenario.dt_s:.1f}',
            f'{float((forces * forces).sum()) * scenario.dt_s:.4f}',
            f'{float(np.linalg.norm(states[:, :3], axis=1).min()):.2f}',
            f'{float(np.abs(forces).max()):.3f}',
        )
        table.append((change.phase, *numbers, change.reason))
    return table


class Ratio(NamedTuple):
    """Energies of one run [N^2 s]: flown, of its plan, of the best path found, lower bound."""

    run: int
    flown: float
    plan: float
    best: float
    lower: float


def ratios(store: Store, sample: int, advance: Callable[[int], None]) -> list[Ratio]:
    """Return the energies of some runs, evenly spaced; raises InputError without a plan.

    advance : gets how many are done
    """
    campaign, runs = store.campaign, store.campaign.config.runs
    settings = campaign.scenario.section(Guidance)
    if settings is None:
        raise InputError(f'scenario {campaign.scenario.name} has no section `guidance`')
    flown = store.column('energy_n2s')
    found = []
    for done, run in enumerate(np.linspace(0, runs - 1, min(sample, runs)).round().astype(int)):
        scenario = scenario_of(campaign, int(run))
        own = scenario.section(Guidance) or settings
        _, energies = bound(own, scenario)
        found.append(Ratio(int(run), float(flown[run]), *energies[:3]))
        advance(done + 1)
    return found
