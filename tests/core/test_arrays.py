# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Sums of products, also over nothing."""

from __future__ import annotations

import numpy as np

from rpo_kernels.arrays import contracted


def test_a_sum_over_an_axis_of_no_length_is_zero_whatever_lies_in_memory():
    foreign = np.full(100, np.nan)
    empty = np.lib.stride_tricks.as_strided(foreign, (5, 0, 2), np.zeros((5, 0, 2)).strides)
    np.testing.assert_array_equal(contracted('kji,j->ki', empty, foreign[:0]), np.zeros((5, 2)))


def test_a_sum_of_products_is_that_of_matrices():
    a, b = np.arange(12.0).reshape(3, 4), np.arange(4.0)
    np.testing.assert_array_equal(contracted('ij,j->i', a, b), a @ b)
