# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The plans behind the model predictive controller, and how often a limit binds.

The controller uses the closed form of its quadratic program. That is the solution where the
planned forces keep the limits of force and slew. This module computes whole plans, and counts how
many keep them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.judge.metrics import MAX_SLEW_N_S
from rpo_ctrl.baselines import Mpc
from rpo_judge.evaluation.optimal import reach_of

Floats = NDArray[np.float64]


class Peaks(NamedTuple):
    """The largest forces of some plans.

    plans : number of plans; within : how many keep both limits
    force_n, slew_per_axis_n_s : largest |f| and |df/dt| of an axis in any of them
    """

    plans: int
    within: int
    force_n: float
    slew_per_axis_n_s: float


def ticks_to_go(mpc: Mpc, tick: int) -> int:
    """Return the ticks that a plan made at `tick` has left."""
    dt = mpc.model.dt_s
    return max(round(mpc.horizon_s / dt) - tick, round(mpc.least_time_to_go_s / dt))


def plans(mpc: Mpc, states: Floats, tick: int) -> Floats:
    """Return the planned forces (n, ticks to go, 3) [N] from states (n, 6) at a tick.

    Least energy to rest at the origin in the time to go: f_k = -reach_k' W^-1 A^N x.
    """
    a, b = mpc.model.matrices()
    reach, drift = reach_of(a, b, ticks_to_go(mpc, tick))
    gramian = np.einsum('kij,klj->il', reach, reach)
    scale = np.sqrt(np.diag(gramian))  # metres beside metres per second
    multipliers = np.linalg.solve(gramian / np.outer(scale, scale), (states @ drift.T / scale).T)
    return -np.einsum('kij,in->nkj', reach, multipliers / scale[:, None])


def peaks_of(planned: Floats, mpc: Mpc) -> tuple[int, float, float]:
    """Return how many plans (n, ticks, 3) keep the limits, the largest |f| [N], |df/dt| [N/s]."""
    largest = np.abs(planned).max(axis=(1, 2))
    steepest = np.abs(np.diff(planned, axis=1)).max(axis=(1, 2)) / mpc.model.dt_s
    within = (largest <= mpc.max_force_n) & (steepest <= MAX_SLEW_N_S)
    return int(within.sum()), float(largest.max()), float(steepest.max())


def peaks(mpc: Mpc, states: Floats, every: int) -> Peaks:
    """Return the peaks of the plans made at each `every`-th tick of some flights.

    states : (flights, ticks, 6), the inputs of the controller
    """
    count = within = 0
    force = slew = 0.0
    for tick in range(0, states.shape[1], every):
        kept, largest, steepest = peaks_of(plans(mpc, states[:, tick], tick), mpc)
        count, within = count + len(states), within + kept
        force, slew = max(force, largest), max(slew, steepest)
    return Peaks(count, within, force, slew)
