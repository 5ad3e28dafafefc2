# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Plans, flown without errors before they are flown: what cannot be flown is refused."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rpo_core.files.validation import InputError
from rpo_core.guidance import plan
from rpo_core.guidance.guidance import ARRIVED, DOCKED, Change, GuidanceStage
from rpo_core.guidance.legs import SEGMENTS
from rpo_core.guidance.plan import Guidance
from rpo_core.guidance.work import TooMuch, bounded, spend
from rpo_core.kernels.arithmetic import State, Vector, norm
from rpo_core.scenario.scenario import Scenario
from rpo_core.stage import Place, Section, register

MOST_WORK = 4e8
"""Steps (`rpo_core.guidance.work`) that the search of a plan may take; those that ship take 4e6."""

PER_TICK = 400
"""Steps for each tick of a plan, about: so it may have a million ticks under way."""


class Checked(NamedTuple):
    """A plan, flown without errors.

    references : (n, 6) [m, m/s]; forces : (n, 3) [N]; changes : its phases
    """

    references: list[State]
    forces: list[Vector]
    changes: list[Change]


def nominal(settings: Guidance, scenario: Scenario, *, to_rest: bool = False) -> Checked:
    """Return the reference of a chaser that follows it exactly, each hold ended when it may be.

    to_rest : up to where it stays at the end of the plan; else to the end of the flight
    """
    legs = tuple(
        replace(leg, go=plan.AUTO) if leg.kind == plan.HOLD else leg for leg in settings.legs
    )
    stage = GuidanceStage(replace(settings, legs=legs), scenario)
    references: list[State] = []
    forces: list[Vector] = []
    state = scenario.start
    for tick in range(scenario.ticks + 1):
        spend(PER_TICK)
        reference, force = stage.step(tick, state)
        references.append(reference)  # type: ignore[arg-type]
        forces.append(force)  # type: ignore[arg-type]
        state = reference  # type: ignore[assignment]
        if to_rest and stage.rests:
            break
    return Checked(references, forces, stage.changes)


@lru_cache(maxsize=64)
def check(settings: Guidance, scenario: Scenario) -> None:
    """Raise InputError if the plan of a scenario cannot be flown, with the number that fails."""
    try:
        with bounded(MOST_WORK):
            found = nominal(settings, scenario, to_rest=True)
    except TooMuch:
        raise InputError(
            f'`guidance` must have a plan that is found in {MOST_WORK:g} steps of work; got one '
            'that takes more: too many ticks, too little time or force (`duration_s`, '
            '`force_share`), or zones without a way between them'
        ) from None
    _check_durations(settings, scenario, found)
    cone = settings.corridor.cone(settings.port_m)
    mass_kg = settings.mass_kg or scenario.mass_kg
    seen = np.array(found.references)
    if scenario.target is not None:
        seen = scenario.target.known.seen(seen, scenario)
    starts = [change.tick for change in found.changes]
    for tick, (state, force) in enumerate(zip(seen.tolist(), found.forces, strict=True)):
        phase = found.changes[bisect_right(starts, tick) - 1].phase
        at = f'leg {phase}, {tick * scenario.dt_s:g} s'
        largest = max(abs(f) for f in force)
        if largest > settings.force_share * scenario.max_force_n * (1.0 + 1e-9):
            raise InputError(
                f'`guidance` must need at most `force_share` = {settings.force_share:g} of '
                f'`max_force_n` = {scenario.max_force_n:g} N; {at}: {largest:.4g} N, '
                f'{largest / mass_kg:.3g} m/s^2'
            )
        position, sphere = tuple(state[:3]), settings.keep_out_m
        distance = norm(*position)
        if distance >= sphere or (settings.past_port_m and phase in (ARRIVED, DOCKED)):
            continue
        if not settings.corridor.from_m:
            raise InputError(
                f'`guidance` must keep out of the sphere of `keep_out_m` = {sphere:g} m '
                f'without `corridor.from_m`; {at}: {distance:.4g} m from the target'
            )
        outside = cone.outside_m(position)
        if outside > 1e-9:
            raise InputError(
                f'`guidance` must keep out of the sphere of `keep_out_m` = {sphere:g} m but for '
                f'`corridor` to `port_m`; {at}: {distance:.4g} m from the target, {outside:.3g} m '
                'off it'
            )


def _check_durations(settings: Guidance, scenario: Scenario, found: Checked) -> None:
    """Raise InputError if a transfer needs more force than it may, and so takes longer."""
    ends = [*(change.tick for change in found.changes[1:]), scenario.ticks + 1]
    for change, end in zip(found.changes, ends, strict=True):
        for leg in settings.legs:
            if leg.name == change.phase and leg.duration_s is not None:
                taken = (end - change.tick) * scenario.dt_s
                if taken > leg.duration_s * (1.0 + 1.0 / SEGMENTS) + scenario.dt_s:
                    limit = settings.force_share * scenario.max_force_n
                    raise InputError(
                        f'`duration_s` of leg {leg.name} must be about {taken:g} s for a force of '
                        f'at most {limit:g} N; got {leg.duration_s:g}'
                    )


register(
    Section(
        'guidance',
        Guidance,
        Place.GUIDANCE,
        GuidanceStage,
        rehearse=check,
        zones=Guidance.zones,
        of_zones=Guidance.of_zones,
    )
)
