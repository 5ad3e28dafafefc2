# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The least-energy law of a free mass, by the paper's numbers: where searches of families begin.

With the time to go T, the force towards the target at a distance d and a closing speed c is
6 m d / T^2 - 4 m c / T (Bryson and Ho, Applied Optimal Control, 1975). A law without a clock infers
T from what it sees (`time_to_go_s`). No number here comes from a search.
"""

from __future__ import annotations

from math import log, sqrt

from rpo_core.control.baselines import PAPER_MODEL
from rpo_core.scenario.requirements import ARRIVAL_WINDOW_S, MAX_ARRIVAL_DISTANCE_M

FLIGHT_S, RANGE_M = 200.0, 100.0
"""Of the paper's training: the length of a flight, and the farthest start of an axis."""

ARRIVAL_S = FLIGHT_S - ARRIVAL_WINDOW_S
"""The chaser is judged by its mean over the window; so it shall have arrived before."""

SPEED_M_S = 1.5 * RANGE_M / ARRIVAL_S
"""The largest speed of the least-energy approach from the farthest start."""

LEAD_S = ARRIVAL_S / 8.0
LEAST_S = ARRIVAL_WINDOW_S / 2.0
"""The least time to go T: with its gains an error decays as exp(-2 t / T), to 2 % in a window."""

_GROWTH = log(ARRIVAL_S / LEAST_S) / log(RANGE_M / MAX_ARRIVAL_DISTANCE_M)


def gains(time_to_go_s: float) -> tuple[float, float]:
    """Return the gains of position [N/m] and velocity [N s/m] with a time to go."""
    mass_kg = PAPER_MODEL.mass_kg
    return 6.0 * mass_kg / time_to_go_s**2, 4.0 * mass_kg / time_to_go_s


def time_from_rest_s(distance_m: float) -> float:
    """Return the time that an approach from rest takes.

    A power of the distance: the least time from the largest error that is allowed, or less; all
    the time there is from the farthest start.
    """
    share = max(distance_m / MAX_ARRIVAL_DISTANCE_M, 1.0)
    return float(LEAST_S * share**_GROWTH)


def time_to_go_s(distance_m: float, closing_m_s: float) -> float:
    """Return the time to go that distance and closing speed imply, at least `LEAST_S`.

    The approach from rest in a time T has c T / d = 6 s / ((1 - s) (1 + 2 s)) at t = s T; T is that
    from rest at the distance that a lead of `LEAD_S` adds to.
    """
    whole_s = time_from_rest_s(distance_m + LEAD_S * abs(closing_m_s))
    if closing_m_s <= 0.0:
        return whole_s
    if distance_m == 0.0:
        return LEAST_S
    pace = closing_m_s * whole_s / distance_m
    gone = (pace - 6.0 + sqrt((pace - 6.0) ** 2 + 8.0 * pace * pace)) / (4.0 * pace)
    return max(whole_s * (1.0 - gone), LEAST_S)


def pull_n(distance_m: float, closing_m_s: float) -> float:
    """Return the force towards the target."""
    k, d = gains(time_to_go_s(distance_m, closing_m_s))
    return k * distance_m - d * closing_m_s


def geometric(least: float, most: float, count: int) -> tuple[float, ...]:
    """Return numbers with equal ratios."""
    return tuple(least * (most / least) ** (i / (count - 1)) for i in range(count))
