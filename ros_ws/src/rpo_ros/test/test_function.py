# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A status as a message and as bytes."""

from rclpy.serialization import serialize_message

from rpo_core.wire import cdr
from rpo_ros import signals

VALUES = [('phase', 'to the port'), ('tick', 7), ('distance_m', 0.1)]


def test_the_bytes_of_a_status_are_those_of_its_message():
    """Numbers become texts without loss of a digit."""
    message = signals.to_status(b'\x00', 'plant', 'flying', VALUES)
    assert [pair.value for pair in message.values] == ['to the port', '7', '0.1']
    written = cdr.canonical('diagnostic_msgs/msg/DiagnosticStatus', serialize_message(message))
    assert signals.packed_status('plant', 'flying', VALUES) == written
