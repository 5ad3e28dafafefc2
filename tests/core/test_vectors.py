# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Scalar kernels for many flights at once: the bits of each flight alone, where they differ too."""

from __future__ import annotations

from math import sqrt
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rpo_core.assurance.doubt import doubt_at
from rpo_core.assurance.filters import guard_at
from rpo_core.attitude.attitude_kernels import attitude_at, frame_at
from rpo_core.attitude.chaser import craft_at
from rpo_core.kernels import jit
from rpo_core.kernels.arrays import contracted
from rpo_core.kernels.jit import as_table
from rpo_core.kernels.vectors import WIDTH, aligned, lanes_at, over_runs, own_tables, pick, wide
from rpo_core.world.cw import unpacked

RUNS, SETTINGS, MEMORY = 16, 3, 4


@jit.compiled
def act(tick, w, m, s, own, memory):  # type: ignore[no-untyped-def]
    """Use all that vectors know; memory[0] counts, memory[3] is scratch; `own[1]` decides."""
    memory[3] = memory[1]
    memory[0] += 1.0
    x, wrong = w[s], 0
    if own[1] > 0.5:
        memory[1] -= -abs(x) * own[0] + -x
    else:
        memory[1] = sqrt(abs(x / 3)) + tick
    wrong += memory[1] != memory[1]
    for i in range(int(own[2])):
        memory[2] += pick(x <= memory[3], x, -2.0) / (i + 1 + wrong)
    w[RUNS + s] = memory[2] if not x > 1e6 else 0.0
    m[s] = memory[1]


all_runs = over_runs(act, RUNS)
numbers = arrays(np.float64, RUNS, elements=st.floats(-1e3, 1e3))


def flown(width: int, x: Any, own: Any, ticks: int = 3) -> tuple[Any, Any]:
    """Return the scratch (2, RUNS) and memories (MEMORY, RUNS) after some ticks."""
    memories = np.arange(MEMORY * RUNS, dtype=float).reshape(MEMORY, RUNS)
    table, memory = own_tables(width, np.zeros(0), own, np.zeros(RUNS), memories, 3, range(1))
    w, m = aligned(np.concatenate([x, np.zeros(RUNS)])), aligned(memory)
    for tick in range(ticks):
        all_runs(w, m, table, tick)
    rows = m[RUNS:][: memories.size].reshape(-1, MEMORY, width).transpose(1, 0, 2)
    return w.reshape(2, -1), np.vstack([rows.reshape(MEMORY, -1)[:3], m[:RUNS]])


@settings(deadline=None)
@given(numbers, numbers, st.sampled_from([0.0, 1.0, None]), st.integers(0, 5))
def test_flights_that_are_computed_together_have_the_bits_of_each_alone(
    x: Any, share: Any, branch: float | None, count: int
) -> None:
    """Of branches that all take, and of such (None) that flights take by themselves."""
    decides = (np.arange(RUNS) % 3 > 0).astype(float) if branch is None else np.full(RUNS, branch)
    own = np.stack([share, decides, np.full(RUNS, count)])
    together, alone = flown(WIDTH, x, own), flown(1, x, own)
    for a, b in zip(together, alone, strict=True):
        assert a.tobytes() == b.tobytes()
    assert (together[1][0] == np.arange(RUNS) + 3).all()


@pytest.mark.parametrize('count', [(1.0, 1.0), (1.0, 2.0)])
@pytest.mark.parametrize('branch', [(1.0, 1.0), (0.0, 1.0)])
def test_a_vector_takes_one_branch_and_one_count_or_raises(
    count: tuple[float, float], branch: tuple[float, float]
) -> None:
    """A wrong branch would be silent otherwise."""

    @jit.compiled
    def once(w, m, own):  # type: ignore[no-untyped-def]
        act(0, wide(w), wide(m), 0, lanes_at(own, 0), lanes_at(m, WIDTH))

    w, m = np.zeros(2 * RUNS), np.zeros(9 * WIDTH)
    own = np.ones((SETTINGS, WIDTH))
    own[1, 1:], own[1, 0] = branch
    own[2, :-1], own[2, -1] = count
    if WIDTH == 1 or (count[0] == count[1] and branch[0] == branch[1]):
        once(w, m, own.ravel())
        assert (m[WIDTH : 2 * WIDTH] == 1.0).all()
        return
    with pytest.raises(ArithmeticError, match='flights differ'):
        once(w, m, own.ravel())


@pytest.mark.parametrize(
    ('read', 'steps'),
    [(unpacked, 2), (frame_at, 2), (attitude_at, 2), (craft_at, 2),
     (doubt_at, None), (guard_at, None)],
    ids=lambda value: getattr(value, '__name__', ''),
)  # fmt: skip
def test_records_are_read_from_tables_in_their_order(read, steps):
    table = as_table(np.arange(100.0))
    found = read(table, 3, steps) if steps else read(table, 3)
    flat = np.hstack([np.ravel(value) for value in found])
    np.testing.assert_array_equal(flat, 3.0 + (steps or 1) * np.arange(len(flat)))


def test_a_sum_over_an_axis_of_no_length_is_zero_whatever_lies_in_memory():
    foreign = np.full(100, np.nan)
    empty = np.lib.stride_tricks.as_strided(foreign, (5, 0, 2), np.zeros((5, 0, 2)).strides)
    np.testing.assert_array_equal(contracted('kji,j->ki', empty, foreign[:0]), np.zeros((5, 2)))
