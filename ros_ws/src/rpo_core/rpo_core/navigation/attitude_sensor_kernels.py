# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What a star tracker and a gyro measure: + - * / sqrt and comparisons, in the order written.

Random numbers are functions of (tick, stream, key), as in `sensor_kernels`; their streams are none
of its sensors'.
"""

from __future__ import annotations

from math import sqrt
from typing import Any

from rpo_core.attitude.attitude_kernels import Attitude
from rpo_core.attitude.chaser_kernels import Quaternion, relative_to, times, turn, upright
from rpo_core.kernels.arithmetic import Vector
from rpo_core.kernels.jit import inlined, kernel
from rpo_core.navigation.sensor_kernels import three_normals

KEY, SLOTS, PERIOD, LATENCY, CROSS, ROLL, AXES = 0, 2, 3, 4, 5, 6, 7
GYRO, WALK, BIAS, LIGHT, COSINE, COUNT, OUTAGES = 16, 17, 18, 21, 24, 25, 26
"""Places in the table of `sense_attitude`. Key (2,); slots of the queue; of the star tracker period
and latency [ticks], sigma across its boresight and about it [rad], its axes (3, 3) in those of the
chaser, boresight first; of the gyro sigma and walk of a tick [rad/s], bias (3,) at tick 0; a
direction (3,) in LVLH that blinds, and the cosine of its half angle, 2 for none; how many numbers
the outages have; they, in ticks, first and end of each."""

MEASURED = 7
"""Numbers of a measurement: quaternion of the star tracker, 0, 0, 0, 0 for none; rate [rad/s]."""

DRIFT, WALKED, NOISE, QUEUE, QUEUED = 7, 10, 11, 20, 5
"""Places in its memory, after the measurement: the part (3,) of the bias that walked, the tick up
to which; the noise (9,) of this tick; then quaternions on their way, each with its tick."""

Noise = tuple[float, float, float, float, float, float, float, float, float]

START_STREAM, _STARS, _RATES, _WALKS = range(128, 132)


@inlined
def turned_by(q: Quaternion, e: Vector) -> Quaternion:
    """Return an attitude turned by twice the vector part (3,) of a quaternion; w >= 0."""
    x, y, z = 0.5 * e[0], 0.5 * e[1], 0.5 * e[2]
    rest = 1.0 - (x * x + y * y + z * z)
    return upright(times(q, (x, y, z, sqrt(rest) if rest > 0.0 else 0.0)))


@inlined
def angles_between(truth: Any, estimate: Any) -> Vector:
    """Return the angles (3,) [rad] from estimated to true axes: twice a vector part."""
    p = (estimate[0], estimate[1], estimate[2], estimate[3])
    x, y, z, w = relative_to(p, (truth[0], truth[1], truth[2], truth[3]))
    sign = 2.0 if w >= 0.0 else -2.0
    return sign * x, sign * y, sign * z


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
    a, b, c = three_normals(tick, 0, _STARS, k0, k1)
    d, e, f = three_normals(tick, 0, _RATES, k0, k1)
    g, h, i = three_normals(tick, 0, _WALKS, k0, k1)
    return a, b, c, d, e, f, g, h, i


@kernel
def sense_attitude(tick: int, a: Attitude, s: Any, m: Any) -> None:
    """Fill the measurement (7,) that arrives at a tick; see `sensed_attitude`."""
    noise = attitude_noise(tick, int(s[KEY]), int(s[KEY + 1]))
    for i in range(9):
        m[NOISE + i] = noise[i]
    sensed_attitude(tick, a, s, m)


@kernel
def sensed_attitude(tick: int, a: Attitude, s: Any, m: Any) -> None:
    """Fill the measurement (7,) that arrives at a tick, with the noise that the memory has.

    a : true attitude; s : table, m : memory, see the names of their places
    """
    while s[WALK] > 0.0 and m[WALKED] < tick:
        m[WALKED] += 1.0
        steps = (m[NOISE + 6], m[NOISE + 7], m[NOISE + 8])
        if m[WALKED] < tick:
            steps = three_normals(int(m[WALKED]), 0, _WALKS, int(s[KEY]), int(s[KEY + 1]))
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
