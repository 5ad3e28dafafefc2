# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The disturbance of flights side by side: from a table, or harmonics of each run."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rpo.engine.lanes import PAIRED_LANES, PUSH, RUNS, compiled
from rpo.engine.tick import LIMITED, Batch, Kind, Part, Runs, register, table_of
from rpo_core.judge.metrics import larger
from rpo_core.kernels.arithmetic import sin_cos
from rpo_core.kernels.arrays import Floats

TICKS, HARMONICS, TIMES = range(3)
"""Places in the table of waves; then times [s], the constant part [N] of each lane, and, of each
harmonic, its axis, whether it is a sine, and for each run amplitude [N], rate [rad/s], phase
[rad]."""

_WAVE = 2 + 3 * RUNS


@compiled
def push_by_table(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill row PUSH from a table; one that has a single row is read once."""
    n = int(t[0])
    if 1 + n * tick < len(t):
        for s in range(n):
            w[PUSH + s] = t[1 + n * tick + s]


def table_part(table: Floats) -> Part:
    """Return the part of a disturbance (ticks, lanes) [N]; (1, lanes): always the same."""
    return Part('disturbance', ((LIMITED, push_by_table),), table_of(table.shape[1], table))


@compiled
def push_by_waves(w, m, t, tick):  # type: ignore[no-untyped-def]
    """Fill row PUSH by the harmonics of each run, as `Disturbance.force_n` adds them up.

    The memory has the largest |push| of an axis so far.
    """
    time, constant = t[TIMES + tick], t[TIMES + int(t[TICKS]) :]
    for s in range(PAIRED_LANES):
        w[PUSH + s] = constant[s]
    for h in range(int(t[HARMONICS])):
        wave = constant[PAIRED_LANES + _WAVE * h :][:_WAVE]
        row, is_sine = PUSH + int(wave[0]) * RUNS, wave[1] > 0.0
        for s in range(RUNS):
            sine, cosine = sin_cos(wave[2 + RUNS + s] * time + wave[2 + 2 * RUNS + s])
            w[row + s] += wave[2 + s] * (sine if is_sine else cosine)
    for s in range(RUNS):
        x, y, z = w[PUSH + s], w[PUSH + RUNS + s], w[PUSH + 2 * RUNS + s]
        m[s] = larger(larger(larger(m[s], x), y), z)


def _part(batch: Batch) -> Part:
    """Return the disturbance of runs whose share, phase and frequency were drawn."""
    nominal, times = batch.base.disturbance, batch.base.times_s
    share, phase, frequency = batch.columns(
        'disturbance_amplitude_share', 'disturbance_phase_rad', 'disturbance_frequency_share'
    )
    flown = np.arange(RUNS) < len(batch.starts)
    constant = [force * (1.0 + share) * flown for force in nominal.constant_n]
    waves = [
        table_of(
            'xyz'.index(h.axis),
            h.function == 'sin',
            h.amplitude_n * (1.0 + share) * flown,
            h.angular_rate_rad_s * (1.0 + frequency) * flown,
            (h.phase_rad + phase) * flown,
        )
        for h in nominal.harmonics
    ]
    table = table_of(len(times), len(waves), times, *constant, *waves)
    return Part('disturbance', ((LIMITED, push_by_waves),), table, np.zeros(RUNS))


def levels_n(runs: Runs, memories: Mapping[str, Floats], w: Floats) -> Floats:
    """Return the largest |disturbance| [N] of an axis (40,) of drawn runs that have flown.

    That at the end of a flight moves nothing, but counts.
    """
    table = next(part.table for part in runs.parts if part.name == 'disturbance')
    push_by_waves(w, memories['disturbance'], table, int(table[TICKS]) - 1)
    return memories['disturbance']


register(Kind('', _part))
