# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A search fitted to a scenario: scales that follow from its range, its time and its force.

Without forces of the orbit, flights with the same authority F T^2 / (m R) are similar: with R as
unit of length, T of time and m R / T^2 of force, they are the same flight. The paper's training has
R = 100 m, T = 200 s, m = 10 kg, F = 0.5 N, an authority of 20. So a controller of the paper becomes
the start of any search when its scales are multiplied by these units; where there is more
authority, the controller uses the part of the force that the paper would.
"""

from __future__ import annotations

from math import sqrt

from rpo_core.files.validation import InputError
from rpo_core.judge.metrics import PENALTY
from rpo_core.judge.similarity import base_of, range_m, time_s
from rpo_core.scenario.requirements import Requirements
from rpo_core.scenario.scenario import Scenario, ScenarioSet, load
from rpo_core.world.starts import Grid

AROUND = 0.1
"""A single flight is trained from its start and around it, by this share of the distance."""

ENERGY_N2S = 0.125
"""Of the paper's training: the unit of energy, (m R)^2 / T^3."""


def training_set(name: str) -> ScenarioSet:
    """Return the starts that a search flies; raises InputError, also where none can be kept."""
    found = load(name)
    if isinstance(found, Scenario):
        found = ScenarioSet(found, around(found))
    elif found.base.sections:
        raise InputError(
            f'a search flies to the goal; the flights of {name} follow a plan (section `guidance`)'
        )
    refuse_impossible(found)
    return found


def around(scenario: Scenario) -> Grid:
    """Return the start of a scenario and starts around it, by `AROUND` of the distance."""
    x, y, z, *_ = scenario.from_goal(scenario.start)
    off = AROUND * sqrt(x * x + y * y + z * z)
    axes = [(r - off, r, r + off) if off else (r,) for r in scenario.initial_position_m]
    return Grid(*axes)


def refuse_impossible(starts: Scenario | ScenarioSet) -> None:
    """Raise InputError if the force cannot stop the farthest start at the goal in time.

    The least time to be within e of the goal and able to stay is that of full force to the middle
    of the way to the far side of e, and full force back. Relative gravity may help: it is added.
    """
    base = base_of(starts)
    far_m, limit_s = range_m(starts), time_s(base)
    within_m = _error_m(base.requirements)
    if within_m is None or far_m <= within_m:
        return
    n, thrust = base.mean_motion_rad_s, base.max_force_n / base.mass_kg
    a = thrust + 3.0 * n * n * far_m + 2.0 * n * sqrt(thrust * far_m)
    least_s = 2.0 * sqrt((far_m + within_m) / a) - 2.0 * sqrt(within_m / a)
    if least_s > limit_s and not any(base.initial_velocity_m_s):
        raise InputError(
            f'no controller can do what scenario {base.name} requires: over {far_m:g} m, '
            f'{base.max_force_n:g} N on {base.mass_kg:g} kg need at least {least_s:.0f} s to be '
            f'within {within_m:g} m and to stop; the scenario has {limit_s:g} s'
        )


def _error_m(required: Requirements | None) -> float | None:
    """Return the largest error that is allowed where the chaser shall rest; None if any is."""
    if required is None:
        return None
    names = (
        'hold_error_per_axis_m',
        'hold_error_norm_m',
        'mean_error_norm_m',
        'arrival_error_per_axis_m',
        'arrival_error_norm_m',
        'final_error_per_axis_m',
        'final_error_norm_m',
    )
    limits = [getattr(required, name) for name in names]
    return max((limit for limit in limits if limit is not None), default=None)


def penalty_n2s(starts: ScenarioSet) -> float:
    """Return the paper's penalty in the unit of energy of a set."""
    energy = (starts.base.mass_kg * range_m(starts)) ** 2 / time_s(starts.base) ** 3
    return PENALTY * energy / ENERGY_N2S


def units_of(starts: ScenarioSet) -> tuple[float, float, float]:
    """Return length, time and force of a set, as multiples of those of the paper's training."""
    length, time = range_m(starts), time_s(starts.base)
    force = starts.base.mass_kg * length / time**2 / (10.0 * 100.0 / 200.0**2)
    return length / 100.0, time / 200.0, force
