# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's disturbance, read twice, and the harmonic model behind it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpo_core.world import cw
from rpo_core.world.disturbance import NONE, Disturbance, Harmonic, paper

N = cw.mean_motion(6.678e6)
TIMES_S = np.arange(4001) * 0.1


@pytest.mark.parametrize(('reading', 'phase', 'offset'), [('offset', 0, 1), ('phase', 1, 0)])
def test_a_reading_is_its_formula(reading, phase, offset):
    """As printed, or with the offset moved into the sine."""
    third = math.pi / 3
    for t, force in zip(TIMES_S, paper(reading, N).over(TIMES_S), strict=True):
        angle = math.pi * N * t
        y = -2.2 * math.sin(angle + phase * third) + offset * third
        expected = [-1.1 * math.cos(angle), y, 1.4 * math.cos(angle)]
        assert force == pytest.approx(1e-2 * np.array(expected), abs=2e-17)


harmonics = st.builds(
    Harmonic,
    st.sampled_from('xyz'),
    st.sampled_from(['sin', 'cos']),
    st.floats(-1, 1),
    st.floats(-10, 10),
    st.floats(-97, 97),
)
constants = st.tuples(*[st.floats(-1, 1)] * 3)


@given(constants, st.lists(harmonics, max_size=3), st.lists(st.floats(0, 1e4), max_size=5))
def test_over_is_force_n_at_each_time(constant, terms, times_s):
    disturbance = Disturbance(constant, tuple(terms))
    forces = disturbance.over(np.array(times_s))
    assert forces.shape == (len(times_s), 3)
    assert [tuple(row) for row in forces] == [disturbance.force_n(t) for t in times_s]


def test_nothing_is_zero():
    assert NONE.is_zero and NONE.force_n(12.0) == (0.0, 0.0, 0.0)
    assert Disturbance(harmonics=(Harmonic('x', 'sin', 0.0, 1.0),)).is_zero
    assert not Disturbance((0.0, 1e-9, 0.0)).is_zero
    assert not Disturbance(harmonics=(Harmonic('x', 'sin', 1e-9, 1.0),)).is_zero


@given(
    constants,
    st.lists(harmonics, max_size=6),
    st.floats(-0.9, 2) | st.just(0.0),
    st.floats(-3, 3) | st.just(0.0),
    st.floats(-0.9, 0.0),
)
def test_a_varied_one_is_the_formula_with_other_numbers(constant, terms, share, phase, faster):
    got = Disturbance(constant, tuple(terms)).varied(share, phase_rad=phase, frequency_share=faster)
    expected = [(1.0 + share) * c for c in constant]
    for term in terms:
        function = math.sin if term.function == 'sin' else math.cos
        angle = term.angular_rate_rad_s * (1.0 + faster) * 7.0 + term.phase_rad + phase
        expected['xyz'.index(term.axis)] += (1.0 + share) * term.amplitude_n * function(angle)
    assert got.force_n(7.0) == pytest.approx(expected, abs=1e-12)
