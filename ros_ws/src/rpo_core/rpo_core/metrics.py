# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Metrics of a flight: energy J, training's conditions, window statistics, the paper's claims."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.flight import Flight
from rpo_core.scenario import Scenario

PENALTY = 100.0
"""Added to J [N^2 s] for each condition not met."""

ARRIVAL_WINDOW_S = 30.0
MAX_ARRIVAL_SPEED_M_S = 0.05
MAX_SLEW_N_S = 0.1
MAX_ARRIVAL_DISTANCE_M = 0.5
"""Ours: without it doing nothing is nearly optimal (the paper says 'to reach the target')."""

CLAIM_WINDOW_S = 200.0
CLAIM_POSITION_M, CLAIM_VELOCITY_M_S = 0.5, 0.01
TRAINING_CLAIM_WINDOW_S = 50.0


def window_ticks(scenario: Scenario, window_s: float) -> int:
    """Return how many last states, or forces, make up `window_s`; at most all but the start."""
    return min(scenario.ticks, max(1, round(window_s / scenario.dt_s)))


@dataclass(frozen=True)
class Metrics:
    """What a flight is judged by.

    energy_n2s : J = integral of f.f dt over the forces flown
    arrival_speed_m_s, arrival_distance_m : mean norms of velocity, position over the last 30 s
    slew_n_s : max over ticks and axes of |f_k - f_(k-1)| / dt; the step from rest is not counted
    """

    energy_n2s: float
    arrival_speed_m_s: float
    slew_n_s: float
    arrival_distance_m: float

    @property
    def conditions(self) -> tuple[bool, bool, bool]:
        """Whether speed, slew (the paper's two) and arrival (ours) are met."""
        return (
            self.arrival_speed_m_s <= MAX_ARRIVAL_SPEED_M_S,
            self.slew_n_s <= MAX_SLEW_N_S,
            self.arrival_distance_m <= MAX_ARRIVAL_DISTANCE_M,
        )

    @property
    def fitness(self) -> float:
        """J plus the flat penalty of each condition not met."""
        return self.energy_n2s + PENALTY * self.conditions.count(False)


def slew_n_s(saturated_forces_n: NDArray[np.float64], dt_s: float) -> float:
    """Return the largest |df/dt| [N/s] between consecutive forces (N, 3); 0 for a single one."""
    steps = np.abs(np.diff(saturated_forces_n, axis=0))
    return float(steps.max() / dt_s) if steps.size else 0.0


def of_flight(flight: Flight) -> Metrics:
    """Return the metrics of a flight."""
    scenario, applied = flight.scenario, flight.saturated_forces_n
    last = window_ticks(scenario, ARRIVAL_WINDOW_S)
    return Metrics(
        energy_n2s=float((applied**2).sum() * scenario.dt_s),
        arrival_speed_m_s=float(np.linalg.norm(flight.velocities_m_s[-last:], axis=1).mean()),
        slew_n_s=slew_n_s(applied, scenario.dt_s),
        arrival_distance_m=float(np.linalg.norm(flight.positions_m[-last:], axis=1).mean()),
    )


class Window(NamedTuple):
    """Largest absolute value of any axis in the last part of a flight."""

    position_m: float
    velocity_m_s: float
    force_n: float


def window(flight: Flight, window_s: float) -> Window:
    """Return the extremes of the last `window_s` seconds."""
    last = window_ticks(flight.scenario, window_s)
    return Window(
        float(np.abs(flight.positions_m[-last:]).max()),
        float(np.abs(flight.velocities_m_s[-last:]).max()),
        float(np.abs(flight.saturated_forces_n[-last:]).max()),
    )


def disturbance_level_n(flight: Flight) -> float:
    """Return the largest |d| of any axis over the flight: the paper's level of the disturbance."""
    return float(np.abs(flight.disturbances_n).max())


class Claim(NamedTuple):
    """A statement of the paper beside what was flown."""

    statement: str
    unit: str
    paper: float
    flown: float

    @property
    def holds(self) -> bool:
        """Whether the flight does as well."""
        return self.flown <= self.paper


def claims(flight: Flight) -> list[Claim]:
    """Return the paper's claims that apply: the test's with a disturbance, else the training's.

    A flight shorter than a claim's window is judged over what there is, and the statement says so.
    """
    if flight.scenario.disturbance.is_zero:
        last, statement = _claim_window(flight.scenario, TRAINING_CLAIM_WINDOW_S)
        speed = float(np.linalg.norm(flight.velocities_m_s[-last:], axis=1).mean())
        slew = slew_n_s(flight.saturated_forces_n, flight.scenario.dt_s)
        return [
            Claim(f'mean speed, {statement}', 'm/s', 0.015, speed),
            Claim('largest |df/dt|', 'N/s', 0.0261, slew),
        ]
    _, statement = _claim_window(flight.scenario, CLAIM_WINDOW_S)
    extremes = window(flight, CLAIM_WINDOW_S)
    level = disturbance_level_n(flight)
    return [
        Claim(f'largest |position|, {statement}', 'm', CLAIM_POSITION_M, extremes.position_m),
        Claim(f'largest |velocity|, {statement}', 'm/s', CLAIM_VELOCITY_M_S, extremes.velocity_m_s),
        Claim(f'largest |force|, {statement}', 'N', level, extremes.force_n),
    ]


def _claim_window(scenario: Scenario, window_s: float) -> tuple[int, str]:
    ticks = window_ticks(scenario, window_s)
    return ticks, f'last {ticks * scenario.dt_s:g} s'
