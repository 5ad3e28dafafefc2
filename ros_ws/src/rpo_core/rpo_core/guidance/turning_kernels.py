# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Legs in the axes of a target that turns, as references and forces in target LVLH.

+ - * / in a fixed order, interpreted or compiled with the same bits.
"""

from __future__ import annotations

from typing import Any

from rpo_core.attitude.attitude_kernels import Frame, acceleration_with, frame_at, moving_with
from rpo_core.guidance.transfer_kernels import Floats
from rpo_core.kernels.arithmetic import State, Vector
from rpo_core.kernels.jit import inlined, kernel


@inlined
def force_for(state: State, acceleration: Vector, n: float, m: float) -> Vector:
    """Return the force (3,) [N] for an acceleration (3,) [m/s^2] in a state of target LVLH.

    n : mean motion [rad/s]; m : mass [kg]
    """
    x, _, z, vx, vy, _ = state
    ax, ay, az = acceleration
    return (
        m * (ax - 3.0 * n * n * x - 2.0 * n * vy),
        m * (ay + 2.0 * n * vx),
        m * (az + n * n * z),
    )


@inlined
def turned(t: Any, now: Frame, half: Frame, n: float, m: float) -> tuple[State, Vector]:
    """Return state and force (3,) [N] in target LVLH of a moment that the turning target sees.

    t : (15,) state, and state and acceleration half a tick later; now, half : axes of the target
    """
    state = moving_with((t[0], t[1], t[2], t[3], t[4], t[5]), now)
    later = (t[6], t[7], t[8], t[9], t[10], t[11])
    acceleration = acceleration_with(later, (t[12], t[13], t[14]), half)
    return state, force_for(moving_with(later, half), acceleration, n, m)


@kernel
def turn_rows(
    table: Floats, frames: Floats, halves: Floats, n: float, m: float, rows: Floats
) -> None:
    """Fill rows (n, 9) with states and forces of a leg that the turning target sees.

    table : (n, 15) as `turned` reads them; frames, halves : (n, 15) of the target at these moments
    """
    for i in range(len(rows)):
        state, force = turned(table[i], frame_at(frames[i], 0), frame_at(halves[i], 0), n, m)
        for j in range(6):
            rows[i, j] = state[j]
        for j in range(3):
            rows[i, 6 + j] = force[j]
