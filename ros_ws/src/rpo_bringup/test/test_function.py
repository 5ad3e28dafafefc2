# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The path of a run, as the views draw it."""

from itertools import pairwise

from rpo_bringup.views.live import Trail


def test_a_trail_keeps_its_ends_and_its_bound_and_stays_even():
    """However long a run is, the points are few."""
    trail = Trail(most=10)
    for step in range(1000):
        trail.add((float(step), 0.0, 0.0))
    assert trail.points[0] == (0.0, 0.0, 0.0)
    assert 2 <= len(trail.points) <= 10
    gaps = [b[0] - a[0] for a, b in pairwise(trail.points)]
    assert max(gaps) < 2.5 * min(gaps)
