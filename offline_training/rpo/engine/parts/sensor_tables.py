# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Sensors of flights side by side, in flat tables: eight flights in a SIMD register.

The arithmetic is that of `rpo_core.navigation.sensors`, with the same bits. This module goes with
the engine.
"""

from __future__ import annotations

from typing import Any

from rpo_core.attitude.chaser import turn_back
from rpo_core.attitude.target import Quaternion
from rpo_core.kernels.arithmetic import State
from rpo_core.kernels.jit import as_table, inlined, kernel
from rpo_core.kernels.noise import normal_pair
from rpo_core.navigation.sensors import (
    FIRST,
    OUTLYING,
    SECOND,
    WALKING,
    SensorRow,
    Sensors,
    four_words,
    larger,
    looks,
    scattered,
    sight,
    three_normals,
)

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

SENSORS, SLOTS, OUTAGES, KEY, UNITS = 0, 1, 2, 3, 5
"""Places in the table of `sensed`: how many sensors, slots of a queue, and numbers of the outages
of a sensor; the key (2,); the columns of the first sensor."""

NOISE = 8
Noise = tuple[float, float, float, float, float, float, float, float]


@kernel
def is_due(tick: int, sensor: Any, s: Any, first: int) -> bool:
    """Return whether a sensor measures at a tick: its period, and no outage [begin, end).

    s : table of `sensed`, with the outages of the sensor from place `first`
    """
    due = tick % int(sensor[PERIOD]) == 0
    for i in range(first, first + int(s[OUTAGES]), 2):
        due = due and not s[i] <= tick < s[i + 1]
    return due


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
    """Return the place in the memory of `sensed` of the noise of the first sensor."""
    return int(s[SENSORS]) * (MEASURED + 4 + (MEASURED + 1) * int(s[SLOTS]))


@inlined
def port_at(s: Any) -> int:
    """Return the place in the memory of `sensed` of the port (3,) [m] at this tick, target LVLH."""
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
    """Fill the measurement (7,) of a true state, from place `at` of the memory of `sensed`.

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


def row_of(s: SensorRow) -> list[float]:
    """Return the columns of a sensor."""
    return [
        *(s.noise_floor, s.noise_share, s.cross_share, s.velocity_floor, s.velocity_share),
        *(s.has_range, s.has_velocity, *s.bias, s.walk, s.scale, s.period, s.latency),
        *(s.dropout, s.outlier, s.outlier_size, s.cosine, *s.axis, *s.velocity_bias),
        *(s.rotates, s.at_port),
    ]


class Sensing:
    """Sensors and their memory, the tables of `sensed`."""

    def __init__(self, settings: Sensors, scenario: Any) -> None:
        rows = [unit.row(scenario) for unit in settings.units]
        self.rows = [row_of(row) for row in rows]
        slots, count = max(row.latency for row in rows) + 1, len(rows)
        width = 2 * max(len(row.outages) for row in rows)
        table: list[float] = [count, slots, width, *settings.noise_key]
        table += [number for row in self.rows for number in row]
        for row in rows:
            ticks = [tick for pair in row.outages for tick in pair]
            table += [*ticks, *[0] * (width - len(ticks))]
        self.table = as_table(table)
        walks, queues = [0.0, 0.0, 0.0, -1.0], [-1.0] * (MEASURED + 1) * slots
        numbers = [0.0] * MEASURED * count + walks * count + queues * count
        self.memory = as_table(numbers + [0.0] * (NOISE * count + 3))
