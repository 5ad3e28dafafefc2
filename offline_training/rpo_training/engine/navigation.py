# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Paired runs with sensors and an estimator: the kernels of `rpo_nav`, run by run."""

from __future__ import annotations

from rpo_core.kernels import CwStep
from rpo_nav.filter_kernels import Filter, Memory, estimate
from rpo_nav.sensor_kernels import sense
from rpo_training.engine.lanes import compiled
from rpo_training.engine.parts import FORCE, RUNS, SEEN_R, SEEN_V, R, V


@compiled
def place_estimators(estimators):  # type: ignore[no-untyped-def]
    """Forget all ticks."""
    if estimators is None:
        return
    estimators.walk[:] = 0.0
    estimators.walk[:, :, 3] = -1.0
    estimators.queue[:] = -1.0
    estimators.command[:] = 0.0
    estimators.counts[:] = -1


@compiled
def step_of_row(c):  # type: ignore[no-untyped-def]
    """CW step of the first numbers of a row."""
    # fmt: off
    return CwStep(
        c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9], c[10], c[11], c[12], c[13],
        c[14], c[15], c[16], c[17], c[18], c[19], c[20], c[21], c[22], c[23], c[24], c[25],
    )
    # fmt: on


@compiled
def navigate(w, tick, estimators):  # type: ignore[no-untyped-def]
    """Fill rows SEEN with the estimates."""
    if estimators is None:
        return
    e = estimators
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        state = (w[R + s], w[R + y], w[R + z], w[V + s], w[V + y], w[V + z])
        key, command = e.keys[s], e.command[s]
        sense(tick, state, e.rows[s], e.outages, key[0], key[1], e.walk[s], e.queue[s], e.out)
        told = Filter(
            e.n, step_of_row(e.steps[s]), e.noise[s], e.start[s], e.spread[s], e.again[s],
            e.told[s], e.gates, e.limit, e.delays[s], e.patience, e.newest, 0,
        )  # fmt: skip
        memory = Memory(
            e.x[s], e.p[s], e.y[s], e.s[s], e.work, e.commands[s], e.pending[s], e.counts[s],
            e.tested,
        )  # fmt: skip
        estimate(tick, (command[0], command[1], command[2]), e.out, told, memory)
        found = e.y[s]
        w[SEEN_R + s], w[SEEN_R + y], w[SEEN_R + z] = found[0], found[1], found[2]
        w[SEEN_V + s], w[SEEN_V + y], w[SEEN_V + z] = found[3], found[4], found[5]


@compiled
def remember(w, estimators):  # type: ignore[no-untyped-def]
    """Keep row FORCE, the commands of this tick, for the next one."""
    if estimators is None:
        return
    for s in range(RUNS):
        for axis in range(3):
            estimators.command[s, axis] = w[FORCE + axis * RUNS + s]
