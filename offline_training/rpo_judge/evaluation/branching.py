# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""A lower bound of the energy of all paths that keep out of a sphere but for a cone.

The zones are not convex: on which side a path passes, and when it enters the cone, is open. At any
one moment a path is in the cone, or it is out of the sphere in one of eight octants. So the paths
fall into nine sets, each of which lies in a convex one: the cone in the pyramid of planes about it;
an octant out of the sphere beyond the plane through the three corners of its spherical triangle.
The least energy in each convex set is at most that of the paths in it. Branch and bound: the set
with the lowest value is split at the moment when its path is deepest in the zone; a triangle is
split into four. The lowest value of all sets that are left is below every path.
"""

from __future__ import annotations

from functools import cached_property
from heapq import heappop, heappush
from itertools import product
from typing import NamedTuple

import numpy as np

from rpo_judge.evaluation.bridge import Bridge, Floats, HalfSpaces
from rpo_judge.evaluation.keep_out import KeepOut

SETS = 2000
"""It ends after so many sets were split, ..."""

DEPTH_M = 0.1
"""... or when the path of the lowest set is nowhere deeper in the zone."""

ROUNDING = 1e-6
"""Share that the bound is lowered by, for rounding of the Gramians."""


class Lower(NamedTuple):
    """A lower bound.

    energy : [N^2 s], no path needs less
    path : (n, 3) [m] of the set that has it, perhaps somewhat in the zone
    closed : whether it is in the zone nowhere by more than DEPTH_M, so that the bound is near
    """

    energy: float
    path: Floats
    closed: bool


class _Triangle:
    """A triangle of directions (3, 3): beyond the plane of its corners, at a radius of 1."""

    def __init__(self, corners: Floats) -> None:
        self._corners = corners

    @cached_property
    def planes(self) -> tuple[Floats, Floats]:
        """Planes n . r >= b at a radius of 1: of its corners, and of its sides."""
        a, b, c = self._corners
        normals = np.array([np.cross(b - a, c - a), np.cross(a, b), np.cross(b, c), np.cross(c, a)])
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        normals *= np.sign(normals @ self._corners.sum(axis=0))[:, None]
        return normals, np.array([normals[0] @ a, 0.0, 0.0, 0.0])

    @cached_property
    def parts(self) -> list[_Triangle]:
        """Four triangles that make it up."""
        a, b, c = self._corners
        ab, bc, ca = (m / np.linalg.norm(m) for m in (a + b, b + c, c + a))
        parts = ((a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca))
        return [_Triangle(np.array(part)) for part in parts]


_OCTANTS = [_Triangle(np.diag(signs)) for signs in product((1.0, -1.0), repeat=3)]

_Set = dict[int, _Triangle | None]
"""Where a path is at some of the ticks of the bridge: beyond a triangle, or, None, in the cone."""


def _spaces(chosen: _Set, zone: KeepOut, pyramid: tuple[Floats, Floats]) -> HalfSpaces:
    """Return the half-spaces of a set."""
    planes = [pyramid if part is None else part.planes for part in chosen.values()]
    radii = [1.0 if part is None else zone.radius_m for part in chosen.values()]
    return HalfSpaces(
        np.repeat(list(chosen), [len(least) for _, least in planes]),
        np.concatenate([normals for normals, _ in planes]),
        np.concatenate([least * radius for (_, least), radius in zip(planes, radii, strict=True)]),
    )


def _depth_m(chosen: _Set, zone: KeepOut, path: Floats) -> Floats:
    """Return how deep (n,) [m] a path of a set is in the zone at each tick, as the set has it."""
    depth = zone.depth_m(path)
    for j, part in chosen.items():
        depth[j] = -np.inf if part is None else zone.radius_m - float(np.linalg.norm(path[j]))
    return depth


def lower_bound(bridge: Bridge, zone: KeepOut) -> Lower:
    """Return a lower bound of the energy of all paths of a bridge out of a zone."""
    pyramid = zone.pyramid()
    first: list[_Triangle | None] = [*([None] if zone.slope else []), *_OCTANTS]
    sets: list[tuple[float, int, _Set, Floats]] = [(bridge.free, 0, {}, np.zeros(0))]
    made = 1
    for splits in range(SETS + 1):
        energy, _, chosen, multipliers = sets[0]
        path = bridge.path
        if chosen:
            path = bridge.path_of(_spaces(chosen, zone, pyramid), multipliers)
        depth = _depth_m(chosen, zone, path)
        deepest = int(depth.argmax())
        closed = bool(depth[deepest] <= DEPTH_M)
        if closed or splits == SETS:
            break
        heappop(sets)
        part = chosen.get(deepest)
        for smaller in first if part is None else part.parts:
            following = {**chosen, deepest: smaller}
            value, multipliers = bridge.least(_spaces(following, zone, pyramid))
            heappush(sets, (max(energy, value), made, following, multipliers))
            made += 1
    return Lower(energy * (1.0 - ROUNDING), path, closed)
