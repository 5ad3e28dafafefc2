# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The energy that the runs of a campaign flew, beside other paths out of their zones."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from rpo_core.validation import InputError
from rpo_guidance.plan import Guidance
from rpo_judge.evaluation import plan_bound
from rpo_montecarlo.campaign.single import scenario_of
from rpo_montecarlo.campaign.store import Store


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
        _, energies = plan_bound.bound(own, scenario)
        found.append(Ratio(int(run), float(flown[run]), *energies[:3]))
        advance(done + 1)
    return found
