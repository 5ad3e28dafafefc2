# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What else decides between controllers: random starts, margins, thrusters, contact, proof."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.flight import Flight, fly
from rpo_core.control.controller import AnyController, FuzzyController
from rpo_core.files.scenario import load_scenario, load_set
from rpo_core.judge.metrics import ARRIVAL_DISTANCE, ARRIVAL_SPEED, SLEW
from rpo_core.judge.verdicts import verdicts
from rpo_ctrl.family import Family
from rpo_judge.analysis.certificate import PROVEN
from rpo_judge.evaluation import proven
from rpo_judge.scoring import fitness
from rpo_judge.scoring.conditions import LABELS
from rpo_montecarlo.campaign import config, run_batch, statistics
from rpo_montecarlo.campaign.config import Campaign
from rpo_montecarlo.campaign.single import fly_run
from rpo_montecarlo.engine.flights import flights_of

Floats = NDArray[np.float64]
Report = Callable[[str, int, int], None]

RANDOM = ('random_starts', 'random_moving_starts')
"""Campaigns of random starts in the box of the training: at rest, and moving."""

OPEN_N = 0.005
"""A thruster counts as open at more than this force, 1 % of the largest."""

OPENED_RUNS = 10
"""Dispersed runs in which openings are counted."""

CONTACT_M = 1.0


@dataclass(frozen=True)
class Robustness:
    """What else is known of a controller.

    random_runs : of each of `RANDOM`; random_missed : that miss a condition, by campaign
    margin : smallest distance to a limit as a share of it, over all starts and the paper's tests;
        margin_of : the condition
    openings : starts of thrust of an axis in a dispersed run, the mean
    contact_m_s : speed at the first state within 1 m, the largest over the starts that come there;
        contact_median_m_s : the median
    proof : what is shown of the conditions from every start of the box
    """

    random_runs: int
    random_missed: dict[str, int]
    margin: float
    margin_of: str
    openings: float
    contact_m_s: float | None
    contact_median_m_s: float | None
    proof: str


def examine(
    controller: AnyController,
    name: str,
    rows: Floats,
    campaign: Campaign,
    random_runs: int,
    report: Report,
) -> Robustness:
    """Return what else is known of a controller.

    name : shipped name or file; rows : (starts, columns) metrics of the training starts
    campaign : whose first runs count the openings
    """
    missed = {}
    for drawn in RANDOM if random_runs else ():
        missed[drawn] = _missed(config.find(drawn), name, random_runs, report)
    report(f'{controller.name}: contact and thrusters', 0, 1)
    contacts = _contacts(controller)
    margin, condition = _margin(controller, rows)
    runs = [fly_run(campaign, i) for i in range(min(OPENED_RUNS, campaign.config.runs))]
    return Robustness(
        random_runs=random_runs,
        random_missed=missed,
        margin=margin,
        margin_of=condition,
        openings=float(np.mean([openings(flight.forces_n) for flight in runs])),
        contact_m_s=max(contacts) if contacts else None,
        contact_median_m_s=float(np.median(contacts)) if contacts else None,
        proof=proof_of(controller),
    )


def _missed(path: Path, name: str, runs: int, report: Report) -> int:
    """Return how many runs of a campaign miss a condition."""
    campaign, missed = config.load(path, controller=name, runs=runs), 0
    names = run_batch.columns_of(campaign)
    for unit in range(run_batch.units(runs)):
        report(f'{name}: {campaign.config.name}', unit * run_batch.UNIT, runs)
        columns = dict(zip(names, run_batch.fly_unit(campaign, unit), strict=True))
        missed += int((~statistics.successes(campaign.config, columns)).sum())
    return missed


def _margin(controller: AnyController, rows: Floats) -> tuple[float, str]:
    """Return the smallest margin, and its condition."""
    values = rows[:, [ARRIVAL_SPEED, SLEW, ARRIVAL_DISTANCE]].max(axis=0)
    shares = list(zip((values / fitness.LIMITS).tolist(), fitness.CONDITIONS, strict=True))
    for test in fitness.TESTS:
        judged = verdicts(fly(load_scenario(test), controller))
        shares += [(v.value / v.limit, v.key) for v in judged if v.holds is not None]
    share, condition = max(shares)
    return 1.0 - share, condition


def _contacts(controller: AnyController) -> list[float]:
    """Return the speeds [m/s] at the first state within `CONTACT_M`, of the starts that arrive."""
    found = (contact_speed(flight) for flight in flights_of(controller, load_set('paper_training')))
    return [speed for speed in found if speed is not None]


def contact_speed(flight: Flight) -> float | None:
    """Return the speed [m/s] at the first state within `CONTACT_M` of the target, if any."""
    inside = np.flatnonzero(np.linalg.norm(flight.states[:, :3], axis=1) < CONTACT_M)
    return float(np.linalg.norm(flight.states[inside[0], 3:])) if len(inside) else None


def openings(forces_n: Floats | Sequence[Sequence[float]]) -> float:
    """Return how often thrust begins on an axis, the mean of the axes; a new side is a new start.

    forces_n : (n, 3) [N]
    """
    side = np.sign(forces_n) * (np.abs(forces_n) > OPEN_N)
    begins = (side[1:] != side[:-1]) & (side[1:] != 0.0)
    return float((begins.sum(axis=0) + (side[0] != 0.0)).mean())


def proof_of(controller: AnyController) -> str:
    """Return what is shown of the conditions of the training from every start of its box."""
    if isinstance(controller, FuzzyController):
        return proven.proof_of(controller)
    if not isinstance(controller, Family):
        return proven.NO_PROOF
    claims = {claim.name: claim.holds for claim in controller.claims()}
    proof = all(claims.get(name, False) for name in LABELS.values())
    return PROVEN if proof else 'not proven'
