# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Command shaping side by side: the kernels of that room."""

from __future__ import annotations

import numpy as np

from rpo_core.chain.stage import Place
from rpo_montecarlo.engine.lanes import FORCE, FOUND_PUSH, PAIRED_LANES, RUNS, SEEN_R, compiled
from rpo_montecarlo.engine.tick import Batch, Kind, Part, register, table_of
from rpo_safety.shaping import (
    AHEAD_S,
    Shaping,
    ShapingStage,
    followed,
    held,
    largest_ahead,
    shaped,
)

GAINS = 10
"""Place of the gains of the limit of the hold in the table: its other numbers are before them, and
before those the numbers of the shaping."""
FIT, RATE, CURVE, LARGEST, AHEAD = (PAIRED_LANES * place for place in range(1, 6))
"""Places in the memory, behind the commands of the tick before: value, rate, rate of the rate of
the fits; of each run, the largest disturbance so far, and the largest ahead."""


@compiled
def shape(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Replace row FORCE by the shaped command, which the memory keeps."""
    for s in range(PAIRED_LANES):
        m[s] = w[FORCE + s] = shaped(w[FORCE + s], m[s], tick == 0, t[0], t[1], t[2])


@compiled
def hold(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Limit row FORCE in the hold."""
    share, within, begin, act, period, end, dt = t[3], t[4], t[5], t[6], t[7], t[8], t[9]
    if tick >= begin and (tick - begin) % period == 0:
        number = int((tick - begin) // period)
        g = GAINS + 3 * number
        gains, span = (t[g], t[g + 1], t[g + 2]), min(AHEAD_S, (end - tick) * dt)
        for s in range(PAIRED_LANES):
            before = (m[FIT + s], m[RATE + s], m[CURVE + s])
            fit = followed(w[FOUND_PUSH + s], before, number == 0, gains, period * dt)
            m[FIT + s], m[RATE + s], m[CURVE + s] = fit
            run = s % RUNS
            m[LARGEST + run] = max(m[LARGEST + run], abs(fit[0]))
            ahead = largest_ahead(fit, span)
            m[AHEAD + run] = max(m[AHEAD + run], ahead) if s >= RUNS else ahead
    if tick >= act:
        for s in range(PAIRED_LANES):
            most = share * max(m[LARGEST + s % RUNS], m[AHEAD + s % RUNS])
            w[FORCE + s] = held(w[FORCE + s], most, w[SEEN_R + s], within)


def _part(batch: Batch) -> Part | None:
    settings = batch.base.section(Shaping)
    if settings is None:
        return None
    stage = ShapingStage(settings, batch.base)
    limit, table = stage.hold, table_of(stage.numbers)
    if limit is None:
        return Part('shaping', ((Place.SHAPING, shape),), table, np.zeros(PAIRED_LANES))
    ticks = (limit.begin, limit.act, limit.period, limit.end)
    table = table_of(table, limit.share, limit.within_m, ticks, stage.dt_s, limit.gains)
    steps = ((Place.SHAPING - 1, hold), (Place.SHAPING, shape))
    return Part('shaping', steps, table, np.zeros(AHEAD + RUNS))


register(Kind('shaping', _part))
