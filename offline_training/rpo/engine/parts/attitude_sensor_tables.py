# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Star trackers and gyros of flights side by side, in flat tables.

The arithmetic is that of `rpo_core.navigation.attitude_sensors`, with the same bits. This module
goes with the engine.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rpo_core.attitude.attitude_kernels import Attitude
from rpo_core.attitude.chaser import turn
from rpo_core.attitude.target import Quaternion
from rpo_core.kernels.arithmetic import Vector
from rpo_core.kernels.jit import as_table, inlined, kernel
from rpo_core.navigation.attitude_sensors import (
    RATES,
    STARS,
    WALKS,
    AttitudeSensors,
    suite_of,
    turned_by,
)
from rpo_core.navigation.sensors import three_normals

KEY, SLOTS, PERIOD, LATENCY, CROSS, ROLL, AXES = 0, 2, 3, 4, 5, 6, 7
GYRO, WALK, BIAS, LIGHT, COSINE, COUNT, OUTAGES = 16, 17, 18, 21, 24, 25, 26
"""Places in the table of `sensed_attitude`. Key (2,); slots of the queue; of the star tracker
period and latency [ticks], sigma across its boresight and about it [rad], its axes (3, 3) in those
of the chaser, boresight first; of the gyro sigma and walk of a tick [rad/s], bias (3,) at tick 0; a
direction (3,) in LVLH that blinds, and the cosine of its half angle, 2 for none; how many numbers
the outages have; they, in ticks, first and end of each."""

MEASURED = 7
"""Numbers of a measurement: quaternion of the star tracker, 0, 0, 0, 0 for none; rate [rad/s]."""

DRIFT, WALKED, NOISE, QUEUE, QUEUED = 7, 10, 11, 20, 5
"""Places in its memory, after the measurement: the part (3,) of the bias that walked, the tick up
to which; the noise (9,) of this tick; then quaternions on their way, each with its tick."""

Noise = tuple[float, float, float, float, float, float, float, float, float]


@inlined
def along(s: Any, i: int, first: float, second: float, third: float) -> Vector:
    """Return a vector that has these parts along three axes, from place i of a table on."""
    return (
        first * s[i] + second * s[i + 3] + third * s[i + 6],
        first * s[i + 1] + second * s[i + 4] + third * s[i + 7],
        first * s[i + 2] + second * s[i + 5] + third * s[i + 8],
    )


@inlined
def _sees(tick: int, q: Quaternion, s: Any) -> bool:
    """Return whether the star tracker measures: its period, no outage [begin, end), no light."""
    found = tick % int(s[PERIOD]) == 0
    for i in range(OUTAGES, OUTAGES + int(s[COUNT]), 2):
        found = found and not s[i] <= tick < s[i + 1]
    x, y, z = turn((s[AXES], s[AXES + 1], s[AXES + 2]), q)
    return found and x * s[LIGHT] + y * s[LIGHT + 1] + z * s[LIGHT + 2] < s[COSINE]


@inlined
def attitude_noise(tick: int, k0: int, k1: int) -> Noise:
    """Return nine normals: of the star tracker, the gyro, the walk of its bias."""
    a, b, c = three_normals(tick, 0, STARS, k0, k1)
    d, e, f = three_normals(tick, 0, RATES, k0, k1)
    g, h, i = three_normals(tick, 0, WALKS, k0, k1)
    return a, b, c, d, e, f, g, h, i


@kernel
def sensed_attitude(tick: int, a: Attitude, s: Any, m: Any) -> None:
    """Fill the measurement (7,) that arrives at a tick, with the noise that the memory has.

    a : true attitude; s : table, m : memory, see the names of their places
    """
    while s[WALK] > 0.0 and m[WALKED] < tick:
        m[WALKED] += 1.0
        steps = (m[NOISE + 6], m[NOISE + 7], m[NOISE + 8])
        if m[WALKED] < tick:
            steps = three_normals(int(m[WALKED]), 0, WALKS, int(s[KEY]), int(s[KEY + 1]))
        for i in range(3):
            m[DRIFT + i] += s[WALK] * steps[i]
    for i in range(3):
        m[4 + i] = a[4 + i] + s[BIAS + i] + m[DRIFT + i] + s[GYRO] * m[NOISE + 3 + i]
    q = (a[0], a[1], a[2], a[3])
    slots = int(s[SLOTS])
    slot = QUEUE + QUEUED * (tick % slots)
    m[slot], m[slot + 1], m[slot + 2], m[slot + 3] = 0.0, 0.0, 0.0, 0.0
    m[slot + 4] = float(tick)
    if _sees(tick, q, s):
        n0, n1, n2 = s[ROLL] * m[NOISE], s[CROSS] * m[NOISE + 1], s[CROSS] * m[NOISE + 2]
        error = along(s, AXES, n0, n1, n2)
        m[slot], m[slot + 1], m[slot + 2], m[slot + 3] = turned_by(q, error)
    taken = tick - int(s[LATENCY])
    slot = QUEUE + QUEUED * (taken % slots)
    came = taken >= 0 and m[slot + 4] == taken
    for i in range(4):
        m[i] = m[slot + i] if came else 0.0


class AttitudeSensing:
    """Sensors and their memory, the tables of `sensed_attitude`."""

    def __init__(self, settings: AttitudeSensors, scenario: Any) -> None:
        p = suite_of(settings, scenario)
        slots, ticks = p.latency + 1, [tick for pair in p.outages for tick in pair]
        self.table = as_table(
            [
                *(*p.key, slots, p.period, p.latency, p.cross, p.roll, *np.ravel(p.axes)),
                *(p.gyro, p.walk, *p.bias, *p.light, p.cosine, len(ticks), *ticks),
            ]
        )
        self.memory = as_table([0.0] * QUEUE + [0.0, 0.0, 0.0, 0.0, -1.0] * slots)
