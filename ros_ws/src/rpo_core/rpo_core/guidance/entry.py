# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""When a plan shall meet a target that turns, and how fast a turn the thrusters can follow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import ceil, sqrt
from typing import NamedTuple

import numpy as np

from rpo_core.attitude.target import TUMBLE
from rpo_core.files.validation import InputError
from rpo_core.guidance.guidance import (
    ARRIVED,
    HOLD,
    STRAIGHT,
    TRANSFER,
    Guidance,
    GuidanceStage,
    Leg,
    check,
)
from rpo_core.guidance.transfers import TooMuch, bounded
from rpo_core.kernels.arithmetic import norm
from rpo_core.scenario.scenario import Scenario

STEP_S, MOMENTS = 5, 120
"""Durations of the transfer that are tried: so far apart, farther in a flight that has more."""

SHARES = (0.5, 0.75, 1.0, 1.5, 2.0)
"""Shares of the speed of the line that follows, or of the time in the corridor, that are tried."""


WORK = 2e7
"""Steps of work (`transfers.spend`) that a plan may take: what takes more has no time."""


class Entry(NamedTuple):
    """A plan that meets the target at another moment.

    energy_n2s, delta_v_m_s : to the end of its last leg; delta-v is the sum over the axes
    ends_s : when that is
    leg, line : the transfer, and the straight leg after it if there is one
    """

    energy_n2s: float
    delta_v_m_s: float
    ends_s: float
    leg: Leg
    line: Leg | None
    settings: Guidance


def _others(settings: Guidance, scenario: Scenario) -> Iterator[tuple[int, Guidance]]:
    """Yield plans of other durations: the place of the transfer, and the plan."""
    legs = settings.legs
    meets = [i for i, leg in enumerate(legs) if leg.kind == TRANSFER and settings.turns(i)]
    if scenario.target is None or not meets or any(leg.kind == HOLD for leg in legs):
        raise InputError(
            'a moment of entry needs section `target`, and a plan without holds that has a '
            f'transfer of `frame` target; got {scenario.name}'
        )
    i = meets[-1]
    leg, line = legs[i], legs[i + 1] if i + 1 < len(legs) else None
    straight = line is not None and line.kind == STRAIGHT
    for share in SHARES if straight or leg.corridor_s else (1.0,):
        arrive = leg.arrive_m_s
        after = list(legs[i + 1 :])
        if line is not None and straight and line.speed_m_s:
            if share * line.speed_m_s < line.end_speed_m_s:
                continue
            x, y, z = arrive
            arrive = round(share * x, 6), round(share * y, 6), round(share * z, 6)
            after[0] = replace(line, speed_m_s=round(share * line.speed_m_s, 6))
        corridor_s = leg.corridor_s and share * leg.corridor_s
        step_s = max(STEP_S, ceil(scenario.duration_s / MOMENTS))
        for moment_s in range(step_s, int(scenario.duration_s), step_s):
            if corridor_s and corridor_s >= moment_s:
                continue
            tried = replace(
                leg, duration_s=float(moment_s), arrive_m_s=arrive, corridor_s=corridor_s
            )
            yield i, replace(settings, legs=(*legs[:i], tried, *after))


def entries(settings: Guidance, scenario: Scenario) -> list[Entry]:
    """Return plans by their energy, the least first; raises InputError if none can be flown.

    The first can be flown: it was rehearsed. Of the others the force was looked at.
    """
    plans, ticks, dt_s = [], scenario.ticks, scenario.dt_s
    for i, tried in _others(settings, scenario):
        stage = GuidanceStage(tried, scenario)
        try:
            with bounded(WORK):
                forces = np.abs(stage.rows(scenario.start, ticks)[:, 6:])
        except TooMuch:
            continue
        begins = {change.phase: change.tick for change in stage.changes}
        names = [*(leg.name for leg in tried.legs), ARRIVED]
        end, taken = begins.get(ARRIVED, ticks), begins.get(names[i + 1], ticks)
        leg = tried.legs[i]
        longer = (taken - begins.get(leg.name, ticks)) * dt_s - (leg.duration_s or 0.0)
        limit = settings.force_share * scenario.max_force_n
        if end < ticks and longer < 0.02 * (leg.duration_s or 0.0) and forces[:end].max() <= limit:
            used, mass = forces[:end], settings.mass_kg or scenario.mass_kg
            spent = float((used * used).sum()) * dt_s, float(used.sum()) * dt_s / mass
            line = tried.legs[i + 1] if i + 1 < len(tried.legs) else None
            plans.append(Entry(*spent, end * dt_s, leg, line, tried))
    plans.sort(key=lambda entry: entry.energy_n2s)
    for first, entry in enumerate(plans):
        try:
            check(entry.settings, scenario)
        except InputError:
            continue
        return plans[first:]
    raise InputError(f'no moment was found at which the plan of {scenario.name} can be flown')


def most_turn(settings: Guidance, scenario: Scenario) -> tuple[float, float, float]:
    """Return the rate [rad/s] that guidance can follow however the target is turned.

    Then the largest range [m] and speed [m/s] of legs in its axes. There a chaser needs at most
    W^2 L + |W'| L + 2 W v, and 2 n^2 L against the tide; the change W' of a tumble is at most
    c W^2, by its principal moments: c = max (J_i - J_j) / J_k / sqrt(3). The worst direction of
    the thrusters is one of their axes. A spin across a hold needs all of it.
    """
    turning = [leg for i, leg in enumerate(settings.legs) if settings.turns(i)]
    far_m = max(norm(*leg.to_m) for leg in turning if leg.to_m is not None)
    fast = max([leg.speed_m_s or 0.0 for leg in turning])
    n, change = scenario.mean_motion_rad_s, 1.0
    if scenario.target.kind == TUMBLE:
        x, y, z = np.linalg.eigvalsh(np.array(scenario.target.inertia_kg_m2)).tolist()
        change += max((z - y) / x, (z - x) / y, (y - x) / z) / sqrt(3.0)
    a = settings.force_share * scenario.max_force_n / (settings.mass_kg or scenario.mass_kg)
    left = max(0.0, a - 2.0 * n * n * far_m)
    rate = (sqrt(fast * fast + change * far_m * left) - fast) / (change * far_m)
    return rate, far_m, fast
