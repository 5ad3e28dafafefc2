# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A transfer around the target, without ROS."""

import math

from rpo_core.world import cw
from rpo_guidance.transfers import SLACK_M, Limits, least_energy


def test_a_transfer_arrives_and_keeps_out_of_the_sphere():
    """From behind the target to rest ahead of it."""
    start, end = (0.0, -80.0, 0.0, 0.0, 0.0, 0.0), (0.0, 40.0, 0.0, 0.0, 0.0, 0.0)
    step = cw.discretise(cw.mean_motion(6_678_000.0), 10.0, 10.0)
    found = least_energy(start, end, step, 40, Limits(13.0))
    arrived = found.states[-1].tolist()
    assert all(math.isclose(a, b, abs_tol=1e-6) for a, b in zip(arrived, end, strict=True))
    assert min(math.hypot(*row[:3]) for row in found.states.tolist()) >= 13.0 - SLACK_M
