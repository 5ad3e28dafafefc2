# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Navigation noise: the generator's known answers, Box and Muller's normals, whiteness."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from rpo_core.kernels import noise


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
