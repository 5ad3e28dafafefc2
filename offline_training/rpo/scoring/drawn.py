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

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Annotated, Any, NamedTuple

import numpy as np

from rpo.montecarlo.config import load
from rpo.montecarlo.run_batch import as_flown, faulty, scenarios_of
from rpo.montecarlo.sampling import DrawnRuns, draw
from rpo_core.chain.chain import Chain
from rpo_core.chain.flight import JUDGED, fly_chain
from rpo_core.control.controller import Controller
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
from rpo_core.judge.verdicts import values_of
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
_PART = 5  # runs that a thread flies at a time

Row = list[dict[str, float]]
Each = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]


class Values(NamedTuple):
    """What drawn runs are judged by.

    values : (controllers, runs, k); limits : (runs, k), the force may be limited by each run's own
        disturbance
    """

    values: Floats
    limits: Floats


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
    judged : names of the limits that a run is judged by
    count : in a stage
    """

    def __init__(self, name: str, settings: DrawnSettings) -> None:
        # The file may name the controller that is to be trained, which is not there yet.
        self._campaign, self._settings = load(name, controller='handmade'), settings
        if name in settings.judged:
            self._campaign = self._campaign.judging(settings.judged[name])
        self.label, self.count = self._campaign.config.name, settings.flights
        self.judged = list(self._campaign.config.success)

    @property
    def texts(self) -> tuple[str, str]:
        """YAML of the campaign and of its scenario."""
        return self._campaign.texts[0], self._campaign.texts[1]

    def enter(self, stage: int) -> None:
        """Draw all runs of a stage.

        campaign : that draws them; drawn : they
        """
        own = self._settings
        runs = own.held_out if stage == HELD_OUT else max(own.pool, own.flights)
        first = 2 * _SEEDS * own.seed
        seed = first + (_SEEDS if stage == HELD_OUT else stage)
        config = replace(self._campaign.config, runs=runs, seed=seed)
        self.campaign = replace(self._campaign, config=config)
        self.drawn = draw(self.campaign, 0, runs)

    def choose(self, hardest_for: Values | None) -> None:
        """Keep some of all runs: half of them the hardest, and as many that are simply the first.

        hardest_for : values of all runs, of the best controller so far; None: no such
        """
        count, chosen = self._settings.flights, list(range(self._settings.flights))
        if hardest_for is not None:
            values, limits = hardest_for.values[0], hardest_for.limits
            shares = (values / limits).max(axis=1)
            hardest = np.argsort(-shares, kind='stable')[: count // 2].tolist()
            others = [i for i in range(len(shares)) if i not in hardest]
            chosen = sorted([*hardest, *others[: count - len(hardest)]])
        self.drawn = self.drawn.some(chosen)

    def fly(self, controllers: Sequence[Controller], each: Each = map) -> Values:
        """Return what the runs are judged by; `each` may map on threads."""
        runs = len(self.drawn.numbers)
        parts = [self.drawn.some(slice(i, i + _PART)) for i in range(0, runs, _PART)]
        flown = list(chain.from_iterable(each(partial(self._fly, controllers), parts)))
        columns = {
            name: np.array([[values[name] for values in run] for run in flown]).T
            for name in flown[0][0]
        }
        judged = [
            np.broadcast_arrays(*pair) for pair in self.campaign.config.limits(columns).values()
        ]
        values, limits = (np.stack(arrays, axis=-1) for arrays in zip(*judged, strict=True))
        return Values(values, limits[0])

    def _fly(self, controllers: Sequence[Controller], runs: DrawnRuns) -> list[Row]:
        """Return what is known of each run, by each controller in the same chain."""
        made = []
        for index, scenario in enumerate(scenarios_of(self.campaign, runs)):
            stages = faulty(self.campaign, runs, index)
            first = Chain.of(scenario, controllers[0], stages)
            chains = (first.with_controller(scenario, controller) for controller in controllers)
            made.append([values_of(as_flown(fly_chain(scenario, c, JUDGED))) for c in chains])
        return made
