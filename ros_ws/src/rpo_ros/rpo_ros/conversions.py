# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Between ROS messages and the core's floats.

Every float field gets a float: for an int in a float64 field rclpy publishes a wrong number
without a warning.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from nav_msgs.msg import Odometry

from rpo_core.wire.cdr import encode_status
from rpo_core.wire.interfaces import CHASER_FRAME, LVLH_FRAME

_NANOSECONDS = 1_000_000_000
_NOT_UNIT = 1e-3
"""A quaternion whose length differs so much from 1 is none."""


def to_stamp(stamp_ns: int) -> Time:
    """Return a ROS stamp of integer nanoseconds since 1970."""
    seconds, nanoseconds = divmod(stamp_ns, _NANOSECONDS)
    return Time(sec=seconds, nanosec=nanoseconds)


def from_stamp(stamp: Time) -> int:
    """Return nanoseconds since 1970."""
    return int(stamp.sec) * _NANOSECONDS + int(stamp.nanosec)


def to_odometry(stamp_ns: int, state: Sequence[float]) -> Odometry:
    """Return the relative state (x, y, z, vx, vy, vz) [m, m/s], target LVLH, as Odometry.

    `twist.linear` is in target LVLH. Odometry defines it in the child frame: here that has the same
    axes, for the attitude is the identity. A chaser with an attitude of its own has other axes, but
    its plant sends `twist.linear` in target LVLH all the same, and `twist.angular` in the chaser's
    axes, against inertial space: docs/attitude.md says how to read them.
    """
    message = Odometry()
    message.header.stamp = to_stamp(stamp_ns)
    message.header.frame_id = LVLH_FRAME
    message.child_frame_id = CHASER_FRAME
    position, velocity = message.pose.pose.position, message.twist.twist.linear
    position.x, position.y, position.z = (float(value) for value in state[:3])
    velocity.x, velocity.y, velocity.z = (float(value) for value in state[3:])
    message.pose.pose.orientation.w = 1.0
    return message


def from_odometry(message: Odometry) -> tuple[float, ...]:
    """Return (x, y, z, vx, vy, vz) [m, m/s], target LVLH."""
    position, velocity = message.pose.pose.position, message.twist.twist.linear
    return (position.x, position.y, position.z, velocity.x, velocity.y, velocity.z)


def attitude_of(message: Odometry) -> tuple[float, ...] | None:
    """Return quaternion x, y, z, w and rate (3,) of a message; None if that is no attitude.

    The rate is in the axes of the body, against inertial space.
    """
    q, rate = message.pose.pose.orientation, message.twist.twist.angular
    found = (q.x, q.y, q.z, q.w, rate.x, rate.y, rate.z)
    sound = all(map(math.isfinite, found)) and abs(math.hypot(*found[:4]) - 1.0) < _NOT_UNIT
    return found if sound else None


def to_wrench(stamp: Time, force_n: Sequence[float]) -> WrenchStamped:
    """Return a force (3,) [N] in target LVLH axes, with the stamp of its state."""
    message = WrenchStamped()
    message.header.stamp = stamp
    message.header.frame_id = LVLH_FRAME
    force = message.wrench.force
    force.x, force.y, force.z = (float(value) for value in force_n)
    return message


def from_wrench(message: WrenchStamped) -> tuple[float, float, float]:
    """Return the force (fx, fy, fz) [N]."""
    force = message.wrench.force
    return (force.x, force.y, force.z)


def fault_of(message: Odometry | WrenchStamped, values: Iterable[float]) -> str:
    """Return why a message cannot be used, '' if it can: wrong frame, or a number not finite."""
    if message.header.frame_id != LVLH_FRAME:
        return 'wrong_frame'
    return '' if all(math.isfinite(value) for value in values) else 'not_finite'


def values_of(status: DiagnosticStatus) -> dict[str, str]:
    """Return the values of a DiagnosticStatus by key."""
    return {pair.key: pair.value for pair in status.values}


def to_status(
    level: bytes, name: str, message: str, values: Iterable[tuple[str, object]]
) -> DiagnosticStatus:
    """Return a DiagnosticStatus; values become texts, as `texts_of` makes them."""
    return DiagnosticStatus(
        level=level,
        name=name,
        message=message,
        hardware_id='none',
        values=[KeyValue(key=key, value=text) for key, text in texts_of(values)],
    )


def packed_status(name: str, message: str, values: Iterable[tuple[str, object]]) -> bytes:
    """Return a DiagnosticStatus of level OK as bytes, always the same for the same content."""
    return encode_status(0, name, message, 'none', texts_of(values))


def texts_of(values: Iterable[tuple[str, object]]) -> tuple[tuple[str, str], ...]:
    """Return keys and values as texts, floats by repr so that no digit is lost."""
    return tuple([(k, v if isinstance(v, str) else repr(v)) for k, v in values])
