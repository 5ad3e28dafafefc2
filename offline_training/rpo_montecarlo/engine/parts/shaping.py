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
    HoldLimit,
    Shaping,
    ShapingStage,
    followed,
    held,
    largest_ahead,
    shaped,
)

FIT, RATE, CURVE, LARGEST, AHEAD = (PAIRED_LANES * place for place in range(5))
"""Places in the memory of the limit of the hold: value, rate, rate of the rate of the fits; of each
run, the largest disturbance so far, and the largest ahead."""
_GAINS = 7
"""Place of the gains in its table."""


@compiled
def shape(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Replace row FORCE by the shaped command, which the memory keeps."""
    for s in range(PAIRED_LANES):
        m[s] = w[FORCE + s] = shaped(w[FORCE + s], m[s], tick == 0, t[0], t[1], t[2])


@compiled
def hold(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Limit row FORCE in the hold."""
    share, within, begin, act, period, end, dt = t[0], t[1], t[2], t[3], t[4], t[5], t[6]
    if tick >= begin and (tick - begin) % period == 0:
        number = int((tick - begin) // period)
        g = _GAINS + 3 * number
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
    table = table_of(ShapingStage(settings, batch.base).numbers)
    return Part('shaping', ((Place.SHAPING, shape),), table, np.zeros(PAIRED_LANES))


def _hold(batch: Batch) -> Part | None:
    settings = batch.base.section(Shaping)
    limit = HoldLimit.of(settings, batch.base) if settings is not None else None
    if limit is None:
        return None
    ticks = (limit.begin, limit.act, limit.period, limit.end)
    table = table_of(limit.share, limit.within_m, ticks, batch.base.dt_s, limit.gains)
    return Part('hold', ((Place.SHAPING - 1, hold),), table, np.zeros(AHEAD + RUNS))


register(Kind('shaping', _part))
register(Kind('shaping', _hold))
