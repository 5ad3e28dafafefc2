# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Sensors of paired runs, lane by lane: the bits of `rpo_nav.sensor_kernels.sense`."""

from __future__ import annotations

from rpo_core.kernels.noise import normal_pair, philox
from rpo_montecarlo.engine.lanes import compiled
from rpo_montecarlo.engine.parts import RUNS, R, V
from rpo_nav.sensor_kernels import (
    AXIS_X,
    AXIS_Y,
    AXIS_Z,
    BIAS_X,
    BIAS_Y,
    BIAS_Z,
    COSINE,
    CROSS_SHARE,
    DROPOUT,
    FIRST,
    HAS_RANGE,
    HAS_VELOCITY,
    NOISE_FLOOR,
    NOISE_SHARE,
    OUTLIER,
    OUTLIER_SIZE,
    OUTLYING,
    SCALE,
    SECOND,
    VELOCITY_FLOOR,
    VELOCITY_SHARE,
    WALK,
    WALKING,
    is_due,
    larger,
    looks,
    scattered,
    sight,
    three_normals,
)

NORMALS, DROPPED, OUTLYING_WORD, WORDS, DISTANCE = 0, 4, 5, 6, 8
"""Rows of the scratch of `sense`: four normals, and words of 32 bits."""

SCRATCH = 9


@compiled
def _walk(tick, stream, sensor, keys, walk):  # type: ignore[no-untyped-def]
    """Move the random walks of the biases of a sensor by a tick."""
    k0, k1, step = keys[0], keys[1], sensor[WALK]
    x, y, z = walk[0], walk[1], walk[2]
    for s in range(RUNS):
        n0, n1, n2 = three_normals(tick, WALKING, stream, k0[s], k1[s])
        x[s] += step[s] * n0
        y[s] += step[s] * n1
        z[s] += step[s] * n2


@compiled
def _draw(tick, stream, keys, scratch):  # type: ignore[no-untyped-def]
    """Fill the scratch with the random numbers of a measurement."""
    k0, k1 = keys[0], keys[1]
    n0, n1, n2, n3 = scratch[NORMALS], scratch[1], scratch[2], scratch[3]
    for s in range(RUNS):
        a, b, c, d = philox(tick, FIRST, stream, 0, k0[s], k1[s])
        n0[s], n1[s] = normal_pair(a, b)
        n2[s], n3[s] = normal_pair(c, d)
    dropped, outlying = scratch[DROPPED], scratch[OUTLYING_WORD]
    first, second = scratch[WORDS], scratch[WORDS + 1]
    for s in range(RUNS):
        e, f, g, h = philox(tick, SECOND, stream, 0, k0[s], k1[s])
        first[s], second[s], dropped[s], outlying[s] = float(e), float(f), float(g), float(h)


@compiled
def _see(w, sensor, walk, scratch, out):  # type: ignore[no-untyped-def]
    """Fill measured positions, and whether they come at all."""
    for s in range(RUNS):
        x = w[R + s] + sensor[BIAS_X, s] + walk[0, s]
        y = w[R + RUNS + s] + sensor[BIAS_Y, s] + walk[1, s]
        z = w[R + 2 * RUNS + s] + sensor[BIAS_Z, s] + walk[2, s]
        distance, ux, uy, uz = sight(x, y, z)
        axis = (sensor[AXIS_X, s], sensor[AXIS_Y, s], sensor[AXIS_Z, s])
        seen = looks(ux, uy, uz, axis, sensor[COSINE, s])
        comes = seen and not scratch[DROPPED, s] < sensor[DROPOUT, s]
        normals = (scratch[0, s], scratch[1, s], scratch[2, s])
        out[1, s], out[2, s], out[3, s] = scattered(
            (x, y, z),
            normals,
            sensor[NOISE_FLOOR, s],
            sensor[NOISE_SHARE, s],
            sensor[CROSS_SHARE, s],
            sensor[SCALE, s],
        )
        scratch[DISTANCE, s] = distance
        out[0, s] = 1.0 if comes else 0.0


@compiled
def _stray(tick, stream, sensor, keys, scratch, out):  # type: ignore[no-untyped-def]
    """Add outliers: they are rare, so run by run."""
    for s in range(RUNS):
        if scratch[OUTLYING_WORD, s] < sensor[OUTLIER, s]:
            n0, n1, n2 = three_normals(tick, OUTLYING, stream, keys[0, s], keys[1, s])
            size = sensor[OUTLIER_SIZE, s]
            out[1, s] += size * n0
            out[2, s] += size * n1
            out[3, s] += size * n2


@compiled
def _see_velocity(w, sensor, scratch, out):  # type: ignore[no-untyped-def]
    for s in range(RUNS):
        n4, n5 = normal_pair(int(scratch[WORDS, s]), int(scratch[WORDS + 1, s]))
        share = sensor[VELOCITY_SHARE, s] * scratch[DISTANCE, s]
        sigma = larger(sensor[VELOCITY_FLOOR, s], share)
        out[4, s] = w[V + s] + sigma * scratch[3, s]
        out[5, s] = w[V + RUNS + s] + sigma * n4
        out[6, s] = w[V + 2 * RUNS + s] + sigma * n5


@compiled
def sense(w, tick, e, scratch):  # type: ignore[no-untyped-def]
    """Fill the slot of a tick in the queue of each sensor with what it measures."""
    for i in range(len(e.shared)):
        sensor, stream, slots = e.true[i], i + 1, len(e.queue[i])
        if e.shared[i, WALK] > 0.0:
            _walk(tick, stream, sensor, e.keys, e.walk[i])
        out = e.queue[i, tick % slots]
        out[0] = 0.0
        if not is_due(tick, e.shared[i], e.outages[i]):
            continue
        _draw(tick, stream, e.keys, scratch)
        _see(w, sensor, e.walk[i], scratch, out)
        if e.shared[i, OUTLIER] > 0.0:
            _stray(tick, stream, sensor, e.keys, scratch, out)
        if e.shared[i, HAS_RANGE] == 0.0:
            for s in range(RUNS):
                _, out[1, s], out[2, s], out[3, s] = sight(out[1, s], out[2, s], out[3, s])
        if e.shared[i, HAS_VELOCITY] != 0.0:
            _see_velocity(w, sensor, scratch, out)
