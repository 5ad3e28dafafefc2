# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""All QoS profiles of the stack."""

from rclpy.qos import (
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSProfile,
    QoSReliabilityPolicy,
)

from rpo_core import interfaces


def _reliable(depth: int, durability: QoSDurabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=QoSHistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=QoSReliabilityPolicy.RELIABLE,
        durability=durability,
    )


def of(offered: interfaces.Qos) -> QoSProfile:
    """Return the profile of a row of the table of interfaces."""
    durability = QoSDurabilityPolicy.get_from_short_key(offered.durability)
    return _reliable(offered.depth, durability)


LOCKSTEP = of(interfaces.LOCKSTEP)
"""States and forces."""

RECORDING = _reliable(10_000, QoSDurabilityPolicy.VOLATILE)
"""The recorder's queue for states and forces: some seconds at full speed."""

LATCHED = of(interfaces.LATCHED)
"""Statuses and manifests: who comes late still learns the last one."""

LATCHED_QUEUE = _reliable(16, QoSDurabilityPolicy.TRANSIENT_LOCAL)
"""To subscribe to latched topics where none may be missed, or several nodes publish."""

CLOCK = _reliable(64, QoSDurabilityPolicy.VOLATILE)
"""Simulated time; stock subscribers ask for best effort, which this satisfies."""

DIAGNOSTICS = _reliable(10, QoSDurabilityPolicy.VOLATILE)

IN_LOOP = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=64,
    reliability=QoSReliabilityPolicy.BEST_EFFORT,
    durability=QoSDurabilityPolicy.VOLATILE,
)
"""As plant and answering nodes hear each other. A reliable reader holds back what follows a lost
message until DDS has repaired it, seconds later on a bad link; here a lost one is sent again by the
plant, or its successor does."""

NEWEST = QoSProfile(
    history=QoSHistoryPolicy.KEEP_LAST,
    depth=1,
    reliability=QoSReliabilityPolicy.BEST_EFFORT,
    durability=QoSDurabilityPolicy.VOLATILE,
)
"""For viewers: they look now and then, and no sender repeats anything for them."""

TF = _reliable(100, QoSDurabilityPolicy.VOLATILE)
"""As tf2's broadcasters publish."""
