# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""One Clohessy-Wiltshire step, written once.

Plain functions of floats (`rpo_core.kernels.jit`), the same bits everywhere; `rpo_core.world.cw`
computes the coefficients.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpo_core.kernels.arithmetic import State, Vector, saturate
from rpo_core.kernels.jit import inlined, kernel


class CwStep(NamedTuple):
    """Coefficients of one exact CW step under a constant force (`rpo_core.world.cw.discretise`).

    `yvx` is what a velocity vx [m/s] adds to y [m], `vyfx` what a force fx [N] adds to vy [m/s];
    SI units. Coefficients that are 0, and yy, which is 1, are left out.
    """

    xx: float
    xvx: float
    xvy: float
    yx: float
    yvx: float
    yvy: float
    vxx: float
    vxvx: float
    vxvy: float
    vyx: float
    vyvx: float
    vyvy: float
    zz: float
    zvz: float
    vzz: float
    vzvz: float
    xfx: float
    xfy: float
    yfx: float
    yfy: float
    vxfx: float
    vxfy: float
    vyfx: float
    vyfy: float
    zfz: float
    vzfz: float


@inlined
def unpacked(t: Any, i: int, n: int) -> CwStep:
    """Return a step whose coefficients lie in a table from place i on, n places apart."""
    # fmt: off
    return CwStep(
        t[i], t[i + n], t[i + 2 * n], t[i + 3 * n], t[i + 4 * n], t[i + 5 * n], t[i + 6 * n],
        t[i + 7 * n], t[i + 8 * n], t[i + 9 * n], t[i + 10 * n], t[i + 11 * n], t[i + 12 * n],
        t[i + 13 * n], t[i + 14 * n], t[i + 15 * n], t[i + 16 * n], t[i + 17 * n], t[i + 18 * n],
        t[i + 19 * n], t[i + 20 * n], t[i + 21 * n], t[i + 22 * n], t[i + 23 * n], t[i + 24 * n],
        t[i + 25 * n],
    )


@inlined
def cw_step(state: State, force: Vector, c: CwStep) -> State:
    """State (x, y, z, vx, vy, vz) one step later under a constant force (fx, fy, fz) [N]."""
    x, y, z, vx, vy, vz = state
    fx, fy, fz = force
    return (
        c.xx * x + c.xvx * vx + c.xvy * vy + c.xfx * fx + c.xfy * fy,
        c.yx * x + y + c.yvx * vx + c.yvy * vy + c.yfx * fx + c.yfy * fy,
        c.zz * z + c.zvz * vz + c.zfz * fz,
        c.vxx * x + c.vxvx * vx + c.vxvy * vy + c.vxfx * fx + c.vxfy * fy,
        c.vyx * x + c.vyvx * vx + c.vyvy * vy + c.vyfx * fx + c.vyfy * fy,
        c.vzz * z + c.vzvz * vz + c.vzfz * fz,
    )


@kernel
def plant_step(
    state: State,
    command: Vector,
    disturbance: Vector,
    limit: float,
    c: CwStep,
) -> State:
    """One step of the plant: the thrusters saturate the command at `limit` [N] per axis."""
    total = (
        saturate(command[0], limit) + disturbance[0],
        saturate(command[1], limit) + disturbance[1],
        saturate(command[2], limit) + disturbance[2],
    )
    return cw_step(state, total, c)


@kernel
def cw_steps(states: Any, forces: Any, c: CwStep, following: NDArray[np.float64]) -> None:
    """Fill the state (n, 6) that follows each state (n, 6) under a force (n, 3) [N]."""
    for i in range(len(states)):
        s = states[i]
        f = forces[i]
        new = cw_step((s[0], s[1], s[2], s[3], s[4], s[5]), (f[0], f[1], f[2]), c)
        for j in range(6):
            following[i, j] = new[j]
