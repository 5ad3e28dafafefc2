# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The dispersed closed loop of 40 runs side by side, in the lanes of `rpo_training.lanes`.

A tick: navigation measures the state with a bias and noise; the controller answers; messages are
lost or late, and the newest answer that has come is held; the thrusters saturate the command of
`delay` ticks ago, and give it with their own magnitude and direction; the disturbance is added; the
chaser steps by its own mass about its own orbit. Every lane does the arithmetic of
`rpo_core.thrusters`, `rpo_core.navigation` and `campaign.faults` in its order.

Rows of scratch go on where those of `batch` end; axes lie one after the other in a row.
"""

from __future__ import annotations

from math import sqrt
from typing import Any, NamedTuple

import numpy as np

from rpo_core.kernels import CwStep, cw_step, given_force, measured, saturate, sin_cos
from rpo_core.metrics import MAX_ARRIVAL_DISTANCE_M
from rpo_core.noise import six_normals
from rpo_training.campaign.faults import LOST, Fates, lateness
from rpo_training.engine import tick as batch
from rpo_training.engine.lanes import STRIDE, compiled

RUNS = 40
"""Runs side by side: whole SIMD registers, and three axes fit into a row."""

AXES = 3 * RUNS

TRUE_R, TRUE_V, BIAS_R, BIAS_V, NOISE_R, NOISE_V, FLOWN, PUSH = (
    (batch.ROWS + row) * STRIDE for row in range(8)
)
ENERGY, SLEW, LATE_R, LATE_V, LATE_F, OUTSIDE, EFFORT = (
    (batch.ROWS + row) * STRIDE for row in range(8, 15)
)
SUM_R, SUM_V = (batch.ROWS + 15) * STRIDE, (batch.ROWS + 16) * STRIDE
THRUST = (batch.ROWS + 17) * STRIDE  # 9 rows
STEP = (batch.ROWS + 26) * STRIDE  # 26 rows
ROWS = batch.ROWS + 26 + len(CwStep._fields)

OUTCOMES = 15
"""Columns that `outcomes` fills: the 9 figures of the configuration, and the final state."""


class Fleet(NamedTuple):
    """Up to 40 runs as the kernels read them.

    starts, biases : (40, 6) [m, m/s]; keys : (2, 40); delays, masses : (40,)
    thrust : (40, 9); steps : (40, 26) fields of CwStep
    constant : (3, 40) [N]; waves : (harmonics, 3, 40) amplitude [N], rate [rad/s], phase [rad]
    """

    starts: Any
    biases: Any
    keys: Any
    delays: Any
    masses: Any
    thrust: Any
    steps: Any
    constant: Any
    waves: Any


class Loop(NamedTuple):
    """What all runs of a campaign share.

    times : (ticks,) [s]; noise : (2,) 1 sigma [m], [m/s]; slots : longest delay + 1
    axes, sines : (harmonics,) axis 0..2 of each wave, and whether it is a sine
    tail, late : last ticks whose norms are averaged, whose extremes are kept
    faulty : whether messages are lost or late, as `faults` says
    """

    times: Any
    dt: float
    limit: float
    noise: Any
    slots: int
    axes: Any
    sines: Any
    tail: int
    late: int
    faulty: bool
    faults: Fates


class Line(NamedTuple):
    """Commands on their way; see `make_line`.

    ring : (slots, 120) saturated, for the delay of the thrusters
    past, lateness : (2 late + 1, 120), (2 late + 1, 40) the last answers, and when they come
    newest, held : (40,), (120,) tick of the newest answer that has come, and the answer
    """

    ring: Any
    past: Any
    lateness: Any
    newest: Any
    held: Any


def make_line(loop: Loop) -> Line:
    """Return the scratch of one worker for commands on their way."""
    depth = 2 * loop.faults.late_by + 1 if loop.faulty else 1
    return Line(
        np.empty((loop.slots, AXES)),
        np.empty((depth, AXES)),
        np.empty((depth, RUNS), np.int64),
        np.empty(RUNS, np.int64),
        np.empty(AXES),
    )


@compiled
def place(w, fleet):  # type: ignore[no-untyped-def]
    """Put runs at their starts."""
    w[:] = 0.0
    for s in range(RUNS):
        for axis in range(3):
            lane = axis * RUNS + s
            w[TRUE_R + lane], w[TRUE_V + lane] = fleet.starts[s, axis], fleet.starts[s, 3 + axis]
            w[BIAS_R + lane], w[BIAS_V + lane] = fleet.biases[s, axis], fleet.biases[s, 3 + axis]
        for i in range(9):
            w[THRUST + i * STRIDE + s] = fleet.thrust[s, i]
        for i in range(26):
            w[STEP + i * STRIDE + s] = fleet.steps[s, i]


@compiled
def measure(w, keys, tick, sigma_r, sigma_v):  # type: ignore[no-untyped-def]
    """Fill the controller's rows: truth plus bias plus noise."""
    if sigma_r > 0.0 or sigma_v > 0.0:
        first, second = keys[0], keys[1]
        for s in range(RUNS):
            n = six_normals(tick, int(first[s]), int(second[s]))
            w[NOISE_R + s], w[NOISE_R + RUNS + s], w[NOISE_R + 2 * RUNS + s] = n[0], n[1], n[2]
            w[NOISE_V + s], w[NOISE_V + RUNS + s], w[NOISE_V + 2 * RUNS + s] = n[3], n[4], n[5]
    for s in range(AXES):
        w[batch.R + s] = measured(w[TRUE_R + s], w[BIAS_R + s], sigma_r, w[NOISE_R + s])
        w[batch.V + s] = measured(w[TRUE_V + s], w[BIAS_V + s], sigma_v, w[NOISE_V + s])


@compiled
def clear(line):  # type: ignore[no-untyped-def]
    """Forget all commands."""
    line.ring[:] = line.past[:] = line.held[:] = 0.0
    line.lateness[:] = LOST
    line.newest[:] = -1


@compiled
def hold(w, keys, line, tick, faults):  # type: ignore[no-untyped-def]
    """Replace row FORCE, the answers to this tick, by the newest that have come by now."""
    depth, first, second = len(line.past), keys[0], keys[1]
    slot = tick % depth
    for s in range(AXES):
        line.past[slot, s] = w[batch.FORCE + s]
    for s in range(RUNS):
        line.lateness[slot, s] = lateness(tick, int(first[s]), int(second[s]), faults)
        for late in (0, faults.late_by, 2 * faults.late_by):
            answered = tick - late
            came = answered >= 0 and line.lateness[answered % depth, s] == late
            if came and answered > line.newest[s]:
                line.newest[s] = answered
                for lane in (s, s + RUNS, s + 2 * RUNS):
                    line.held[lane] = line.past[answered % depth, lane]
        fresh = line.newest[s] >= 0 and tick - line.newest[s] <= faults.stale_after
        for lane in (s, s + RUNS, s + 2 * RUNS):
            w[batch.FORCE + lane] = line.held[lane] if fresh else 0.0


@compiled
def act(w, ring, delays, tick, limit):  # type: ignore[no-untyped-def]
    """Replace row FORCE by what the thrusters are told now: the saturated, delayed command."""
    slots = len(ring)
    if slots == 1:
        for s in range(AXES):
            w[batch.FORCE + s] = saturate(w[batch.FORCE + s], limit)
        return
    for s in range(AXES):
        ring[tick % slots, s] = saturate(w[batch.FORCE + s], limit)
    for s in range(RUNS):
        slot = (tick + slots - delays[s]) % slots
        for axis in range(3):
            w[batch.FORCE + axis * RUNS + s] = ring[slot, axis * RUNS + s]


@compiled
def push(w, fleet, loop, t):  # type: ignore[no-untyped-def]
    """Row PUSH: the disturbance of each run at time t, as `Disturbance.force_n` adds it up."""
    for axis in range(3):
        for s in range(RUNS):
            w[PUSH + axis * RUNS + s] = fleet.constant[axis, s]
    for h in range(len(loop.axes)):
        row, wave, is_sine = PUSH + loop.axes[h] * RUNS, fleet.waves[h], loop.sines[h]
        for s in range(RUNS):
            sine, cosine = sin_cos(wave[1, s] * t + wave[2, s])
            w[row + s] += wave[0, s] * (sine if is_sine else cosine)


@compiled
def coefficients(w, s):  # type: ignore[no-untyped-def]
    """Step of the relative dynamics of lane s."""
    i = STEP + s
    # fmt: off
    return CwStep(
        w[i], w[i + STRIDE], w[i + 2 * STRIDE], w[i + 3 * STRIDE], w[i + 4 * STRIDE],
        w[i + 5 * STRIDE], w[i + 6 * STRIDE], w[i + 7 * STRIDE], w[i + 8 * STRIDE],
        w[i + 9 * STRIDE], w[i + 10 * STRIDE], w[i + 11 * STRIDE], w[i + 12 * STRIDE],
        w[i + 13 * STRIDE], w[i + 14 * STRIDE], w[i + 15 * STRIDE], w[i + 16 * STRIDE],
        w[i + 17 * STRIDE], w[i + 18 * STRIDE], w[i + 19 * STRIDE], w[i + 20 * STRIDE],
        w[i + 21 * STRIDE], w[i + 22 * STRIDE], w[i + 23 * STRIDE], w[i + 24 * STRIDE],
        w[i + 25 * STRIDE],
    )
    # fmt: on


@compiled
def step(w):  # type: ignore[no-untyped-def]
    """Fly rows FORCE and PUSH for one step of the plant."""
    for s in range(RUNS):
        y, z, i = s + RUNS, s + 2 * RUNS, THRUST + s
        given = given_force(
            w[i],
            w[i + STRIDE],
            w[i + 2 * STRIDE],
            w[i + 3 * STRIDE],
            w[i + 4 * STRIDE],
            w[i + 5 * STRIDE],
            w[i + 6 * STRIDE],
            w[i + 7 * STRIDE],
            w[i + 8 * STRIDE],
            w[batch.FORCE + s],
            w[batch.FORCE + y],
            w[batch.FORCE + z],
        )
        state = cw_step(
            (
                w[TRUE_R + s],
                w[TRUE_R + y],
                w[TRUE_R + z],
                w[TRUE_V + s],
                w[TRUE_V + y],
                w[TRUE_V + z],
            ),
            (given[0] + w[PUSH + s], given[1] + w[PUSH + y], given[2] + w[PUSH + z]),
            coefficients(w, s),
        )
        w[TRUE_R + s], w[TRUE_R + y], w[TRUE_R + z] = state[0], state[1], state[2]
        w[TRUE_V + s], w[TRUE_V + y], w[TRUE_V + z] = state[3], state[4], state[5]


@compiled
def count_force(w, delays, tick, late):  # type: ignore[no-untyped-def]
    """Add up energy and effort of row FORCE, keep its largest step and, late, its largest size.

    The step from rest, when the first command takes effect, is not counted.
    """
    for s in range(AXES):
        flown = w[batch.FORCE + s]
        size = abs(flown)
        w[ENERGY + s] += flown * flown
        w[EFFORT + s] += size
        if late:
            w[LATE_F + s] = size if size > w[LATE_F + s] else w[LATE_F + s]
    for axis in range(3):
        for s in range(RUNS):
            lane = axis * RUNS + s
            change = abs(w[batch.FORCE + lane] - w[FLOWN + lane]) if tick > delays[s] else 0.0
            w[SLEW + lane] = change if change > w[SLEW + lane] else w[SLEW + lane]
            w[FLOWN + lane] = w[batch.FORCE + lane]


@compiled
def count_state(w, tick, tail, late):  # type: ignore[no-untyped-def]
    """Note who is outside the arrival distance; late, extremes; in the tail, norms."""
    for s in range(AXES):
        w[OUTSIDE + s] = (
            tick + 1.0 if abs(w[TRUE_R + s]) > MAX_ARRIVAL_DISTANCE_M else w[OUTSIDE + s]
        )
    if late:
        for s in range(AXES):
            size = abs(w[TRUE_R + s])
            w[LATE_R + s] = size if size > w[LATE_R + s] else w[LATE_R + s]
            size = abs(w[TRUE_V + s])
            w[LATE_V + s] = size if size > w[LATE_V + s] else w[LATE_V + s]
    if tail:
        for s in range(RUNS):
            x, y, z = TRUE_R + s, TRUE_R + RUNS + s, TRUE_R + 2 * RUNS + s
            w[SUM_R + s] += sqrt(w[x] * w[x] + w[y] * w[y] + w[z] * w[z])
            x, y, z = TRUE_V + s, TRUE_V + RUNS + s, TRUE_V + 2 * RUNS + s
            w[SUM_V + s] += sqrt(w[x] * w[x] + w[y] * w[y] + w[z] * w[z])


@compiled
def advance(w, fleet, loop, line, tick):  # type: ignore[no-untyped-def]
    """Do what follows the answer in row FORCE: its way, thrusters, disturbance, step, figures."""
    ticks = len(loop.times)
    if loop.faulty:
        hold(w, fleet.keys, line, tick, loop.faults)
    act(w, line.ring, fleet.delays, tick, loop.limit)
    late = tick >= ticks - loop.late
    count_force(w, fleet.delays, tick, late)
    push(w, fleet, loop, loop.times[tick])
    step(w)
    count_state(w, tick, tick >= ticks - loop.tail, late)


@compiled
def fly(fleet, law, loop, w, line):  # type: ignore[no-untyped-def]
    """Fly runs to the end; the sums stay in `w`."""
    place(w, fleet)
    clear(line)
    for tick in range(len(loop.times)):
        measure(w, fleet.keys, tick, loop.noise[0], loop.noise[1])
        batch.command(w, AXES, law)
        advance(w, fleet, loop, line, tick)


@compiled
def outcomes(w, masses, loop, figures):  # type: ignore[no-untyped-def]
    """Fill figures (n, OUTCOMES) of the first n runs."""
    for s in range(len(figures)):
        y, z, row = s + RUNS, s + 2 * RUNS, figures[s]
        row[0] = (w[ENERGY + s] + w[ENERGY + y] + w[ENERGY + z]) * loop.dt
        row[1] = w[SUM_V + s] / loop.tail
        row[2] = max(w[SLEW + s], w[SLEW + y], w[SLEW + z]) / loop.dt
        row[3] = w[SUM_R + s] / loop.tail
        row[4] = max(w[LATE_R + s], w[LATE_R + y], w[LATE_R + z])
        row[5] = max(w[LATE_V + s], w[LATE_V + y], w[LATE_V + z])
        row[6] = max(w[LATE_F + s], w[LATE_F + y], w[LATE_F + z])
        row[7] = max(w[OUTSIDE + s], w[OUTSIDE + y], w[OUTSIDE + z]) * loop.dt
        row[8] = (w[EFFORT + s] + w[EFFORT + y] + w[EFFORT + z]) * loop.dt / masses[s]
        for axis in range(3):
            row[9 + axis] = w[TRUE_R + axis * RUNS + s]
            row[12 + axis] = w[TRUE_V + axis * RUNS + s]
