# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Flights inside a proof: the core's own kernels, tick by tick. Kernels."""

from __future__ import annotations

from typing import Any

from rpo_core.kernels import CwStep, fuzzy_force, plant_step
from rpo_montecarlo.engine.lanes import compiled


@compiled
def fly(
    scales: Any, fis: Any, limit: float, step: CwStep, disturbances: Any, states: Any, forces: Any
) -> None:
    """Fill the states (N+1, 6) after the first, and the commands (N+1, 3) [N], of a flight.

    disturbances : (N+1, 3) [N]; the bits are those of `rpo_core.chain.flight.fly`
    """
    for tick in range(len(forces)):
        s, d = states[tick], disturbances[tick]
        state = (s[0], s[1], s[2], s[3], s[4], s[5])
        command = fuzzy_force(state, scales, fis)
        for i in range(3):
            forces[tick, i] = command[i]
        if tick + 1 < len(states):
            new = plant_step(state, command, (d[0], d[1], d[2]), limit, step)
            for i in range(6):
                states[tick + 1, i] = new[i]
