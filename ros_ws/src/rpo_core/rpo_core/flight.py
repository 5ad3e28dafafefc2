# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The closed loop as one plain function: what the nodes fly, without ROS, with the same bits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpo_core import kernels
from rpo_core.baselines import Baseline
from rpo_core.controller import Controller, FuzzyController
from rpo_core.hardware import Chaser
from rpo_core.jit import as_table
from rpo_core.scenario import Scenario


@dataclass(frozen=True)
class Flight:
    """One flight, sampled at ticks 0..N.

    states : (N+1, 6) x, y, z [m], vx, vy, vz [m/s], target LVLH
    forces_n : (N+1, 3) commanded force; those of the last states are not flown
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
        """Forces (N, 3) that the thrusters were told: commands, late where they are, saturated."""
        limit, thrusters = self.scenario.max_force_n, self.scenario.thrusters
        told = np.clip(self.forces_n[:-1], -limit, limit)
        if thrusters is None or not thrusters.delay_ticks:
            return told
        late = np.zeros_like(told)
        late[thrusters.delay_ticks :] = told[: -thrusters.delay_ticks]
        return late


def fly(scenario: Scenario, controller: Controller) -> Flight:
    """Return the flight of a controller through a scenario.

    Raises InputError if the controller counts ticks of another length than the scenario's.
    """
    if isinstance(controller, Baseline):
        controller.refuse_other_ticks(scenario.dt_s)
    disturbances = scenario.disturbance.over(scenario.times_s)
    states = np.empty((scenario.ticks + 1, 6))
    forces = np.empty((scenario.ticks + 1, 3))
    if scenario.is_ideal and isinstance(controller, FuzzyController):
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
    else:
        fly_on(Chaser(scenario), scenario, controller, 0, disturbances, states, forces)
    return Flight(scenario, states, forces, disturbances)


def fly_on(
    chaser: Chaser,
    scenario: Scenario,
    controller: Controller,
    first: int,
    disturbances: NDArray[np.float64],
    states: NDArray[np.float64],
    forces: NDArray[np.float64],
) -> None:
    """Fly any controller, thrusters and navigation from tick `first`, where the chaser is.

    disturbances (n+1, 3) are given; states (n+1, 6) and commanded forces (n+1, 3) are filled. The
    chaser is then at the last of the states, which was answered but not flown.
    """
    navigation = scenario.navigation
    last = len(disturbances) - 1
    for row, push in enumerate(disturbances.tolist()):
        states[row] = seen = chaser.state
        if navigation is not None:
            seen = navigation.solution(first + row, chaser.state)
        command = controller.force_n(seen[:3], seen[3:], first + row)
        forces[row] = command
        if row < last:
            chaser.advance(command, (push[0], push[1], push[2]))
