# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Filters of paired runs, lane by lane: the bits of `rpo_nav.filter_kernels.estimate`.

All runs are at the same tick, and measure at the same ticks. So the base is the same tick in all;
a run that began anew after that (`BORN`) rests at its start until then. A measurement that does not
come, or is rejected, is taken like the others, and undone. Every inner loop runs over lanes.
"""

from __future__ import annotations

from math import sqrt

from rpo_core.kernels import CwStep, cw_step, saturate
from rpo_montecarlo.engine.lanes import compiled
from rpo_montecarlo.engine.parts import FORCE, RUNS, SEEN_R, SEEN_V
from rpo_montecarlo.engine.sensing import SCRATCH, sense
from rpo_nav.kalman import joseph, shown, variance_of
from rpo_nav.sensor_kernels import (
    CROSS_SHARE,
    HAS_RANGE,
    HAS_VELOCITY,
    LATENCY,
    NOISE_FLOOR,
    NOISE_SHARE,
    VELOCITY_FLOOR,
    VELOCITY_SHARE,
    across,
    is_due,
    larger,
    sight,
)

STATES = 9
"""Rows of a state; those of a disturbance are zero where the filter has none."""

SQUARE = STATES * STATES

# Rows of the table of the filters.
START, SPREAD = 0, STATES  # state and covariance at the start
AGAIN = SPREAD + SQUARE  # covariance after a restart
NOISE = AGAIN + SQUARE  # covariance that a tick adds
BORN = NOISE + SQUARE  # tick at which a run began
BEGIN = BORN + 1  # its covariance then
X, P = BEGIN + SQUARE, BEGIN + SQUARE + STATES  # at the base
Y, S = P + SQUARE, P + SQUARE + STATES  # at the newest tick
KEPT = S + SQUARE  # state and covariance before a measurement
WORK, GAIN, REST, SHARED = (KEPT + SQUARE + STATES * (i + 1) for i in range(4))  # of an update
H = SHARED + STATES  # line of sight, and two directions across it
VALUE, VARIANCE, TOTAL, INNOVATION, RANGE, NIS = (H + 9 + i for i in range(6))
DRAWN = NIS + 1  # of the sensors
ROWS = DRAWN + SCRATCH


@compiled
def place_estimators(e):  # type: ignore[no-untyped-def]
    """Forget all ticks."""
    if e is None:
        return
    e.walk[:] = 0.0
    e.queue[:] = 0.0
    e.commands[:] = 0.0
    e.rejected[:] = 0
    e.rows[BORN:] = 0.0
    e.rows[BEGIN : BEGIN + SQUARE] = e.rows[SPREAD : SPREAD + SQUARE]
    e.rows[X : X + STATES] = e.rows[START : START + STATES]
    e.rows[P : P + SQUARE] = e.rows[SPREAD : SPREAD + SQUARE]


@compiled
def _step(c, s):  # type: ignore[no-untyped-def]
    # fmt: off
    return CwStep(
        c[s], c[RUNS + s], c[2 * RUNS + s], c[3 * RUNS + s], c[4 * RUNS + s], c[5 * RUNS + s],
        c[6 * RUNS + s], c[7 * RUNS + s], c[8 * RUNS + s], c[9 * RUNS + s], c[10 * RUNS + s],
        c[11 * RUNS + s], c[12 * RUNS + s], c[13 * RUNS + s], c[14 * RUNS + s], c[15 * RUNS + s],
        c[16 * RUNS + s], c[17 * RUNS + s], c[18 * RUNS + s], c[19 * RUNS + s], c[20 * RUNS + s],
        c[21 * RUNS + s], c[22 * RUNS + s], c[23 * RUNS + s], c[24 * RUNS + s], c[25 * RUNS + s],
    )
    # fmt: on


@compiled
def _step_six(a, stride, force, c, s):  # type: ignore[no-untyped-def]
    """Move six numbers of a run that lie `stride` apart, as `cw_step` moves a state."""
    i, j, k, m, n = stride + s, 2 * stride + s, 3 * stride + s, 4 * stride + s, 5 * stride + s
    a[s], a[i], a[j], a[k], a[m], a[n] = cw_step((a[s], a[i], a[j], a[k], a[m], a[n]), force, c)


@compiled
def _step_states(t, steps, given, x):  # type: ignore[no-untyped-def]
    """Move states by a tick under the force given and the disturbance."""
    a = t[x * RUNS :]
    for s in range(RUNS):
        fx, fy, fz = a[6 * RUNS + s], a[7 * RUNS + s], a[8 * RUNS + s]
        force = (given[s] + fx, given[RUNS + s] + fy, given[2 * RUNS + s] + fz)
        _step_six(a, RUNS, force, _step(steps, s), s)


@compiled
def _step_covariances(steps, rows, n, p):  # type: ignore[no-untyped-def]
    """Replace each P by F P F' + Q."""
    t = rows.reshape(-1)
    for column in range(n):
        a = t[(p + column) * RUNS :]
        for s in range(RUNS):
            force = (a[54 * RUNS + s], a[63 * RUNS + s], a[72 * RUNS + s])
            _step_six(a, STATES * RUNS, force, _step(steps, s), s)
    for line in range(6):
        a = t[(p + STATES * line) * RUNS :]
        for s in range(RUNS):
            force = (a[6 * RUNS + s], a[7 * RUNS + s], a[8 * RUNS + s])
            _step_six(a, RUNS, force, _step(steps, s), s)
    for i in range(n):
        for j in range(i, n):
            a, more = rows[p + STATES * i + j], rows[NOISE + STATES * i + j]
            for s in range(RUNS):
                a[s] += more[s]
            if j > i:
                rows[p + STATES * j + i] = a


@compiled
def _gains(rows, n, p, first, h):  # type: ignore[no-untyped-def]
    """Fill rows WORK, P h, and the variances, of a measured number."""
    h0, h1, h2 = rows[h], rows[h + 1], rows[h + 2]
    for i in range(n):
        at = p + STATES * i + first
        a, b, c, work = rows[at], rows[at + 1], rows[at + 2], rows[WORK + i]
        for s in range(RUNS):
            work[s] = shown((h0[s], h1[s], h2[s]), a[s], b[s], c[s])
    at, noise, total = WORK + first, rows[VARIANCE], rows[TOTAL]
    a, b, c = rows[at], rows[at + 1], rows[at + 2]
    for s in range(RUNS):
        total[s] = variance_of(noise[s], (h0[s], h1[s], h2[s]), a[s], b[s], c[s])


@compiled
def _innovate(rows, x, first, h):  # type: ignore[no-untyped-def]
    """Fill row INNOVATION; add to row NIS."""
    h0, h1, h2, at = rows[h], rows[h + 1], rows[h + 2], x + first
    a, b, c = rows[at], rows[at + 1], rows[at + 2]
    found, value, total, nis = rows[INNOVATION], rows[VALUE], rows[TOTAL], rows[NIS]
    for s in range(RUNS):
        found[s] = value[s] - shown((h0[s], h1[s], h2[s]), a[s], b[s], c[s])
    for s in range(RUNS):
        size = found[s] / sqrt(total[s])
        nis[s] += size * size


@compiled
def _update(rows, n, x, p):  # type: ignore[no-untyped-def]
    """Take a measured number, as `kalman.update` does, in all runs."""
    total, innovation, noise = rows[TOTAL], rows[INNOVATION], rows[VARIANCE]
    for i in range(n):
        state, work, gain = rows[x + i], rows[WORK + i], rows[GAIN + i]
        for s in range(RUNS):
            gain[s] = work[s] / total[s]
            state[s] += gain[s] * innovation[s]
    for i in range(n):
        work, gain, rest, shared = rows[WORK + i], rows[GAIN + i], rows[REST + i], rows[SHARED + i]
        for s in range(RUNS):
            rest[s] = work[s] - gain[s] * (total[s] - noise[s])
            shared[s] = gain[s] * noise[s]
    for i in range(n):
        gain, rest, shared = rows[GAIN + i], rows[REST + i], rows[SHARED + i]
        for j in range(i, n):
            a, work, other = rows[p + STATES * i + j], rows[WORK + j], rows[GAIN + j]
            for s in range(RUNS):
                a[s] = joseph(a[s], gain[s], work[s], rest[s], other[s], shared[s])
            if j > i:
                rows[p + STATES * j + i] = a


@compiled
def _look(rows, x):  # type: ignore[no-untyped-def]
    """Fill rows RANGE and H: the line of sight that is expected, two directions across it."""
    a = rows[x:]
    for s in range(RUNS):
        rows[RANGE, s], ux, uy, uz = sight(a[0, s], a[1, s], a[2, s])
        (bx, by, bz), (cx, cy, cz) = across(ux, uy, uz)
        rows[H, s], rows[H + 1, s], rows[H + 2, s] = ux, uy, uz
        rows[H + 3, s], rows[H + 4, s], rows[H + 5, s] = bx, by, bz
        rows[H + 6, s], rows[H + 7, s], rows[H + 8, s] = cx, cy, cz


@compiled
def _expect(rows, h, found, noise, by_range):  # type: ignore[no-untyped-def]
    """Fill rows VALUE and VARIANCE of a number: what was measured along h, and its noise.

    by_range : whether a direction was measured: it is the point at the distance expected
    """
    for s in range(RUNS):
        vx, vy, vz = found[0, s], found[1, s], found[2, s]
        if by_range:
            vx, vy, vz = rows[RANGE, s] * vx, rows[RANGE, s] * vy, rows[RANGE, s] * vz
        rows[VALUE, s] = shown((rows[h, s], rows[h + 1, s], rows[h + 2, s]), vx, vy, vz)
    floor, share = noise[0], noise[1]
    for s in range(RUNS):
        sigma = larger(floor[s], share[s] * rows[RANGE, s])
        rows[VARIANCE, s] = sigma * sigma


@compiled
def _take(rows, n, x, p, found, sensor, told):  # type: ignore[no-untyped-def]
    """Take a measurement (7, 40) in all runs; return of how many numbers it is."""
    _look(rows, x)
    rows[NIS] = 0.0
    numbers, has_range = 0, sensor[HAS_RANGE] != 0.0
    for number in range(6):
        if (number == 0 and not has_range) or (number >= 3 and sensor[HAS_VELOCITY] == 0.0):
            continue
        h, floor, share = H + 3 * number, NOISE_FLOOR, CROSS_SHARE if number else NOISE_SHARE
        first = 0
        if number >= 3:  # an axis of its own
            first, floor, share, h = 3, VELOCITY_FLOOR, VELOCITY_SHARE, H
            rows[H : H + 3] = 0.0
            rows[H + number - 3] = 1.0
        values = found[4:] if number >= 3 else found[1:]
        _expect(rows, h, values, (told[floor], told[share]), not has_range and number < 3)
        _gains(rows, n, p, first, h)
        _innovate(rows, x, first, h)
        _update(rows, n, x, p)
        numbers += 1
    return numbers


@compiled
def _restart(rows, s, x, p, found, sensor):  # type: ignore[no-untyped-def]
    """Let a run begin again with what was measured."""
    for j in range(SQUARE):
        rows[p + j, s] = rows[AGAIN + j, s]
    for j in range(3):
        rows[x + 6 + j, s] = 0.0
        if sensor[HAS_RANGE] != 0.0:
            rows[x + j, s] = found[1 + j, s]
        if sensor[HAS_VELOCITY] != 0.0:
            rows[x + 3 + j, s] = found[4 + j, s]


@compiled
def _accept(e, t, i, x, p, last):  # type: ignore[no-untyped-def]
    """Take the measurement of a sensor at tick t, but undo it where none came, or it is too far."""
    rows, found, sensor = e.rows, e.queue[i, t % len(e.queue[i])], e.shared[i]
    rows[KEPT : KEPT + STATES + SQUARE] = rows[x : x + STATES + SQUARE]
    gate = e.gates[_take(rows, e.n, x, p, found, sensor, e.told[i])]
    for s in range(RUNS):
        comes = found[0, s] != 0.0 and t >= rows[BORN, s]
        taken = comes and (gate <= 0.0 or rows[NIS, s] <= gate)
        if not taken:
            for j in range(STATES + SQUARE):
                rows[x + j, s] = rows[KEPT + j, s]
        if last and comes:
            e.rejected[s] = 0 if taken else e.rejected[s] + 1
            if not taken and e.patience > 0 and e.rejected[s] >= e.patience:
                _restart(rows, s, x, p, found, sensor)
                e.rejected[s] = 0


@compiled
def _advance(e, t, tick, x, p, last, full):  # type: ignore[no-untyped-def]
    """Move states to tick t, and take what was measured there and has come until `tick`."""
    rows, slots = e.rows, len(e.commands)
    if t > 0:
        for s in range(RUNS):
            command = e.commands[(t - 1 - e.delay[s]) % slots]
            for axis in range(3):
                e.force[axis * RUNS + s] = command[axis, s]
        _step_states(rows.reshape(-1), e.steps, e.force, x)
        if full:
            _step_covariances(e.steps, rows, e.n, p)
    for s in range(RUNS):
        if t <= rows[BORN, s]:
            for j in range(STATES):
                rows[x + j, s] = rows[START + j, s]
            for j in range(SQUARE):
                rows[p + j, s] = rows[BEGIN + j, s]
    for i in range(len(e.shared)):
        if t + int(e.shared[i, LATENCY]) <= tick and is_due(t, e.shared[i], e.outages[i]):
            _accept(e, t, i, x, p, last)


@compiled
def _check(e, tick):  # type: ignore[no-untyped-def]
    """Let a run whose numbers ran out of range begin again at the next tick."""
    rows = e.rows
    for s in range(RUNS):
        total = 0.0
        for j in range(STATES):
            total += rows[Y + j, s] - rows[Y + j, s]
        for j in range(SQUARE):
            total += rows[P + j, s] - rows[P + j, s]
        if total == 0.0:
            continue
        e.rejected[s], rows[BORN, s] = 0, tick + 1.0
        e.commands[:, :, s] = 0.0
        for j in range(SQUARE):
            rows[BEGIN + j, s] = rows[AGAIN + j, s]
        for j in range(STATES):
            rows[Y + j, s] = rows[START + j, s]


@compiled
def navigate(w, tick, estimators):  # type: ignore[no-untyped-def]
    """Fill rows SEEN with the estimates."""
    if estimators is None:
        return
    e = estimators
    rows, base = e.rows, tick - e.newest
    sense(w, tick, e, rows[DRAWN:])
    if base >= 0:
        _advance(e, base, tick, X, P, True, True)
    full = False
    for i in range(len(e.shared)):
        full = full or int(e.shared[i, LATENCY]) < e.newest
    rows[Y : Y + STATES] = rows[X : X + STATES]
    if full:
        rows[S : S + SQUARE] = rows[P : P + SQUARE]
    for t in range(max(base, -1) + 1, tick + 1):
        _advance(e, t, tick, Y, S, False, full)
    _check(e, tick)
    for axis in range(3):
        for s in range(RUNS):
            w[SEEN_R + axis * RUNS + s] = rows[Y + axis, s]
            w[SEEN_V + axis * RUNS + s] = rows[Y + 3 + axis, s]


@compiled
def oppose(w, estimators):  # type: ignore[no-untyped-def]
    """Subtract the disturbances that are estimated from row FORCE, where that is wanted."""
    if estimators is None or not estimators.compensate:
        return
    for axis in range(3):
        for s in range(RUNS):
            w[FORCE + axis * RUNS + s] -= estimators.rows[Y + 6 + axis, s]


@compiled
def remember(w, tick, estimators):  # type: ignore[no-untyped-def]
    """Keep row FORCE, the commands of this tick, for the next one."""
    if estimators is None:
        return
    command = estimators.commands[tick % len(estimators.commands)]
    for axis in range(3):
        for s in range(RUNS):
            command[axis, s] = saturate(w[FORCE + axis * RUNS + s], estimators.limit)
