# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Bytes of messages with a state or a force, and frames as a test likes."""

from __future__ import annotations

from collections.abc import Sequence

from rpo_core.wire import interfaces
from rpo_core.wire.cdr import ODOMETRY, WRENCH, Layout

_STATE, _FORCE = (interfaces.row_of(name).columns for name in ('relative_state', 'control_force'))


def odometry(stamp_ns: int, frame_id: str, child_frame_id: str, state: Sequence[float]) -> bytes:
    """Return an Odometry of a state (6,), without rotation."""
    return Layout.of(ODOMETRY, (frame_id, child_frame_id), _STATE).encode(stamp_ns, state)


def wrench(stamp_ns: int, frame_id: str, force_n: Sequence[float]) -> bytes:
    """Return a WrenchStamped of a force (3,), without torque."""
    return Layout.of(WRENCH, (frame_id,), _FORCE).encode(stamp_ns, force_n)
