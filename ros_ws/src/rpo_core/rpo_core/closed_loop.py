# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The closed loop as one plain function: what the nodes fly, without ROS, with the same bits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpo_core import kernels
from rpo_core.controller import FuzzyController
from rpo_core.jit import as_table
from rpo_core.scenario import Scenario


@dataclass(frozen=True)
class Flight:
    """One flight, sampled at ticks 0..N.

    states : (N+1, 6) x, y, z [m], vx, vy, vz [m/s], target LVLH
    forces_n : (N+1, 3) commanded force; that of the last state is not flown
    disturbances_n : (N+1, 3) disturbance force, held for the tick
    """

    scenario: Scenario
    states: NDArray[np.float64]
    forces_n: NDArray[np.float64]
    disturbances_n: NDArray[np.float64]

    @property
    def positions_m(self) -> NDArray[np.float64]:
        """Relative positions (N+1, 3)."""
        return self.states[:, :3]

    @property
    def velocities_m_s(self) -> NDArray[np.float64]:
        """Relative velocities (N+1, 3)."""
        return self.states[:, 3:]

    @property
    def applied_forces_n(self) -> NDArray[np.float64]:
        """Forces (N, 3) that the thrusters gave: the commands flown, saturated."""
        limit = self.scenario.max_force_n
        return np.clip(self.forces_n[:-1], -limit, limit)


def fly(scenario: Scenario, controller: FuzzyController) -> Flight:
    """Return the flight of a controller through a scenario."""
    disturbances = scenario.disturbance.over(scenario.times_s)
    states = np.empty((scenario.ticks + 1, 6))
    forces = np.empty((scenario.ticks + 1, 3))
    kernels.closed_loop(
        scenario.start,
        controller.scales,
        controller.system.tables,
        as_table(disturbances),
        scenario.max_force_n,
        scenario.step,
        states,
        forces,
    )
    return Flight(scenario, states, forces, disturbances)
