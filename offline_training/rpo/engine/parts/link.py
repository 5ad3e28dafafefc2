# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages lost or late between plant and controller, side by side.

The same as a number of ticks: see `rpo.montecarlo.faults.LinkStage`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rpo.engine.lanes import FORCE, PAIRED_LANES, RUNS, TORQUE, compiled
from rpo.engine.tick import Batch, Kind, Part, register, table_of
from rpo_core.kernels.jit import inlined
from rpo_core.kernels.noise import philox
from rpo_core.stage import Place

LOST = -1
"""The lateness of an answer that does not arrive."""


class Fates(NamedTuple):
    """Faults of messages as the kernels read them: thresholds of words of 32 bits, and ticks."""

    state_loss: float
    state_delay: float
    force_loss: float
    force_delay: float
    late_by: int
    stale_after: int


KEYS = len(Fates._fields)
"""Place in the table, after `Fates`, of the keys (2, 40)."""

_LANES = 2 * PAIRED_LANES
LATEST, HELD = 0, RUNS
PAST = HELD + _LANES
"""Places in the memory: tick of the latest answer that has arrived, the answer; then, of each of
the last ticks, the answers (240,), forces and torques, and how late they are (40,)."""

_SLOT = _LANES + RUNS


@inlined
def hits(tick: int, k0: int, k1: int, faults: Fates) -> tuple[bool, bool, bool, bool]:
    """Whether state `tick` is lost, late, and the force that answers it is lost, late.

    Philox4x32-10 of (key of the run, tick): runs and ticks can be flown in any order.
    """
    a, b, c, d = philox(tick, 2, 0, 0, k0, k1)
    return (
        a < faults.state_loss,
        b < faults.state_delay,
        c < faults.force_loss,
        d < faults.force_delay,
    )


@inlined
def lateness(tick: int, k0: int, k1: int, faults: Fates) -> int:
    """Ticks from state `tick` to the force that answers it; LOST if there is none."""
    lost, late, force_lost, force_late = hits(tick, k0, k1, faults)
    return LOST if lost or force_lost else faults.late_by * (late + force_late)


@compiled
def hold(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Replace rows FORCE and TORQUE, the answers to this tick, by the latest that have arrived."""
    faults = Fates(t[0], t[1], t[2], t[3], int(t[4]), int(t[5]))
    depth = 2 * faults.late_by + 1
    now = PAST + _SLOT * (tick % depth)
    for s in range(PAIRED_LANES):
        m[now + s], m[now + PAIRED_LANES + s] = w[FORCE + s], w[TORQUE + s]
    for s in range(RUNS):
        k0, k1 = int(t[KEYS + s]), int(t[KEYS + RUNS + s])
        m[now + _LANES + s] = lateness(tick, k0, k1, faults)
        for late in (0, faults.late_by, 2 * faults.late_by):
            answered = tick - late
            slot = PAST + _SLOT * (answered % depth)
            arrives = answered >= 0 and m[slot + _LANES + s] == late
            if arrives and answered > m[LATEST + s]:
                m[LATEST + s] = answered
                for lane in range(s, _LANES, RUNS):
                    m[HELD + lane] = m[slot + lane]
        fresh = m[LATEST + s] >= 0.0 and tick - m[LATEST + s] <= faults.stale_after
        for lane in (s, s + RUNS, s + 2 * RUNS):
            w[FORCE + lane] = m[HELD + lane] if fresh else 0.0
            w[TORQUE + lane] = m[HELD + PAIRED_LANES + lane] if fresh else 0.0


def _part(batch: Batch) -> Part | None:
    if batch.faults is None:
        return None
    memory = np.full(PAST + _SLOT * (2 * batch.faults.late_by + 1), float(LOST))
    memory[HELD:PAST] = 0.0
    table = table_of(batch.faults, batch.key_rows)
    return Part('link', ((Place.LINK, hold),), table, memory)


register(Kind('', _part))
