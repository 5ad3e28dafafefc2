# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a search judges a flight by: the requirements of its scenario, as columns of metrics.

The engine counts no norm after `hold_from_s` and no norm at the end: the search takes the norm of
the axes' largest values, which is never less. It sees nothing of a contact. The controller that is
found is judged by the exact values (`rpo_training.evaluation.judgement`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from rpo_core import metrics
from rpo_core.requirements import Requirements
from rpo_core.scenario import Scenario

Floats = NDArray[np.float64]

JUDGED, HOLD, FINAL = 'judged', 'hold', 'final'
"""Windows of a flight: all that is judged, after `hold_from_s`, the last state."""

PAPER = Requirements(
    mean_speed_norm_m_s=metrics.MAX_ARRIVAL_SPEED_M_S,
    slew_per_axis_n_s=metrics.MAX_SLEW_N_S,
    mean_error_norm_m=metrics.MAX_ARRIVAL_DISTANCE_M,
)
"""The conditions of the paper's training, and arrival, ours; for a scenario without its own."""

LABELS = {
    'mean_speed_norm_m_s': 'speed',
    'slew_per_axis_n_s': 'slew',
    'mean_error_norm_m': 'arrival',
}
"""Short names of these three, in the order in which their penalties add up."""

_COLUMNS = {
    'mean_speed_norm_m_s': (metrics.ARRIVAL_SPEED, JUDGED),
    'slew_per_axis_n_s': (metrics.SLEW, JUDGED),
    'mean_error_norm_m': (metrics.ARRIVAL_DISTANCE, JUDGED),
    'arrival_time_s': (metrics.ARRIVAL_TIME, JUDGED),
    'energy_n2s': (metrics.ENERGY, JUDGED),
    'delta_v_axis_sum_m_s': (metrics.DELTA_V, JUDGED),
    'hold_error_per_axis_m': (metrics.LATE_POSITION, HOLD),
    'hold_error_norm_m': (metrics.LATE_DISTANCE, HOLD),
    'hold_speed_per_axis_m_s': (metrics.LATE_VELOCITY, HOLD),
    'hold_speed_norm_m_s': (metrics.LATE_SPEED, HOLD),
    'hold_force_per_axis_n': (metrics.LATE_FORCE, HOLD),
    'hold_force_per_disturbance': (metrics.LATE_FORCE, HOLD),
    'final_error_per_axis_m': (metrics.LATE_POSITION, FINAL),
    'final_error_norm_m': (metrics.LATE_DISTANCE, FINAL),
    'final_speed_per_axis_m_s': (metrics.LATE_VELOCITY, FINAL),
    'final_speed_norm_m_s': (metrics.LATE_SPEED, FINAL),
}
"""Requirement -> column of a row of metrics, window; the paper's three come first."""

_BOUNDS = ('hold_error_norm_m', 'hold_speed_norm_m_s')  # at one state, the bound is the norm


@dataclass(frozen=True)
class Conditions:
    """Conditions of the flights of a scenario.

    keys : requirements that the search sees; columns, windows : where; limits : (k,)
    unseen : requirements that it does not see
    exact : whether the search sees all of them, and their exact values
    arrival_m : error of an axis that counts as arrived
    late_s : window -> its length
    """

    keys: tuple[str, ...]
    columns: tuple[int, ...]
    windows: tuple[str, ...]
    limits: Floats
    unseen: tuple[str, ...]
    exact: bool
    arrival_m: float
    late_s: dict[str, float]

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the conditions, as progress and provenance show them."""
        return tuple(map(label, self.keys))

    def values(self, rows: dict[str, Floats]) -> Floats:
        """Return what is judged (..., k) of metrics (..., columns), by window."""
        if not self.keys:
            return np.empty((*rows[JUDGED].shape[:-1], 0))
        found = [rows[w][..., c] for w, c in zip(self.windows, self.columns, strict=True)]
        return np.stack(found, axis=-1)


def label(key: str) -> str:
    """Return the short name of a requirement."""
    return LABELS.get(key, key)


def conditions_of(base: Scenario) -> Conditions:
    """Return the conditions of a scenario."""
    required = base.requirements or PAPER
    limits = dict(required.limits)
    keys = tuple(key for key in _COLUMNS if key in limits)
    if 'hold_force_per_disturbance' in limits:
        level_n = float(np.abs(base.disturbance.over(base.times_s)).max())
        limits['hold_force_per_disturbance'] *= level_n
    arrival_m, exact_arrival = _arrival_m(required)
    if 'arrival_time_s' in limits:  # a flight that never arrives counts as its duration
        limits['arrival_time_s'] = min(limits['arrival_time_s'], base.duration_s - base.dt_s)
    late_s = {JUDGED: base.duration_s, FINAL: base.dt_s}
    if required.hold_from_s is not None:
        late_s[HOLD] = base.duration_s - required.hold_from_s
    if late_s.get(HOLD, 1.0) <= 0.0:  # the flight ends before; it is not judged by these
        keys = tuple(key for key in keys if _COLUMNS[key][1] != HOLD)
    unseen = tuple(key for key in required.limits if key not in _COLUMNS)
    columns, windows = zip(*(_COLUMNS[key] for key in keys), strict=True) if keys else ((), ())
    bound = any(key in _BOUNDS for key in keys) or not exact_arrival
    return Conditions(
        keys,
        columns,
        windows,
        np.array([limits[key] for key in keys]),
        unseen,
        not (unseen or bound),
        arrival_m,
        late_s,
    )


def _arrival_m(required: Requirements) -> tuple[float, bool]:
    """Return the error of an axis that counts as arrived, and whether that is what is required."""
    if required.arrival_error_per_axis_m is not None:
        return required.arrival_error_per_axis_m, True
    if required.arrival_error_norm_m is not None:
        return required.arrival_error_norm_m / sqrt(3.0), False
    return metrics.MAX_ARRIVAL_DISTANCE_M, True
