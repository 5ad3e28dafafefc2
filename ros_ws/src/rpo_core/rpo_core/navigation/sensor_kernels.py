# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What sensors measure, number by number: + - * / sqrt and comparisons, in the order written.

A sensor is a row of floats; the names below are its columns. Random numbers are functions of
(tick, stream, key), so a measurement is a function of them and of the true state.
"""

from __future__ import annotations

from math import nan, sqrt
from typing import Any

from rpo_core.attitude.chaser_kernels import Quaternion, turn_back
from rpo_core.kernels.arithmetic import State, Vector
from rpo_core.kernels.jit import inlined, kernel
from rpo_core.kernels.noise import normal_pair, philox
from rpo_core.kernels.vectors import pick

(
    NOISE_FLOOR, NOISE_SHARE, CROSS_SHARE, VELOCITY_FLOOR, VELOCITY_SHARE, HAS_RANGE, HAS_VELOCITY,
    BIAS_X, BIAS_Y, BIAS_Z, WALK, SCALE, PERIOD, LATENCY, DROPOUT, OUTLIER, OUTLIER_SIZE,
    COSINE, AXIS_X, AXIS_Y, AXIS_Z, BIAS_VX, BIAS_VY, BIAS_VZ, TURNS, LOOKS,
) = range(26)  # fmt: skip
"""Columns of a sensor. CROSS_SHARE is that of the noise across the line of sight. DROPOUT and
OUTLIER are bounds of a random word of 32 bits. COSINE is that of the half angle of the field of
view, -2 if there is no limit. TURNS is 1 where all is in the chaser's axes, LOOKS is 1 where the
sensor looks at the port."""

COLUMNS = 26

MEASURED = 7
"""Numbers of a measurement: 1 or 0 for none, position [m] (a unit vector without range), velocity
[m/s]."""

NO_DIRECTION_M = 1e-9
"""Closer to the target than this, the line of sight is taken to be along V-bar."""

SENSORS, SLOTS, OUTAGES, KEY, UNITS = 0, 1, 2, 3, 5
"""Places in the table of `sense`: how many sensors, slots of a queue, and numbers of the outages of
a sensor; the key (2,); the columns of the first sensor."""

FIRST, SECOND, OUTLYING, WALKING = range(4)  # blocks of random words of a tick

NOISE = 8
Noise = tuple[float, float, float, float, float, float, float, float]


@inlined
def larger(floor: float, value: float) -> float:
    """Return the larger one of two numbers."""
    return value if value > floor else floor


@inlined
def sight(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Return the distance [m] of a point, and its direction (3,)."""
    distance = sqrt(x * x + y * y + z * z)
    if distance < NO_DIRECTION_M:
        return distance, 0.0, 1.0, 0.0
    return distance, x / distance, y / distance, z / distance


@inlined
def across(ux: float, uy: float, uz: float) -> tuple[Vector, Vector]:
    """Return two unit vectors that form a right-handed frame with a unit vector.

    The first is at right angles to the axis that is farthest from the vector. Of a vector of zeros,
    as `sight` has where the distance overflows, they are no numbers.
    """
    sx, sy, sz = abs(ux), abs(uy), abs(uz)
    no_z = sy <= sz
    no_x = sx <= pick(no_z, sy, sz)
    ax = pick(no_x, 0.0, pick(no_z, -uz, uy))
    ay = pick(no_x, uz, pick(no_z, 0.0, -ux))
    az = pick(no_x, -uy, pick(no_z, ux, 0.0))
    size = sqrt(ax * ax + ay * ay + az * az)
    size = pick(size > 0.0, size, nan)  # interpreted, a division by zero raises
    ax, ay, az = ax / size, ay / size, az / size
    return (ax, ay, az), (uy * az - uz * ay, uz * ax - ux * az, ux * ay - uy * ax)


@inlined
def four_words(tick: int, block: int, stream: int, k0: int, k1: int) -> tuple[int, int, int, int]:
    """Return four random words of a block of a tick of a stream."""
    return philox(tick, block, stream, 0, k0, k1)


@inlined
def three_normals(tick: int, block: int, stream: int, k0: int, k1: int) -> Vector:
    """Return three independent standard normals of a block of a tick of a stream."""
    a, b, c, d = four_words(tick, block, stream, k0, k1)
    n0, n1 = normal_pair(a, b)
    n2, _ = normal_pair(c, d)
    return n0, n1, n2


@kernel
def is_due(tick: int, sensor: Any, s: Any, first: int) -> bool:
    """Return whether a sensor measures at a tick: its period, and no outage [begin, end).

    s : table of `sense`, with the outages of the sensor from place `first`
    """
    due = tick % int(sensor[PERIOD]) == 0
    for i in range(first, first + int(s[OUTAGES]), 2):
        due = due and not s[i] <= tick < s[i + 1]
    return due


@inlined
def looks(ux: float, uy: float, uz: float, axis: Vector, cosine: float) -> bool:
    """Return whether the target is in the field of view; u points from the target to the chaser."""
    away = ux * axis[0] + uy * axis[1] + uz * axis[2]
    return bool(-away >= cosine)


@inlined
def scattered(
    point: Vector, normals: Vector, floor: float, share: float, cross_share: float, scale: float
) -> Vector:
    """Return a point (3,) [m] as it is measured: scaled, with noise along and across the sight."""
    x, y, z = point
    distance, ux, uy, uz = sight(x, y, z)
    along = larger(floor, share * distance) * normals[0]
    cross = larger(floor, cross_share * distance)
    (ax, ay, az), (bx, by, bz) = across(ux, uy, uz)
    first, second = cross * normals[1], cross * normals[2]
    return (
        x * scale + (ux * along + ax * first + bx * second),
        y * scale + (uy * along + ay * first + by * second),
        z * scale + (uz * along + az * first + bz * second),
    )


@inlined
def noise_of(tick: int, stream: int, k0: int, k1: int) -> Noise:
    """Return the noise of a sensor at a tick: four normals, then four random words."""
    a, b, c, d = four_words(tick, FIRST, stream, k0, k1)
    e, f, dropped, outlying = four_words(tick, SECOND, stream, k0, k1)
    n0, n1 = normal_pair(a, b)
    n2, n3 = normal_pair(c, d)
    return n0, n1, n2, n3, float(e), float(f), float(dropped), float(outlying)


@inlined
def noise_at(s: Any) -> int:
    """Return the place in the memory of `sense` of the noise of the first sensor."""
    return int(s[SENSORS]) * (MEASURED + 4 + (MEASURED + 1) * int(s[SLOTS]))


@inlined
def port_at(s: Any) -> int:
    """Return the place in the memory of `sense` of the port (3,) [m] at this tick, target LVLH."""
    return noise_at(s) + NOISE * int(s[SENSORS])


@kernel
def sample(
    tick: int,
    state: State,
    sensor: Any,
    stream: int,
    key: tuple[float, float],
    walk: int,
    noise: int,
    m: Any,
    at: int,
) -> None:
    """Fill the measurement (7,) of a true state, from place `at` of the memory of `sense`.

    walk : place in the memory of the part (3,) [m] of the bias that is a random walk
    noise : place in the memory of what `noise_of` returns

    The noise has one sigma along the line of sight, another across it; both grow with distance.
    """
    m[at] = 0.0
    x = state[0] + sensor[BIAS_X] + m[walk]
    y = state[1] + sensor[BIAS_Y] + m[walk + 1]
    z = state[2] + sensor[BIAS_Z] + m[walk + 2]
    distance, ux, uy, uz = sight(x, y, z)
    axis = (sensor[AXIS_X], sensor[AXIS_Y], sensor[AXIS_Z])
    if not looks(ux, uy, uz, axis, sensor[COSINE]):
        return
    if m[noise + 6] < sensor[DROPOUT]:
        return
    n0, n1, n2, n3 = m[noise], m[noise + 1], m[noise + 2], m[noise + 3]
    floor, share, cross = sensor[NOISE_FLOOR], sensor[NOISE_SHARE], sensor[CROSS_SHARE]
    x, y, z = scattered((x, y, z), (n0, n1, n2), floor, share, cross, sensor[SCALE])
    if m[noise + 7] < sensor[OUTLIER]:
        ox, oy, oz = three_normals(tick, OUTLYING, stream, int(key[0]), int(key[1]))
        size = sensor[OUTLIER_SIZE]
        x, y, z = x + size * ox, y + size * oy, z + size * oz
    if sensor[HAS_RANGE] == 0.0:
        _, x, y, z = sight(x, y, z)
    m[at], m[at + 1], m[at + 2], m[at + 3] = 1.0, x, y, z
    m[at + 4], m[at + 5], m[at + 6] = 0.0, 0.0, 0.0
    if sensor[HAS_VELOCITY] != 0.0:
        n4, n5 = normal_pair(int(m[noise + 4]), int(m[noise + 5]))
        sigma = larger(sensor[VELOCITY_FLOOR], sensor[VELOCITY_SHARE] * distance)
        m[at + 4] = state[3] + sensor[BIAS_VX] + sigma * n3
        m[at + 5] = state[4] + sensor[BIAS_VY] + sigma * n4
        m[at + 6] = state[5] + sensor[BIAS_VZ] + sigma * n5


@kernel
def sense(tick: int, state: State, q: Quaternion, s: Any, m: Any) -> None:
    """Fill the measurements that arrive at a tick, `MEASURED` of each sensor: `sensed`."""
    k0, k1 = int(s[KEY]), int(s[KEY + 1])
    for i in range(int(s[SENSORS])):
        if tick % int(s[UNITS + COLUMNS * i + PERIOD]) == 0:
            noise = noise_of(tick, i + 1, k0, k1)
            for j in range(NOISE):
                m[noise_at(s) + NOISE * i + j] = noise[j]
    sensed(tick, state, q, s, m)


@kernel
def sensed(tick: int, state: State, q: Quaternion, s: Any, m: Any) -> None:
    """Fill the measurements that arrive at a tick, with the noise that the memory has.

    q : true attitude of the chaser
    s : table, its places SENSORS and others, then columns of each sensor, then its outages, in
        ticks, first and end of each
    m : memory: the measurements, from 0; of each sensor, the random walk of its bias (3,) [m], and
        the tick up to which it is summed; then measurements on their way, each with its tick; then
        the noise of each sensor at this tick, if its period lets it measure; then the port at it
    """
    count, slots, key = int(s[SENSORS]), int(s[SLOTS]), (s[KEY], s[KEY + 1])
    for i in range(count):
        sensor = s[UNITS + COLUMNS * i : UNITS + COLUMNS * (i + 1)]
        walk = MEASURED * count + 4 * i
        while sensor[WALK] > 0.0 and m[walk + 3] < tick:
            m[walk + 3] += 1.0
            at = int(m[walk + 3])
            n0, n1, n2 = three_normals(at, WALKING, i + 1, int(key[0]), int(key[1]))
            m[walk] += sensor[WALK] * n0
            m[walk + 1] += sensor[WALK] * n1
            m[walk + 2] += sensor[WALK] * n2
        queue = (MEASURED + 4) * count + (MEASURED + 1) * slots * i
        slot = queue + (MEASURED + 1) * (tick % slots)
        m[slot], m[slot + MEASURED] = 0.0, float(tick)
        if is_due(tick, sensor, s, UNITS + COLUMNS * count + int(s[OUTAGES]) * i):
            seen = state
            if sensor[LOOKS] != 0.0:
                p = port_at(s)
                x, y, z = state[0] - m[p], state[1] - m[p + 1], state[2] - m[p + 2]
                seen = (x, y, z, 0.0, 0.0, 0.0)
            if sensor[TURNS] != 0.0:
                x, y, z = turn_back((seen[0], seen[1], seen[2]), q)
                seen = (x, y, z, 0.0, 0.0, 0.0)
            noise = noise_at(s) + NOISE * i
            sample(tick, seen, sensor, i + 1, key, walk, noise, m, slot)
        taken = tick - int(sensor[LATENCY])
        found, out = queue + (MEASURED + 1) * (taken % slots), MEASURED * i
        m[out] = 0.0
        if taken >= 0 and m[found + MEASURED] == taken:
            for j in range(MEASURED):
                m[out + j] = m[found + j]


@kernel
def describe(sensor: Any, measured: Any, out: Any) -> None:
    """Fill the numbers (24,) of a measurement's message.

    Position, velocity, and the covariance of each (rows of 3 x 3) as the sensor claims it, from the
    distance measured. As in sensor_msgs/Imu, a covariance that begins with -1 means: not measured.
    """
    for j in range(24):
        out[j] = 0.0
    out[6], out[15] = -1.0, -1.0
    if measured[0] == 0.0:
        return
    for j in range(6):
        out[j] = measured[j + 1]
    distance, ux, uy, uz = sight(out[0], out[1], out[2])
    along = larger(sensor[NOISE_FLOOR], sensor[NOISE_SHARE] * distance)
    cross = larger(sensor[NOISE_FLOOR], sensor[CROSS_SHARE] * distance)
    if sensor[HAS_RANGE] == 0.0:
        along, cross = 0.0, sensor[CROSS_SHARE]
    u = (ux, uy, uz)
    for row in range(3):
        for column in range(3):
            one = 1.0 if row == column else 0.0
            shared = u[row] * u[column]
            out[6 + 3 * row + column] = along * along * shared + cross * cross * (one - shared)
    if sensor[HAS_VELOCITY] != 0.0:
        sigma = larger(sensor[VELOCITY_FLOOR], sensor[VELOCITY_SHARE] * distance)
        for row in range(3):
            for column in range(3):
                out[15 + 3 * row + column] = sigma * sigma if row == column else 0.0


@kernel
def measured(truth: float, bias: float, sigma: float, normal: float) -> float:
    """Component of the navigation solution: truth plus bias plus white noise."""
    return truth + bias + sigma * normal
