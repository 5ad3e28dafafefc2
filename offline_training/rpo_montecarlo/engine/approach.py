# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Paired runs that follow a plan, under runtime assurance: the kernels of those rooms, run by run.

A plan without holds and commands does not depend on the flight: its references come from a table.
"""

from __future__ import annotations

from rpo_core.kernels import CwStep, cw_step
from rpo_guidance.transfer_kernels import at_port
from rpo_montecarlo.engine.lanes import compiled
from rpo_montecarlo.engine.parts import FORCE, KNOWN_R, KNOWN_V, RUNS, SEEN_R, SEEN_V
from rpo_safety.packed import assure_packed

AHEAD, COMMAND, LAST, MODE = 0, 3 + 3, 9, 12
"""Columns of `assure_packed`: state, command, last force, mode."""


@compiled
def place_approach(guiding, assured):  # type: ignore[no-untyped-def]
    """Let nobody have docked, and no force be on its way."""
    if guiding is not None:
        guiding.docked[:] = False
    if assured is not None:
        assured.line[:] = 0.0
        assured.numbers[:] = 0.0
        assured.numbers[:, MODE] = assured.modes


@compiled
def follow(w, tick, guiding):  # type: ignore[no-untyped-def]
    """Fill rows SEEN with the state relative to the reference; keep the state in rows KNOWN.

    Of a chaser that has docked the reference is its own state.
    """
    if guiding is None:
        return
    table, p, docked = guiding.table, guiding.port, guiding.docked
    for s in range(3 * RUNS):
        w[KNOWN_R + s], w[KNOWN_V + s] = w[SEEN_R + s], w[SEEN_V + s]
    for s in range(RUNS):
        y, z = s + RUNS, s + 2 * RUNS
        if p[6] > 0.0 and tick >= guiding.last[s] and not docked[s]:
            docked[s] = at_port(
                w[SEEN_R + s], w[SEEN_R + y], w[SEEN_R + z],
                p[0], p[1], p[2], p[3], p[4], p[5], p[6],
            )  # fmt: skip
        for axis in range(3):
            lane = axis * RUNS + s
            if docked[s]:
                w[SEEN_R + lane] -= w[SEEN_R + lane]
                w[SEEN_V + lane] -= w[SEEN_V + lane]
            else:
                w[SEEN_R + lane] -= table[tick, axis, s]
                w[SEEN_V + lane] -= table[tick, 3 + axis, s]


@compiled
def add_feed_forward(w, tick, guiding):  # type: ignore[no-untyped-def]
    """Add the force that a chaser on the reference needs to row FORCE."""
    if guiding is None:
        return
    for s in range(RUNS):
        for axis in range(3):
            force = 0.0 if guiding.docked[s] else guiding.table[tick, 6 + axis, s]
            w[FORCE + axis * RUNS + s] += force


@compiled
def know(w, guiding, assured):  # type: ignore[no-untyped-def]
    """Keep the state in rows KNOWN, where nobody has yet."""
    if assured is None or guiding is not None:
        return
    for s in range(3 * RUNS):
        w[KNOWN_R + s], w[KNOWN_V + s] = w[SEEN_R + s], w[SEEN_V + s]


@compiled
def _step(c):  # type: ignore[no-untyped-def]
    # fmt: off
    return CwStep(
        c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8], c[9], c[10], c[11], c[12], c[13],
        c[14], c[15], c[16], c[17], c[18], c[19], c[20], c[21], c[22], c[23], c[24], c[25],
    )
    # fmt: on


@compiled
def assure_all(w, tick, assured):  # type: ignore[no-untyped-def]
    """Replace row FORCE by what runtime assurance lets pass."""
    if assured is None:
        return
    a = assured
    for s in range(RUNS):
        y, z, delay, line = s + RUNS, s + 2 * RUNS, a.delays[s], a.line[s]
        v, table = a.numbers[s], a.tables[s]
        state = (
            w[KNOWN_R + s], w[KNOWN_R + y], w[KNOWN_R + z],
            w[KNOWN_V + s], w[KNOWN_V + y], w[KNOWN_V + z],
        )  # fmt: skip
        if delay > 0:
            step = _step(table)
            for i in range(delay):
                due = line[(tick + i) % delay]
                state = cw_step(state, (due[0], due[1], due[2]), step)
        for i in range(6):
            v[AHEAD + i] = state[i]
        v[COMMAND], v[COMMAND + 1], v[COMMAND + 2] = w[FORCE + s], w[FORCE + y], w[FORCE + z]
        fx, fy, fz, mode, _, _, _ = assure_packed(v, table)
        v[LAST], v[LAST + 1], v[LAST + 2], v[MODE] = fx, fy, fz, mode
        if delay > 0:
            newest = line[tick % delay]
            newest[0], newest[1], newest[2] = fx, fy, fz
        w[FORCE + s], w[FORCE + y], w[FORCE + z] = fx, fy, fz
