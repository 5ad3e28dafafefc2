# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""How far attitudes are apart, and where a chaser that has one looks: for views and reports."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from rpo_core.attitude.target import MOST_TURN_RAD, product
from rpo_core.kernels.arithmetic import Vector, norm
from rpo_core.kernels.arrays import Floats
from rpo_core.scenario.scenario import Scenario
from rpo_core.world.zones import zones_of

_BACK = np.array([-1.0, -1.0, -1.0, 1.0])
"""Times a quaternion: the attitude back."""


def turned(vectors: ArrayLike, quaternions: ArrayLike) -> Floats:
    """Return vectors (..., 3) of a body's axes, in those that its quaternions (..., 4) lead to."""
    v, q = np.asarray(vectors, np.float64), np.asarray(quaternions, np.float64)
    u = q[..., :3]
    twice = 2.0 * np.cross(u, v)
    return np.asarray(v + q[..., 3:4] * twice + np.cross(u, twice))


def errors(attitudes: ArrayLike, references: ArrayLike) -> Floats:
    """Return errors (..., 7) of attitudes (..., 7), in the axes of the body that has them.

    Quaternion from the body's axes to those of the reference, w >= 0; rate error [rad/s].
    """
    a, b = np.asarray(attitudes, np.float64), np.asarray(references, np.float64)
    ahead: Any = np.moveaxis(a[..., :4], -1, 0)
    back: Any = np.moveaxis(b[..., :4] * _BACK, -1, 0)
    e = np.stack(product(back, ahead), axis=-1)
    e = np.where(e[..., 3:] < 0.0, -e, e)
    return np.concatenate([e, a[..., 4:] - turned(b[..., 4:], e * _BACK)], axis=-1)


def apart(attitudes: ArrayLike, references: ArrayLike) -> Floats:
    """Return angle [rad] and size of the rate error [rad/s], (..., 2), of attitudes (..., 7)."""
    e = errors(attitudes, references)
    angle = 2.0 * np.arctan2(np.linalg.norm(e[..., :3], axis=-1), e[..., 3])
    return np.stack([angle, np.linalg.norm(e[..., 4:], axis=-1)], axis=-1)


def too_fast(attitudes: Floats, dt_s: float) -> str:
    """Return where a chaser turns farther in a tick than its motion is exact; '' if nowhere."""
    turns = dt_s * np.linalg.norm(attitudes[:, 4:], axis=1)
    for tick in np.flatnonzero(~(turns <= MOST_TURN_RAD))[:1].tolist():
        return (
            f'NOT exact from tick {tick} on: the chaser turns {turns[tick]:.3g} rad in a tick of '
            f'{dt_s:g} s, more than {MOST_TURN_RAD:g}'
        )
    return ''


def docking_axis(scenario: Scenario) -> Vector:
    """Return the unit vector (3,) of the chaser's axes towards the port when docked.

    Without section `pointing` it is against the first corridor, or else -y.
    """
    pointing: Any = scenario.named('pointing')
    if pointing is not None:
        x, y, z = pointing.docking_axis
        size = norm(x, y, z)
        return x / size, y / size, z / size
    cones = [zone.corridor for zone in zones_of(scenario) if zone.corridor is not None]
    x, y, z = cones[0].ahead if cones else (0.0, 1.0, 0.0)
    return -x, -y, -z
