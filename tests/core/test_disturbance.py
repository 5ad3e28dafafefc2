# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The paper's disturbance, read twice, the harmonic model behind it; noise that is drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from rpo_core.kernels import noise
from rpo_core.world import cw
from rpo_core.world.disturbance import NONE, Disturbance, Harmonic, paper

N = cw.mean_motion(6.678e6)
TIMES_S = np.arange(4001) * 0.1


@pytest.mark.parametrize(('reading', 'phase', 'offset'), [('offset', 0, 1), ('phase', 1, 0)])
def test_a_reading_is_its_formula(reading, phase, offset):
    """As printed, or with the offset moved into the sine."""
    third = math.pi / 3
    for t, force in zip(TIMES_S, paper(reading, N).over(range(4001), 10**8), strict=True):
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


def test_nothing_is_zero():
    assert NONE.is_zero and NONE.over([12], 10**9).tolist() == [[0.0, 0.0, 0.0]]
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
    assert got.over([7], 10**9)[0] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ('counter', 'key', 'words'),
    [  # the known answers that come with Random123
        ((0,) * 4, (0,) * 2, '6627e8d5 e169c58d bc57ac4c 9b00dbd8'),
        ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, '408f276d 41c83b0e a20bc7c6 6d5451fd'),
        (
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xA4093822, 0x299F31D0),
            'd16cfe09 94fdcceb 5001e420 24126ea1',
        ),
    ],
)
def test_philox_gives_the_known_answers(counter, key, words):
    for function in (noise.philox, getattr(noise.philox, 'py_func', noise.philox)):
        assert ' '.join(f'{w:08x}' for w in function(*counter, *key)) == words


@settings(max_examples=100)
@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_a_pair_of_normals_is_that_of_box_and_muller(a, b):
    radius = np.sqrt(-2.0 * np.log((a + 0.5) / 2**32))
    angle = 2.0 * np.pi * (b + 0.5) / 2**32 - np.pi / 4.0
    # The quarter of the circle comes from the first bits; the angle from its middle.
    expected = radius * np.sin(angle), radius * np.cos(angle)
    assert noise.normal_pair(a, b) == pytest.approx(expected, abs=2e-14)
    assert noise.log_unit(a) == pytest.approx(np.log((a + 0.5) / 2**32), rel=1e-15)
    interpreted = getattr(noise.normal_pair, 'py_func', noise.normal_pair)
    assert interpreted(a, b) == noise.normal_pair(a, b)


def test_noise_is_normal_white_and_independent():
    sample = np.array([noise.six_normals(t, 7, k) for k in range(4) for t in range(2000)])
    assert stats.kstest(sample.ravel(), 'norm').pvalue > 1e-3
    correlation = np.corrcoef(np.hstack([sample[:-1], sample[1:]]).T) - np.eye(12)
    assert np.abs(correlation).max() < 5.0 / np.sqrt(len(sample))
