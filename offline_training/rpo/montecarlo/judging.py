# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a campaign judges its runs by, and what not, in words: a success says which limits it means.

A requirement counts as judged where runs are judged by the limit that the scenario requires. Where
they are judged by another one, that is said, and the limit of the scenario is counted beside it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rpo.display import UNITS, suffix_of
from rpo.montecarlo.config import METRICS, Campaign, CampaignConfig
from rpo_core.files.validation import choice
from rpo_core.judge import verdicts
from rpo_core.scenario.requirements import ROWS, SHARES

EFFORT = tuple(name for name, row in ROWS.items() if row.effort)
"""Requirements on what the thrusters do; the others are about where the chaser is, and how fast."""

MOTION = 'position and speed'
"""What the requirements beside `EFFORT` are about, as tables name them together."""

NOT_JUDGED = verdicts.UNBOUNDED

_IN_FLIGHT = ('keep_out', 'slew', 'contact', 'arrival', 'hold', 'mean', 'final')
"""What requirements are about, as a flight comes to it; after these, what it spends."""

OF_ITS_OWN = 'x disturbance of its run'
"""Unit of the limit that each run has of its own."""


def words(column: str, unit: bool = True) -> str:
    """Return the name of a column for people: `initial_vx_m_s` is 'initial vx [m/s]'."""
    suffix = suffix_of(column)
    name = column.removesuffix(suffix).replace('_', ' ')
    return f'{name} [{UNITS[suffix]}]' if unit and suffix else name


def motion(names: Iterable[str]) -> list[str]:
    """Return those of some requirements that are about position and speed."""
    return [name for name in names if name not in EFFORT]


def limits_named(names: Collection[str], limits: Collection[str]) -> list[str]:
    """Return the limits that names mean: `MOTION`, a limit, or its first words, as `slew`.

    Raises InputError if a name means none.
    """
    chosen = []
    for name in [names] if isinstance(names, str) else names:
        start = f'{name}_'.replace(' ', '_')
        begun = [limit for limit in limits if f'{limit}_'.startswith(start)]
        chosen += motion(limits) if name == MOTION else begun or [choice('judge', name, limits)]
    return chosen


def unit_of(name: str) -> str:
    """Return the unit of a limit, as tables show it."""
    return OF_ITS_OWN if name in SHARES else METRICS.get(name, ROWS[name].unit)


def label(name: str, limit: float) -> str:
    """Return a limit as tables show it."""
    return f'{name} <= {limit:g} {unit_of(name)}'.rstrip()


def in_flight(names: Iterable[str]) -> list[str]:
    """Return limits in the order in which a flight comes to them."""

    def place(name: str) -> int:
        kinds = [i for i, kind in enumerate(_IN_FLIGHT) if name.startswith(kind)]
        return kinds[0] if kinds else len(_IN_FLIGHT)

    return sorted(names, key=place)


def never(name: str, runs: int = 1) -> str:
    """Return what so many runs do of which a metric is infinite."""
    end = '' if runs != 1 else 'es' if name.startswith('contact_') else 's'
    if name.startswith(('contact_', 'arrival_')):
        return f'never {"touch" if name.startswith("contact_") else "arrive"}{end}'
    return f'never {"has" if end else "have"} a finite {words(name, unit=False)}'


def figures(campaign: Campaign) -> dict[str, str]:
    """Return the metrics that tables show, name -> unit: what is judged, or required."""
    names = {column for name in campaign.required for column in campaign.config.judging_of(name)}
    asked = names.union(campaign.config.judging)
    return {name: unit for name, unit in campaign.metrics.items() if name in asked}


def judged(campaign: Campaign) -> list[str]:
    """Return the requirements of the scenario's file that runs are judged by, limit for limit."""
    success = campaign.config.success
    return [name for name, limit in campaign.required.items() if success.get(name) == limit]


def not_judged(campaign: Campaign) -> list[str]:
    """Return the requirements of the scenario's file that runs are not judged by."""
    return [name for name in campaign.required if name not in campaign.config.success]


def stated(campaign: Campaign) -> CampaignConfig:
    """Return the configuration with the limits of the scenario's file where runs have others."""
    success = campaign.config.success
    limits = {n: x for n, x in campaign.required.items() if success.get(n, x) != x}
    return replace(campaign.config, success=limits)


def sentence(campaign: Campaign) -> str:
    """Return what success means: the limits, and what the scenario requires that is not judged."""
    success, scenario = campaign.config.success, campaign.scenario.name
    seen, unseen, others = judged(campaign), not_judged(campaign), stated(campaign).success
    rest = ', '.join(verdicts.unbounded(campaign.scenario, success))
    rest = f'; no limit on {rest}' if rest else ''
    if not unseen and len(seen) + len(others) == len(success):
        instead = (
            f', {words(name, unit=False)} by {success[name]:g} instead of {limit:g} {unit_of(name)}'
            for name, limit in others.items()
        )
        return f'all {len(success)} requirements of {scenario}{"".join(instead).rstrip()}{rest}'
    names = ', '.join(
        words(name, unit=False) + ('' if name in seen else f' ≤ {limit:g} {unit_of(name)}'.rstrip())
        for name, limit in success.items()
    )
    if not campaign.required:
        return f'{names} ({scenario} has no requirements{rest})'
    if unseen:
        rest = f'; {NOT_JUDGED}: {", ".join(words(name, unit=False) for name in unseen)}{rest}'
    return f'{names} ({len(seen)} of the {len(campaign.required)} requirements of {scenario}{rest})'


def of_run(campaign: Campaign, columns: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Return what a run is judged by: limit, its value, its size in this run, verdict.

    columns : of this run alone, (1,) each
    """
    rows = []
    for config in (campaign.config, stated(campaign)):
        for name, limit in config.success.items():
            (value,), own = config.limit(name, columns)
            (size,) = np.broadcast_to(own, 1)
            word = verdicts.HOLDS if value <= size else verdicts.MISSED
            unit = ROWS[name].unit
            beside = verdicts.number(value, unit, '.6g'), verdicts.number(size, unit, '.6g')
            rows.append((label(name, limit), *beside, word))
    return rows + [
        (label(name, campaign.required[name]), '', '', NOT_JUDGED) for name in not_judged(campaign)
    ]
