# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The dispersed closed loop under a baseline's control law; all else is `campaign.loops`."""

from __future__ import annotations

from rpo_core.baseline_kernels import baseline_force
from rpo_training.campaign import loops
from rpo_training.engine import tick as batch
from rpo_training.engine.lanes import compiled


@compiled
def command(w, tick, law):  # type: ignore[no-untyped-def]
    """Row FORCE [N] of the runs from rows R [m] and V [m/s], what the controller sees."""
    for s in range(loops.RUNS):
        y, z = s + loops.RUNS, s + 2 * loops.RUNS
        seen = (
            w[batch.R + s],
            w[batch.R + y],
            w[batch.R + z],
            w[batch.V + s],
            w[batch.V + y],
            w[batch.V + z],
        )
        force = baseline_force(seen, tick, law)
        w[batch.FORCE + s], w[batch.FORCE + y], w[batch.FORCE + z] = force


@compiled
def fly(fleet, law, loop, w, line):  # type: ignore[no-untyped-def]
    """Fly runs to the end; the sums stay in `w`."""
    loops.place(w, fleet)
    loops.clear(line)
    for tick in range(len(loop.times)):
        loops.measure(w, fleet.keys, tick, loop.noise[0], loop.noise[1])
        command(w, tick, law)
        loops.advance(w, fleet, loop, line, tick)
