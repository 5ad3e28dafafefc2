# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""All QoS profiles of the stack."""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from rpo_core.wire import interfaces


def _profile(depth: int, *, latched: bool = False, reliable: bool = True) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def of(offered: interfaces.Qos) -> QoSProfile:
    """Return the profile of a row of the table of interfaces."""
    return _profile(offered.depth, latched=offered.durability == 'transient_local')


LOCKSTEP = of(interfaces.LOCKSTEP)
"""States, forces, and simulated time."""

RECORDING = _profile(10_000)
"""The recorder's queue for states and forces: some seconds at full speed."""

LATCHED = of(interfaces.LATCHED)
"""Statuses and manifests: a late subscriber still gets the last one."""

LATCHED_QUEUE = _profile(16, latched=True)
"""To subscribe to latched topics where no message may be lost, or several nodes publish."""

IN_LOOP = _profile(64, reliable=False)
"""For subscriptions of the plant and the answering nodes. After a lost message a reliable reader
waits until DDS has repaired it, seconds on a bad link. Here the plant sends the state again, or the
next message supersedes the lost one."""

NEWEST = _profile(32, reliable=False)
"""For viewers: they look from time to time, and no sender repeats a message for them. Of the last
messages of each topic some are of one tick."""

TF = _profile(100)
"""As tf2's broadcasters publish."""
