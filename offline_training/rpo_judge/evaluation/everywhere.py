# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How good a controller is in flights that no training drew: dispersed, and from random starts.

The draws have a seed of their own; `rpo campaign FILE --controller NAME --seed SEED` repeats each.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from os import sched_getaffinity
from typing import NamedTuple

import numpy as np

from rpo_core.control.controller import AnyController
from rpo_montecarlo.campaign.config import Campaign, find, load
from rpo_montecarlo.campaign.execution import on_threads
from rpo_montecarlo.campaign.judging import MOTION, motion, sentence
from rpo_montecarlo.campaign.run_batch import columns_of, units
from rpo_montecarlo.campaign.statistics import Rate, rate, successes

SEED = 2026
"""Beyond the seeds of the shipped campaigns and of trainings."""


ALL = 'all limits'


class Demand(NamedTuple):
    """What is asked of the default controller in a campaign.

    runs : flown; share : of them, at least, that shall keep the limits
    motion : ask only for the limits on position and speed
    """

    runs: int
    share: float
    motion: bool = False


DEMANDS = {
    'paper_test': Demand(10_000, 0.999, motion=True),
    'random_starts': Demand(20_000, 1.0),
    'random_moving_starts': Demand(20_000, 0.9995),
}
"""Campaign -> what is asked. Of the dispersed test, nothing is asked of force and slew."""


class Outcome(NamedTuple):
    """What came of a campaign.

    campaign : its name
    success : named by what is judged; judged : the same in full
    least : share that shall succeed, None: nothing is asked
    """

    campaign: str
    success: Rate
    judged: str
    least: float | None

    @property
    def missed(self) -> int:
        """Runs that miss a limit."""
        return self.success.runs - self.success.kept

    @property
    def holds(self) -> bool:
        """Whether enough runs succeed."""
        return self.least is None or self.success.kept >= self.least * self.success.runs


def everywhere(
    controller: AnyController,
    seed: int = SEED,
    workers: int = 0,
    report: Callable[[str, float, float], None] = lambda *_: None,
) -> list[Outcome]:
    """Return what comes of the campaigns of `DEMANDS`; `report` is told what is flown.

    Where less is asked than the campaign judges, a second outcome is that of all its limits.
    """
    found, threads = [], workers or len(sched_getaffinity(0))
    for name, (runs, share, only) in DEMANDS.items():
        loaded = load(find(name), runs=runs, seed=seed, controller='handmade')
        campaign = replace(loaded, controller=controller)
        judgements: list[tuple[str, Campaign, float | None]] = [(ALL, campaign, share)]
        if only:
            moving = campaign.judging(motion(campaign.config.success))
            judgements = [(MOTION, moving, share), (ALL, campaign, None)]
        kept, done = [0] * len(judgements), 0
        with closing(on_threads(campaign, list(range(units(runs))), threads)) as source:
            for _, results in source:
                report(f'{controller.name}: {name}', done, runs)
                columns = dict(zip(columns_of(campaign), results, strict=True))
                for place, (_, judged, _) in enumerate(judgements):
                    kept[place] += int(np.count_nonzero(successes(judged.config, columns)))
                done += results.shape[1]
        for count, (what, judged, least) in zip(kept, judgements, strict=True):
            found.append(Outcome(name, rate(what, count, runs), sentence(judged), least))
    return found
