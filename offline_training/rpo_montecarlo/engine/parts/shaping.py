# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Command shaping side by side: the kernels of that room."""

from __future__ import annotations

from typing import Any

import numpy as np

from rpo_core.chain.stage import Place
from rpo_montecarlo.engine.lanes import (
    FORCE,
    FOUND_PUSH,
    MEASURED_V,
    PAIRED_LANES,
    RUNS,
    SEEN_R,
    SEEN_V,
    compiled,
)
from rpo_montecarlo.engine.parts.attitude import vector_in
from rpo_montecarlo.engine.tick import Batch, Kind, Part, register, table_of
from rpo_safety.learning import ACT, BEGIN, NUMBERS, PERIOD, foresee, given_way, learn
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

GAINS = 11
"""Place of the gains of the limit of the hold in the table, value by value, run by run: its other
numbers, and how many gains a run has, are before them, and before those the numbers of the
shaping."""
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
        number, span = int((tick - begin) // period), min(AHEAD_S, (end - tick) * dt)
        for s in range(PAIRED_LANES):
            g = GAINS + int(t[10]) * (s % RUNS) + 3 * number
            gains, before = (t[g], t[g + 1], t[g + 2]), (m[FIT + s], m[RATE + s], m[CURVE + s])
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


@compiled
def give_way(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Limit row FORCE in the hold by what is learnt; the tables of the runs follow each other."""
    size = int(t[3])
    for s in range(RUNS):
        numbers, own = t[4 + size * s : 4 + size * (s + 1)], PAIRED_LANES + NUMBERS * s
        memory, begin = m[own : own + NUMBERS], numbers[BEGIN]
        r, v = vector_in(w, SEEN_R, s), vector_in(w, SEEN_V, s)
        learn(tick, vector_in(m, 0, s), r, v, vector_in(w, MEASURED_V, s), memory, numbers)
        if tick < begin:
            continue
        if (tick - begin) % numbers[PERIOD] == 0.0:
            foresee(tick, r, v, memory, numbers)
        for axis in range(3):
            lane, acts = FORCE + RUNS * axis + s, tick >= numbers[ACT]
            w[lane] = given_way(acts, w[lane], r[axis], v[axis], axis, memory, numbers)


def _part(batch: Batch) -> Part | None:
    settings = batch.base.section(Shaping)
    if settings is None:
        return None
    stage = ShapingStage(settings, batch.base)
    limit, table = stage.hold, table_of(stage.numbers)
    if limit is None:
        return Part('shaping', ((Place.SHAPING, shape),), table, np.zeros(PAIRED_LANES))
    steps = ((Place.SHAPING - 1, hold), (Place.SHAPING, shape))
    limits: Any = [HoldLimit.of(settings, scenario) for scenario in batch.scenarios]
    limits += [limit] * (RUNS - len(limits))
    if limit.learnt is not None:
        learnt = [found.learnt for found in limits]
        rows = [table_of(settings) for settings, _ in learnt]
        memory = table_of(np.zeros(PAIRED_LANES), *(memory for _, memory in learnt))
        steps = ((Place.SHAPING - 1, give_way), (Place.SHAPING, shape))
        return Part('shaping', steps, table_of(table, len(rows[0]), *rows), memory)
    ticks = (limit.begin, limit.act, limit.period, limit.end)
    table = table_of(table, limit.share, limit.within_m, ticks, stage.dt_s, limit.gains.size)
    table = table_of(table, *(found.gains for found in limits))
    return Part('shaping', steps, table, np.zeros(AHEAD + RUNS))


register(Kind('shaping', _part))
