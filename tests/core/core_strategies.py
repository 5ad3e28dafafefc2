# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""What hypothesis draws: membership functions, rule tables, whole systems."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from rpo_core.control.fuzzy import FuzzySystem, MembershipFunctions, RuleTable

unit = st.floats(-1.0, 1.0)
"""A normalised error."""


def _functions(shares: list[float], z: float, large: float) -> MembershipFunctions:
    left, centre, right = sorted(shares)
    return MembershipFunctions(z, left, centre, right, large)


functions = st.builds(
    _functions,
    st.lists(st.floats(0.0, 1.0), min_size=3, max_size=3).filter(
        lambda feet: sorted(feet)[1] > 0.0 and min(feet) < max(feet)
    ),
    st.floats(0.0, 1.0, exclude_min=True),
    st.floats(0.0, 1.0, exclude_max=True),
)
"""Any membership functions that are allowed, vertical edges and slivers included."""


smooth_functions = st.builds(
    lambda left, rise, fall, z, large: MembershipFunctions(
        z, left, min(left + rise, 0.9), min(left + rise, 0.9) + fall, large
    ),
    st.floats(0.0, 0.5),
    st.floats(0.05, 0.5),
    st.floats(0.05, 0.1),
    st.floats(0.05, 1.0),
    st.floats(0.0, 0.95),
)
"""Without vertical edges: every slope is at most 20."""

words = st.integers(0, 4)


def _transpose_symmetric(lower: list[int]) -> RuleTable:
    codes = np.zeros((5, 5), dtype=int)
    codes[np.tril_indices(5)] = lower
    return RuleTable.from_codes(np.maximum(codes, codes.T))


def _odd(half: list[int]) -> RuleTable:
    return RuleTable.from_codes(np.array([*half, 2, *(4 - np.array(half[::-1]))]).reshape(5, 5))


free_rules = st.lists(words, min_size=25, max_size=25).map(
    lambda codes: RuleTable.from_codes(np.array(codes).reshape(5, 5))
)
symmetric_rules = st.lists(words, min_size=15, max_size=15).map(_transpose_symmetric)
odd_rules = st.lists(words, min_size=12, max_size=12).map(_odd)


paper_samples = st.just(101)


def systems(rules=free_rules, parts=functions, samples=paper_samples):
    """Return a strategy of fuzzy systems."""
    return st.builds(FuzzySystem, parts, parts, parts, rules, samples)
