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

from collections.abc import Sequence
from dataclasses import replace
from math import floor, log10, sqrt

import numpy as np

from rpo_core.files.scenario import Scenario, ScenarioSet, load
from rpo_core.files.starts import Grid
from rpo_core.files.validation import InputError
from rpo_core.judge.metrics import PENALTY
from rpo_core.judge.requirements import Requirements
from rpo_training.config import PRESETS, TrainingConfig

AROUND = 0.1
"""A single flight is trained from its start and around it, by this share of the distance."""

AUTHORITY = 20.0
ENERGY_N2S = 0.125
"""Of the paper's training: F T^2 / (m R), and the unit of energy, (m R)^2 / T^3."""

_POSITION, _VELOCITY = (0.2, 2.0), (0.6, 6.0)
_START = (0.588465, 2.3266)
"""Bounds of the searched scales, and the scales of `trained`, in R and R / T."""

_FIXED = (1.0, 2.0)
"""Fixed scales, the paper's 100 m and 1 m/s, in R and R / T."""

_OVER_GRAVITY = 4.0  # force scale, over the relative gravity at the farthest start


def training_set(name: str) -> ScenarioSet:
    """Return the starts that a search flies; raises InputError, also where none can be kept."""
    found = load(name)
    if isinstance(found, Scenario):
        found = ScenarioSet(found, _around(found))
    elif found.base.sections:
        raise InputError(
            f'a search flies to the goal; the flights of {name} follow a plan (section `guidance`)'
        )
    _refuse_impossible(found)
    return found


def _around(scenario: Scenario) -> Grid:
    x, y, z, *_ = scenario.from_goal(scenario.start)
    off = AROUND * sqrt(x * x + y * y + z * z)
    axes = [(r - off, r, r + off) if off else (r,) for r in scenario.initial_position_m]
    return Grid(*axes)


def range_m(starts: ScenarioSet) -> float:
    """Return the largest distance of an axis between a start and the goal."""
    errors = starts.initial_positions_m - np.array(starts.base.goal_position_m)
    return float(np.abs(errors).max())


def time_s(base: Scenario) -> float:
    """Return the time until which a flight must be at its goal."""
    required = base.requirements
    times = [base.duration_s]
    if required is not None:
        times += [t for t in (required.arrival_time_s, required.hold_from_s) if t]
    return min(times)


def _refuse_impossible(starts: ScenarioSet) -> None:
    """Raise InputError if the force cannot stop the farthest start at the goal in time.

    The least time to be within e of the goal and able to stay is that of full force to the middle
    of the way to the far side of e, and full force back. Relative gravity may help: it is added.
    """
    base, far_m, limit_s = starts.base, range_m(starts), time_s(starts.base)
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


def fitted(base: TrainingConfig, scenario: str) -> TrainingConfig:
    """Return a configuration for another scenario; its scales are fitted, its name is the set's.

    The terms of the paper's own test are left out. Raises InputError.
    """
    if scenario == base.scenario:
        return base
    starts = training_set(scenario)
    length, time, one = range_m(starts), time_s(starts.base), starts.base
    if length == 0.0:
        raise InputError(f'scenario {one.name} starts at its goal; a search needs another start')
    energy = penalty_n2s(starts) / PENALTY
    space, fitness = base.genes, base.fitness
    free = space.free_scales == 2
    position, velocity = (_POSITION, _VELOCITY) if free else ((_FIXED[0],) * 2, (_FIXED[1],) * 2)
    return replace(
        base,
        name=_file_name(starts.name),
        scenario=scenario,
        start_scales=_scaled(_START, (length, length / time)) if free else (),
        genes=replace(
            space,
            position_scale_m=_scaled(position, (length, length)),
            velocity_scale_m_s=_scaled(velocity, (length / time,) * 2),
            force_scale_n=_force_n(one, length, time),
        ),
        fitness=replace(
            fitness,
            penalty_n2s=_short(fitness.penalty_n2s * energy),
            limit_cycle=0.0,
            disturbance=0.0,
            robustness=0.0,
            drawn=replace(fitness.drawn, weight=0.0),
        ),
        cmaes=replace(base.cmaes, tolerance=_short(base.cmaes.tolerance * energy)),
        race=replace(base.race, gain=_short(base.race.gain * energy)),
    )


def penalty_n2s(starts: ScenarioSet) -> float:
    """Return the paper's penalty in the unit of energy of a set."""
    energy = (starts.base.mass_kg * range_m(starts)) ** 2 / time_s(starts.base) ** 3
    return PENALTY * energy / ENERGY_N2S


def units_of(starts: ScenarioSet) -> tuple[float, float, float]:
    """Return length, time and force of a set, as multiples of those of the paper's training."""
    length, time = range_m(starts), time_s(starts.base)
    force = starts.base.mass_kg * length / time**2 / (10.0 * 100.0 / 200.0**2)
    return length / 100.0, time / 200.0, force


def _force_n(base: Scenario, length: float, time: float) -> float:
    """Return the force at full output: the paper's authority, enough against what pushes."""
    n, m = base.mean_motion_rad_s, base.mass_kg
    pushed = float(np.abs(base.disturbance.over(base.times_s)).max()) + 3.0 * m * n * n * length
    wanted = max(AUTHORITY * m * length / time**2, _OVER_GRAVITY * pushed)
    return min(base.max_force_n, _short(wanted))


def _scaled(shares: Sequence[float], units: Sequence[float]) -> tuple[float, float]:
    first, second = (_short(a * b) for a, b in zip(shares, units, strict=True))
    return first, second


def _short(value: float) -> float:
    """Return a number rounded to four digits: a person reads the file."""
    return round(value, 3 - floor(log10(value)))


def _file_name(name: str) -> str:
    """Return the name of a scenario as that of a file."""
    return ''.join(c if c.isalnum() or c in '-_' else '_' for c in name)


def command(config: TrainingConfig) -> str:
    """Return the command that trains this configuration; `-o` alone changes the name."""
    for preset, known in PRESETS.items():
        fit, scenario = known, ''
        if config.scenario != known.scenario:
            fit, scenario = fitted(known, config.scenario), f' --scenario {config.scenario}'
        if replace(fit, seed=config.seed, name=config.name) == config:
            return f'rpo train --preset {preset}{scenario} --seed {config.seed}'
    return f'rpo train --config {config.name}.yaml, the config.yaml of its run folder'
