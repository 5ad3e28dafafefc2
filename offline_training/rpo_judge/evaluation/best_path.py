# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The best path found that keeps out of a sphere but for a cone: an upper bound, no proof.

Successive convex programs from a path on. Before a moment of entry the sphere gives way to
half-spaces tangent to it where the path before came closest; from then on the path is in a pyramid
in the cone. The moment is searched to both sides. What is returned is flown tick by tick, and in no
zone at any tick.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rpo_judge.evaluation.bridge import Bridge, Floats, HalfSpaces
from rpo_judge.evaluation.keep_out import SIDES, KeepOut

ROUNDS = 60
"""Convex programs of one moment of entry at most, ..."""

SETTLED = 1e-5
"""... which end when the energy changes by no more than this share."""

NEAR = 1.3
"""A path gets half-spaces where it is nearer to the target than this many radii."""

INSIDE = 0.98
"""Slope of the pyramid in the cone, as a share."""

TOLERANCE_M = 1e-3

LARGER_M = (0.005, 0.01, 0.02, 0.04, 0.08)
"""Between the ticks that programs look at, a path may be nearer: the sphere is drawn so much
larger, and the cone smaller by such a share, until every tick is clear."""


class Found(NamedTuple):
    """A path.

    energy : [N^2 s]; states : (length + 1, 6) [m, m/s] of each tick; forces : (length, 3) [N]
    """

    energy: float
    states: Floats
    forces: Floats

    def keeps(self, zone: KeepOut, limit_n: float) -> bool:
        """Return whether no tick is in a zone, or needs more force on an axis than there is."""
        clear = float(zone.depth_m(self.states[1:-1, :3]).max()) <= 0.0
        return clear and float(np.abs(self.forces).max()) <= limit_n


class _Settled(NamedTuple):
    energy: float
    path: Floats
    spaces: HalfSpaces
    multipliers: Floats


def _settle(
    bridge: Bridge, zone: KeepOut, share: float, path: Floats, entry: int
) -> _Settled | None:
    """Return the best path near a path that is in the cone from a tick of the bridge on."""
    sides, least = zone.pyramid(share)
    first = SIDES if entry < len(path) else 0
    cuts = HalfSpaces(np.full(first, entry), sides[:first], least[:first])
    before = np.inf
    for _ in range(ROUNDS):
        distance = np.linalg.norm(path, axis=1)
        near = np.flatnonzero(distance[: entry + 1] < NEAR * zone.radius_m)
        normals = path[near] / np.maximum(distance[near], 1e-9)[:, None]
        tangent = HalfSpaces(near, normals, np.full(len(near), zone.radius_m))
        spaces = tangent.with_more(cuts)
        energy, multipliers = bridge.least(spaces)
        path = bridge.path_of(spaces, multipliers)
        beyond = least - path[entry:] @ sides.T
        ticks = np.flatnonzero(beyond.max(axis=1, initial=0.0) > TOLERANCE_M)
        worst = beyond[ticks].argmax(axis=1)
        if not len(ticks) and abs(energy - before) <= SETTLED * energy:
            return _Settled(energy, path, spaces, multipliers)
        cuts = cuts.with_more(HalfSpaces(entry + ticks, sides[worst], least[worst]))
        before = energy
    return None


def _search(bridge: Bridge, zone: KeepOut, share: float, path: Floats) -> _Settled | None:
    """Return the best path near a path, over moments of entry."""
    count = len(path)
    if not zone.slope:
        return _settle(bridge, zone, share, path, count)
    outside = np.flatnonzero(zone.beside_m(path) > TOLERANCE_M)
    entry = min(int(outside[-1]) + 1 if len(outside) else 0, count - 1)
    best, step = _settle(bridge, zone, share, path, entry), count // 8
    while step:
        for other in (entry - step, entry + step):
            if 0 <= other < count:
                found = _settle(bridge, zone, share, path if best is None else best.path, other)
                if found is not None and (best is None or found.energy < best.energy):
                    best, entry = found, other
                    break
        else:
            step //= 2
    return best


def best_path(bridge: Bridge, zone: KeepOut, guess: Floats, limit_n: float) -> Found | None:
    """Return the best path of a bridge out of a zone that is found near a path; None if none.

    guess : (n, 3) [m] at the ticks of the bridge
    limit_n : largest force of an axis
    """
    for larger_m in LARGER_M:
        larger = zone._replace(radius_m=zone.radius_m + larger_m)
        best = _search(bridge, larger, INSIDE - larger_m, guess)
        if best is None:
            return None
        forces = bridge.forces(best.spaces, best.multipliers)
        found = Found(bridge.energy(forces), bridge.flown(forces), forces)
        if found.keeps(zone, limit_n):
            return found
        guess = best.path
    return None
