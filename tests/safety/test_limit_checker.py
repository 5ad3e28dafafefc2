# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Persistence counters, against a plain count."""

from hypothesis import given
from hypothesis import strategies as st

from rpo_safety.abort_table import Row
from rpo_safety.limit_checker import LimitChecker


def of(count, window):
    row = Row(quantity='speed_m_s', most=1.0, reaction='warn', count=count, window=window)
    return LimitChecker({'too_fast': row})


@given(st.lists(st.booleans(), max_size=60), st.integers(1, 8), st.integers(0, 8))
def test_a_fault_begins_at_n_of_the_last_m_and_again_after_a_whole_window_without(
    samples, count, more
):
    window = count + more
    watched, holds = of(count, window), False
    for end in range(1, len(samples) + 1):
        seen = sum(samples[max(0, end - window) : end])
        begins = not holds and seen >= count
        holds = (holds and seen > 0) or begins
        assert watched.sample({'too_fast': samples[end - 1]}) == ['too_fast'] * begins
        assert ('too_fast' in watched.holding) == holds


def test_cleared_it_begins_anew():
    watched = of(2, 3)
    for _ in range(2):
        assert [bool(watched.sample({'too_fast': True})) for _ in range(3)] == [False, True, False]
        watched.clear()
