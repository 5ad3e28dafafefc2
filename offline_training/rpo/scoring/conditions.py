# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a search judges a flight by: the requirements of its scenario, as columns of rows.

They are the values of `rpo_core.judge.metrics`, of all requirements.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from rpo_core.files.validation import InputError
from rpo_core.judge import metrics
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.requirements import (
    LIMITS,
    MAX_ARRIVAL_DISTANCE_M,
    MAX_ARRIVAL_SPEED_M_S,
    MAX_SLEW_N_S,
    ROWS,
    SHARES,
    THRUST,
    Requirements,
)
from rpo_core.scenario.scenario import Scenario

PAPER = Requirements(
    mean_speed_norm_m_s=MAX_ARRIVAL_SPEED_M_S,
    slew_per_axis_n_s=MAX_SLEW_N_S,
    mean_error_norm_m=MAX_ARRIVAL_DISTANCE_M,
)
"""The conditions of the paper's training, and arrival, ours; for a scenario without its own."""

LABELS = {
    'mean_speed_norm_m_s': 'speed',
    'slew_per_axis_n_s': 'slew',
    'mean_error_norm_m': 'arrival',
}
"""Short names of these three, in the order in which their penalties add up."""

AT_LIMIT = 0.1
"""Share of the penalty that the graded one takes just beyond a limit."""

_ORDER = (
    *LABELS,
    'arrival_time_s',
    'energy_n2s',
    'delta_v_axis_sum_m_s',
    'hold_error_per_axis_m',
    'hold_speed_per_axis_m_s',
    'hold_force_per_axis_n',
    'hold_force_per_disturbance',
    *sorted(LIMITS, key=lambda name: ROWS[name].attitude),
)
"""Requirements in the order in which their penalties add up: the bits of a fitness depend on it."""


@dataclass(frozen=True)
class Conditions:
    """Conditions of the flights of a scenario.

    keys : requirements; columns : where their values are in a row; limits : (k,)
    late : whether the extremes are those after `hold_from_s`; late_s : the time that this is
    together : whether the rows need all columns of `VALUES`
    arrival_m : error of an axis that counts as arrived
    """

    keys: tuple[str, ...]
    columns: list[int]
    limits: Floats
    late: bool
    late_s: float
    together: bool
    arrival_m: float

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the conditions, as progress and provenance show them."""
        return tuple(map(label, self.keys))

    def values(self, rows: Floats) -> Floats:
        """Return what is judged (..., k) of rows (..., columns)."""
        return rows[..., self.columns]


def label(key: str) -> str:
    """Return the short name of a requirement."""
    return LABELS.get(key, key)


def column_of(name: str, required: Requirements | None) -> int:
    """Return the column of a row that has the value of a requirement."""
    by_norm = required is not None and required.arrival_error_norm_m is not None
    counted = name in metrics.UNITS and not (name == metrics.ARRIVAL and by_norm)
    return metrics.VALUES.index(name) if counted else metrics.COLUMNS[name]


def conditions_of(base: Scenario) -> Conditions:
    """Return the conditions of a scenario."""
    required = base.requirements or PAPER
    limits, hold = dict(required.limits), metrics.hold_tick(base)
    for name in limits.keys() & SHARES.keys():
        limits[name] *= float(np.abs(base.disturbances_n).max())
    if required.arrival_error_norm_m is None and 'arrival_time_s' in limits:
        # As it is counted: ticks times dt; who never arrives has the duration.
        ticks = (base.times_s[:-1] <= limits['arrival_time_s']).sum() - 1
        limits['arrival_time_s'] = float(ticks) * base.dt_s
    for name in limits.keys() & THRUST.keys():
        raise InputError(
            f'a search cannot judge the starts of a set by `{name}`; give a campaign in '
            '`fitness.drawn.campaigns`'
        )
    keys = [key for key in dict.fromkeys(_ORDER) if key in limits]
    if hold is not None and hold >= base.ticks:  # the flight ends before; it is not judged by these
        keys = [key for key in keys if not key.startswith('hold_')]
    found = [column_of(key, required) for key in keys]
    return Conditions(
        tuple(keys),
        found,
        np.array([limits[key] for key in keys]),
        any(key.startswith('hold_') for key in keys),
        max(1, base.ticks - (hold or 0)) * base.dt_s,
        max(found, default=0) >= len(metrics.UNITS),
        _arrival_m(required),
    )


def _arrival_m(required: Requirements) -> float:
    """Return the error of an axis that counts as arrived."""
    if required.arrival_error_per_axis_m is not None:
        return required.arrival_error_per_axis_m
    if required.arrival_error_norm_m is not None:
        return required.arrival_error_norm_m / sqrt(3.0)
    return MAX_ARRIVAL_DISTANCE_M
