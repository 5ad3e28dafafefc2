# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""From drawn runs to outcomes; a unit of 200 runs is what a thread or worker flies at a time."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.baselines import Baseline
from rpo_core.controller import AnyController, only_fuzzy
from rpo_core.metrics import ARRIVAL_WINDOW_S, CLAIM_WINDOW_S, window_ticks
from rpo_training.campaign import baselines, loops
from rpo_training.campaign.config import FIGURES, Campaign
from rpo_training.campaign.faults import Faults
from rpo_training.campaign.sampling import PARAMETERS, STRATA, Runs, draw
from rpo_training.engine import lanes
from rpo_training.search.genes import population_of

Floats = NDArray[np.float64]

UNIT = 200
"""Runs of a unit; a whole number of them is one Latin hypercube."""

assert STRATA % UNIT == 0 and UNIT % loops.RUNS == 0

FINAL = tuple(f'final_{name}' for name in ('x_m', 'y_m', 'z_m', 'vx_m_s', 'vy_m_s', 'vz_m_s'))
COLUMNS = (*PARAMETERS, *FIGURES, *FINAL)
"""Columns of results: what was drawn, figures, final state."""

_local = threading.local()


def units(runs: int) -> int:
    """Return the number of units of a campaign."""
    return -(-runs // UNIT)


def fly_unit(campaign: Campaign, unit: int) -> Floats:
    """Return the results (len(COLUMNS), n) of the runs of a unit."""
    first = unit * UNIT
    return _fly(campaign, draw(campaign, first, min(UNIT, campaign.config.runs - first)))


def fly_runs(campaign: Campaign, first: int, count: int) -> dict[str, Floats]:
    """Return the results of some runs, column by column (count,)."""
    return dict(zip(COLUMNS, _fly(campaign, draw(campaign, first, count)), strict=True))


def _fly(campaign: Campaign, runs: Runs) -> Floats:
    figures = np.empty((len(runs.numbers), loops.OUTCOMES))
    loop = make_loop(campaign)
    w, line = _scratch(), loops.make_line(loop)
    fly, law = _flown_by(campaign.controller)
    for start in range(0, len(figures), loops.RUNS):
        fleet = make_fleet(campaign, runs, start)
        fly(fleet, law, loop, w, line)
        loops.outcomes(w, fleet.masses, loop, figures[start : start + loops.RUNS])
    return np.ascontiguousarray(np.hstack([runs.parameters, figures]).T)


def _scratch() -> Floats:
    """Return this thread's scratch."""
    if not hasattr(_local, 'rows'):
        _local.rows = lanes.make_scratch(loops.ROWS)
    return _local.rows


def _flown_by(controller: AnyController) -> tuple[Callable[..., None], Any]:
    """Return the loop that flies a controller, and its law."""
    if isinstance(controller, Baseline):
        return baselines.fly, controller.law
    controller = only_fuzzy(controller)
    law, members = lanes.make_law(controller.system.samples), population_of(controller)
    lanes.set_law(law, members.scales[0], members.functions[0], members.rules[0])
    return loops.fly, law


def make_loop(campaign: Campaign) -> loops.Loop:
    """Return what all runs of a campaign share."""
    config, scenario = campaign.config, campaign.scenario
    harmonics = scenario.disturbance.harmonics
    return loops.Loop(
        times=scenario.times_s[:-1],
        dt=scenario.dt_s,
        limit=scenario.max_force_n,
        noise=np.array(
            [
                config.spread('navigation_position_noise_m')[0],
                config.spread('navigation_velocity_noise_m_s')[0],
            ]
        ),
        slots=config.most_delay + 1,
        axes=np.array(['xyz'.index(h.axis) for h in harmonics], np.int64),
        sines=np.array([h.function == 'sin' for h in harmonics], np.bool_),
        tail=window_ticks(scenario, ARRIVAL_WINDOW_S),
        late=window_ticks(scenario, CLAIM_WINDOW_S),
        faulty=config.faults is not None,
        faults=(config.faults or Faults()).fates,
    )


def make_fleet(campaign: Campaign, runs: Runs, start: int) -> loops.Fleet:
    """Return up to 40 runs from index `start`; lanes without a run rest."""
    nominal = campaign.scenario.disturbance
    n = min(loops.RUNS, len(runs.numbers) - start)
    chosen = slice(start, start + n)

    def padded(*shape: int) -> Floats:
        return np.zeros((loops.RUNS, *shape))

    fleet = loops.Fleet(
        starts=padded(6),
        biases=padded(6),
        keys=np.zeros((2, loops.RUNS), np.int64),
        delays=np.zeros(loops.RUNS, np.int64),
        masses=padded() + 1.0,
        thrust=padded(9),
        steps=padded(26),
        constant=np.zeros((3, loops.RUNS)),
        waves=np.zeros((len(nominal.harmonics), 3, loops.RUNS)),
    )
    fleet.starts[:n], fleet.biases[:n] = runs.starts[chosen], runs.biases[chosen]
    fleet.keys[:, :n], fleet.delays[:n] = runs.keys[chosen].T, runs.delays[chosen]
    fleet.masses[:n] = runs.masses_kg[chosen]
    share, phase, frequency = runs.parameters[chosen, 19:22].T
    for axis, constant in enumerate(nominal.constant_n):
        fleet.constant[axis, :n] = constant * (1.0 + share)
    for wave, h in zip(fleet.waves, nominal.harmonics, strict=True):
        wave[0, :n] = h.amplitude_n * (1.0 + share)
        wave[1, :n] = h.angular_rate_rad_s * (1.0 + frequency)
        wave[2, :n] = h.phase_rad + phase
    for s in range(n):
        fleet.thrust[s] = runs.thrust(start + s).ravel()
        fleet.steps[s] = runs.step(start + s, campaign.scenario.dt_s)
    return fleet
