# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The fitness term of drawn flights: what campaigns fly, a few of it, the same for all candidates.

Corner flights deceive: a controller that keeps its limits in all of them may miss in one of five
dispersed runs. So a search flies runs of campaigns. A stage of the search has its own draws: of a
pool, the runs that are hardest for the best controller so far (largest value beside its limit), and
as many that are simply the first. At the end, draws of another seed decide among finalists.

A campaign may be of a world, with sensors, an estimator and thrusters that fire in pulses. Each run
then has its own noise, the same for all candidates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, Any

import numpy as np

from rpo.engine.cases import DrawnCase
from rpo.engine.parts.dynamics import uneven_steps
from rpo.engine.support import why_not
from rpo.montecarlo.config import LEVEL, SHARE, Campaign, find, load
from rpo.montecarlo.run_batch import case_of, side_by_side
from rpo.montecarlo.sampling import DrawnRuns, draw
from rpo.scoring.conditions import column_of
from rpo_core.files.validation import (
    MOST_PATH,
    Checked,
    InputError,
    choice,
    real,
    shown,
    store,
    text,
    whole,
)
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.requirements import LIMITS

HELD_OUT = -1
"""The stage of the draws that no search has seen."""

UNDRAWN = -2
"""A stage without drawn flights."""

WEIGHT = partial(real, unit='N²s', least=0.0)
SHARE_BELOW_1 = partial(real, least=0.0, below=1.0)
"""Checks of settings."""

_SEEDS = 1000  # between the seeds of stages and those held out


@dataclass(frozen=True)
class DrawnSettings(Checked):
    """Settings of the term.

    weight : [N²s] of a run that misses a limit by far, over `flights`; 0 = off
    campaigns : shipped names or files; each adds a term
    judged : campaign of these -> the limits that its runs are judged by; otherwise all of them
    margin : share by which the limits of a run are made stricter, in [0, 1)
    flights : of each campaign, in each stage
    pool : drawn runs of which half of the flights are the hardest; 0: all are as drawn
    held_out : runs of each campaign that decide among the finalists
    seed : of the draws
    """

    PLACE = 'fitness.drawn.'

    weight: Annotated[float, WEIGHT] = 0.0
    campaigns: tuple[str, ...] = ()
    margin: Annotated[float, SHARE_BELOW_1] = 0.0
    flights: Annotated[int, partial(whole, least=1, most=10_000)] = 40
    pool: Annotated[int, partial(whole, least=0, most=1_000_000)] = 2000
    held_out: Annotated[int, partial(whole, least=1, most=1_000_000)] = 2000
    seed: Annotated[int, partial(whole, least=0, most=2**31)] = 1
    judged: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        store(self, judged=_judged(self.judged))
        super().__post_init__()
        for i, name in enumerate(self.campaigns):
            text(f'fitness.drawn.campaigns[{i}]', name, most=MOST_PATH)


def _judged(value: Any) -> dict[str, tuple[str, ...]]:
    """Return the checked field `judged`; raises InputError."""
    name, found = 'fitness.drawn.judged', {}
    if not isinstance(value, Mapping):
        raise InputError(f'`{name}` must be a mapping of campaigns; got {shown(value)}')
    for campaign, limits in value.items():
        text(name, campaign, most=MOST_PATH)
        if not isinstance(limits, (list, tuple)) or not limits:
            raise InputError(f'`{name}.{campaign}` must be a list of limits; got {shown(limits)}')
        found[campaign] = tuple(choice(f'{name}.{campaign}', limit, LIMITS) for limit in limits)
    return found


class DrawnFlights:
    """The runs of one campaign that a search flies.

    label : the name of the campaign
    count : in a stage
    columns, limits : of the metrics by which a run succeeds; limits (k,), or (runs, k) of the runs
        of the last case if the force is limited by each run's own disturbance

    Raises InputError if the engine cannot fly the campaign.
    """

    def __init__(self, name: str, settings: DrawnSettings) -> None:
        # The file may name the controller that is to be trained, which is not there yet.
        self._campaign, self._settings = load(find(name), controller='handmade'), settings
        if name in settings.judged:
            self._campaign = self._campaign.judging(settings.judged[name])
        self.label, self.count = self._campaign.config.name, settings.flights
        reason = why_not(self._campaign.scenario, self._campaign.controller)
        if reason:
            raise InputError(f'a search cannot fly campaign {self.label}: {reason}')
        success, required = self._campaign.config.success, self._campaign.scenario.requirements
        self.columns = [column_of(name, required) for name in success]
        self.limits = np.array(list(success.values()))

    @property
    def judged(self) -> list[str]:
        """Names of the limits that a run is judged by."""
        return list(self._campaign.config.success)

    @property
    def texts(self) -> tuple[str, str]:
        """YAML of the campaign and of its scenario."""
        return self._campaign.texts[0], self._campaign.texts[1]

    def pool(self, stage: int) -> tuple[Campaign, DrawnRuns]:
        """Return all runs that are drawn for a stage, and the campaign that draws them."""
        own = self._settings
        runs = own.held_out if stage == HELD_OUT else max(own.pool, own.flights)
        first = 2 * _SEEDS * own.seed
        seed = first + (_SEEDS if stage == HELD_OUT else stage)
        config = replace(self._campaign.config, runs=runs, seed=seed)
        campaign = replace(self._campaign, config=config)
        return campaign, draw(campaign, 0, runs)

    def case(self, stage: int, chosen: Sequence[int] | None = None) -> DrawnCase:
        """Return runs of a stage, by number; all of them if not given."""
        campaign, drawn = self.pool(stage)
        uneven = uneven_steps(campaign.scenario, drawn.column('orbit_radius_m'))
        if uneven:
            raise InputError(f'a search cannot fly campaign {self.label}: {uneven}')
        if chosen is not None:
            drawn = drawn.some(list(chosen))
        if SHARE in campaign.config.success:  # whoever flies, the disturbance is the same
            known = side_by_side(campaign, drawn)
            limits = [campaign.config.limit(name, known)[1] for name in self.judged]
            self.limits = np.column_stack(np.broadcast_arrays(*limits, known[LEVEL])[:-1])
        return case_of(campaign, drawn)

    def choose(self, rows: Floats | None) -> list[int]:
        """Return the numbers of the flights of a stage.

        rows : (pool, columns) metrics of the pool, of the best controller so far; None: no such
        """
        count = self._settings.flights
        if rows is None:
            return list(range(count))
        shares = (rows[:, self.columns] / self.limits).max(axis=1)
        hardest = np.argsort(-shares, kind='stable')[: count // 2].tolist()
        others = [i for i in range(len(rows)) if i not in hardest]
        return sorted([*hardest, *others[: count - len(hardest)]])
