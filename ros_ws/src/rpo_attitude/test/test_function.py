# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Angles between attitudes, without ROS."""

import math

import pytest

from rpo_attitude import turns


def test_a_quarter_turn_is_90_degrees():
    """It leads x to y, and a rate of one of two bodies is the error of the other."""
    quarter, still = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)), (0.0, 0.0, 0.0)
    assert turns.turned((1.0, 0.0, 0.0), quarter) == pytest.approx([0.0, 1.0, 0.0])
    angle, rate = turns.apart((*quarter, *still), (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.1))
    assert (angle, rate) == pytest.approx((math.pi / 2.0, 0.1))
