# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages and floats: round trips, and the garbage that rclpy makes of an int."""

import os

os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'  # read when the message modules are imported

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from rpo_ros import conversions

FLOATS = st.floats(allow_nan=False)
STAMPS = st.integers(0, 2**31 * 10**9 - 1)


@given(STAMPS, st.lists(FLOATS, min_size=6, max_size=6))
def test_a_state_round_trips_bit_for_bit_over_the_wire(stamp_ns, state):
    sent = conversions.to_odometry(stamp_ns, state)
    got = deserialize_message(serialize_message(sent), type(sent))
    assert conversions.from_odometry(got) == tuple(state)
    assert conversions.from_stamp(got.header.stamp) == stamp_ns
    assert got.pose.pose.orientation.w == 1.0


@given(STAMPS, st.lists(FLOATS, min_size=3, max_size=3))
def test_a_force_round_trips_bit_for_bit_over_the_wire(stamp_ns, force):
    sent = conversions.to_wrench(conversions.to_stamp(stamp_ns), force)
    got = deserialize_message(serialize_message(sent), type(sent))
    assert conversions.from_wrench(got) == tuple(force)
    assert conversions.from_stamp(got.header.stamp) == stamp_ns


@pytest.mark.parametrize('kind', [int, np.float32, np.int64, bool])
def test_other_number_types_arrive_as_floats(kind):
    sent = conversions.to_odometry(0, [kind(1)] * 6)
    got = deserialize_message(serialize_message(sent), type(sent))
    assert conversions.from_odometry(got) == (1.0,) * 6


@pytest.mark.parametrize(
    ('value', 'frame', 'fault'),
    [
        (0.0, 'target_lvlh', ''),
        (0.0, 'map', 'wrong_frame'),
        *((value, 'target_lvlh', 'not_finite') for value in (math.nan, math.inf, -math.inf)),
    ],
)
def test_a_message_that_cannot_be_used_says_why(value, frame, fault):
    message = conversions.to_wrench(conversions.to_stamp(1), (0.0, value, 0.0))
    message.header.frame_id = frame
    assert conversions.fault_of(message, conversions.from_wrench(message)) == fault
