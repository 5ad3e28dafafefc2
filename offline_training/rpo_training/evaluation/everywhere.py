# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How good a controller is where it was not trained: drawn runs, and random starts.

The draws have a seed of their own; `rpo campaign FILE --controller NAME --seed SEED` repeats each.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from os import sched_getaffinity
from typing import NamedTuple

import numpy as np

from rpo_core.controller import AnyController
from rpo_training.campaign.config import find, load
from rpo_training.campaign.execution import on_threads
from rpo_training.campaign.run_batch import columns_of, units
from rpo_training.campaign.statistics import Rate, rate, successes

SEED = 2026
"""Beyond the seeds of the shipped campaigns and of trainings."""

LEAST = {
    'paper_test': (10_000, 0.999),
    'random_starts': (20_000, 1.0),
    'random_moving_starts': (20_000, 0.9999),
}
"""Campaign -> runs, and the least share that shall succeed."""


class Outcome(NamedTuple):
    """What came of a campaign; least : share of runs that shall succeed."""

    success: Rate
    least: float

    @property
    def missed(self) -> int:
        """Runs that miss a limit."""
        return self.success.runs - self.success.kept

    @property
    def holds(self) -> bool:
        """Whether enough runs succeed."""
        return self.success.kept >= self.least * self.success.runs


def everywhere(
    controller: AnyController,
    seed: int = SEED,
    workers: int = 0,
    report: Callable[[str, float, float], None] = lambda *_: None,
) -> list[Outcome]:
    """Return what comes of the campaigns of `LEAST`; `report` is told what is flown."""
    found, threads = [], workers or len(sched_getaffinity(0))
    for name, (runs, least) in LEAST.items():
        campaign = load(find(name), runs=runs, seed=seed, controller='handmade')
        campaign = replace(campaign, controller=controller)
        kept = done = 0
        with closing(on_threads(campaign, list(range(units(runs))), threads)) as source:
            for _, results in source:
                report(f'{controller.name}: {name}', done, runs)
                columns = dict(zip(columns_of(campaign), results, strict=True))
                kept += int(np.count_nonzero(successes(campaign.config, columns)))
                done += results.shape[1]
        found.append(Outcome(rate(name, kept, runs), least))
    return found
