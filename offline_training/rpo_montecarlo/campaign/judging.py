# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a campaign judges its runs by, and what not, in words: a success says which limits it means.

A requirement counts as judged where runs are judged by the limit that the scenario requires.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from rpo_core.judge import verdicts
from rpo_core.judge.requirements import ROWS
from rpo_montecarlo.campaign.config import METRICS, SHARE, Campaign

EFFORT = tuple(name for name, row in ROWS.items() if row.effort)
"""Requirements on what the thrusters do; the others are about where the chaser is, and how fast."""

MOTION = 'position and speed'
"""What the requirements beside `EFFORT` are about, as tables name them together."""

NOT_JUDGED = 'NOT judged'

OF_ITS_OWN = 'x disturbance of its run'
"""Unit of the limit that each run has of its own."""

_SUFFIXES = {
    '_deg_s': 'deg/s',
    '_m_s': 'm/s',
    '_n_s': 'N/s',
    '_n2s': 'N²s',
    '_rad': 'rad',
    '_deg': 'deg',
    '_kg': 'kg',
    '_ticks': 'ticks',
    '_share': 'share',
    '_m': 'm',
    '_s': 's',
    '_n': 'N',
}


def words(column: str, unit: bool = True) -> str:
    """Return the name of a column for people: `initial_vx_m_s` is 'initial vx [m/s]'."""
    for suffix, shown in _SUFFIXES.items():
        if column.endswith(suffix):
            name = column.removesuffix(suffix).replace('_', ' ')
            return f'{name} [{shown}]' if unit else name
    return column.replace('_', ' ')


def motion(names: Iterable[str]) -> list[str]:
    """Return those of some requirements that are about position and speed."""
    return [name for name in names if name not in EFFORT]


def unit_of(name: str) -> str:
    """Return the unit of a limit, as tables show it."""
    return OF_ITS_OWN if name == SHARE else METRICS.get(name, ROWS[name].unit)


def label(name: str, limit: float) -> str:
    """Return a limit as tables show it."""
    return f'{name} <= {limit:g} {unit_of(name)}'.rstrip()


def judged(campaign: Campaign) -> list[str]:
    """Return the requirements of the scenario's file that runs are judged by, limit for limit."""
    success = campaign.config.success
    return [name for name, limit in campaign.required.items() if success.get(name) == limit]


def not_judged(campaign: Campaign) -> list[str]:
    """Return the requirements of the scenario's file that runs are not judged by."""
    known = judged(campaign)
    return [name for name in campaign.required if name not in known]


def sentence(campaign: Campaign) -> str:
    """Return what success means: the limits, and what the scenario requires that is not judged."""
    success, scenario = campaign.config.success, campaign.scenario.name
    seen, unseen = judged(campaign), not_judged(campaign)
    if not unseen and len(seen) == len(success):
        return f'all {len(seen)} requirements of {scenario}'
    names = ', '.join(
        words(name, unit=False) + ('' if name in seen else f' ≤ {limit:g} {unit_of(name)}'.rstrip())
        for name, limit in success.items()
    )
    if not campaign.required:
        return f'{names} ({scenario} has no requirements)'
    rest = ', '.join(words(name, unit=False) for name in unseen)
    rest = f'; {NOT_JUDGED}: {rest}' if rest else ''
    return f'{names} ({len(seen)} of the {len(campaign.required)} requirements of {scenario}{rest})'


def of_run(campaign: Campaign, columns: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Return what a run is judged by: limit, its value, its size in this run, verdict.

    columns : of this run alone, (1,) each
    """
    rows = []
    for name, limit in campaign.config.success.items():
        (value,), own = campaign.config.limit(name, columns)
        (size,) = np.broadcast_to(own, 1)
        word = verdicts.HOLDS if value <= size else verdicts.MISSED
        unit = ROWS[name].unit
        row = label(name, limit), f'{value:.6g} {unit}'.rstrip(), f'{size:.6g} {unit}'.rstrip()
        rows.append((*row, word))
    return rows + [
        (label(name, campaign.required[name]), '', '', NOT_JUDGED) for name in not_judged(campaign)
    ]
