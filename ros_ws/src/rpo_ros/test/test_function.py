# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Messages and numbers."""

from rpo_ros import conversions

STATE = (10.0, 60.0, -40.0, 0.1, -0.2, 0.3)


def test_a_state_goes_through_its_message():
    """Frame and stamp are those of the state."""
    message = conversions.to_odometry(1_500_000_000, STATE)
    assert conversions.from_odometry(message) == STATE
    assert conversions.from_stamp(message.header.stamp) == 1_500_000_000
    assert conversions.fault_of(message, STATE) == ''
    assert conversions.fault_of(message, (float('nan'),)) == 'not_finite'
