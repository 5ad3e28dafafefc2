# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Zones about the target: keep-out sphere, corridor, port, points of a plan.

A section of a scenario that has zones says so (`rpo_core.chain.stage.Section`); pages, RViz and
reports draw what `zones_of` returns, and know no section by its name. `deepest_m` judges who enters
one. Nothing here shapes a flight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpo_core.chain.stage import section_of

Vector = tuple[float, ...]
Floats = NDArray[np.float64]

AT_PORT_M = 0.1
"""So near to its axis, a chaser is in a corridor whose tip has no width."""

PARTS = 8
"""Moments of a tick at which a path is judged, its end included."""

RIM_POINTS = 36
_EDGES = 8


@dataclass(frozen=True)
class Corridor:
    """A cone about an axis, cut off at its tip where it has a width there.

    tip_m : (3,) target LVLH, the port; ahead : (3,) unit vector from there outward
    slope : tangent of the half angle; length_m : along the axis
    half_width_m : at the tip
    square : whether its walls are four planes along the axes of LVLH, and it is drawn as the cone
        between them; the axis is then one of LVLH too
    """

    tip_m: Vector
    ahead: Vector
    slope: float
    length_m: float
    half_width_m: float = 0.0
    square: bool = False

    @property
    def end_m(self) -> Vector:
        """Middle (3,) of the wide end."""
        pairs = zip(self.tip_m, self.ahead, strict=True)
        return tuple(tip + self.length_m * a for tip, a in pairs)

    @property
    def end_half_width_m(self) -> float:
        """Half of the width at the wide end."""
        return self.half_width_m + self.slope * self.length_m

    def outside_m(self, position_m: Vector) -> float:
        """Return how far a point (3,) lies outside the walls, across the axis; < 0 inside."""
        along, across = self.along_and_across(np.array([position_m]))
        return float(across[0] - along[0] * self.slope) - self.half_width_m

    def along_and_across(self, positions_m: Floats) -> tuple[Floats, Floats]:
        """Return distances (n,) from the tip along the axis, and from the axis, of points (n, 3).

        Of a square corridor, the second is the larger of both axes.
        """
        away = positions_m - np.array(self.tip_m)
        x, y, z = self.ahead
        along = x * away[:, 0] + y * away[:, 1] + z * away[:, 2]
        rest = away - along[:, None] * np.array(self.ahead)
        across = np.abs(rest).max(axis=1) if self.square else np.linalg.norm(rest, axis=1)
        return along, across

    def edges(self, right: int, up: int) -> list[tuple[Vector, Vector]]:
        """Return both edges in the plane of two axes, each from the tip to the wide end.

        Empty where the axis stands upright on the plane.
        """
        x, y = self.ahead[right], self.ahead[up]
        size = math.hypot(x, y)
        if size < 1e-9:
            return []
        side, end = (-y / size, x / size), self.end_m
        return [
            (
                (self.tip_m[right] + near * side[0], self.tip_m[up] + near * side[1]),
                (end[right] + far * side[0], end[up] + far * side[1]),
            )
            for near, far in (
                (sign * self.half_width_m, sign * self.end_half_width_m) for sign in (1.0, -1.0)
            )
        ]

    def lines(self) -> list[list[Vector]]:
        """Return lines in space: the rim of the wide end, and edges from the tip to it."""
        near, far = (
            self._rim(self.tip_m, self.half_width_m),
            self._rim(self.end_m, self.end_half_width_m),
        )
        edges = [[near[k], far[k]] for k in range(0, RIM_POINTS, RIM_POINTS // _EDGES)]
        return [[*far, far[0]], *edges]

    def _rim(self, middle_m: Vector, radius_m: float) -> list[Vector]:
        """Return points (n, 3) of a circle across the axis."""
        least = min(range(3), key=lambda i: abs(self.ahead[i]))
        first = [float(i == least) - self.ahead[least] * a for i, a in enumerate(self.ahead)]
        size = math.hypot(*first)
        u = [value / size for value in first]
        a = self.ahead
        v = (a[1] * u[2] - a[2] * u[1], a[2] * u[0] - a[0] * u[2], a[0] * u[1] - a[1] * u[0])
        turns = [2.0 * math.pi * k / RIM_POINTS for k in range(RIM_POINTS)]
        return [
            tuple(
                m + radius_m * (math.cos(turn) * p + math.sin(turn) * q)
                for m, p, q in zip(middle_m, u, v, strict=True)
            )
            for turn in turns
        ]


@dataclass(frozen=True)
class Zones:
    """What one section of a scenario has about the target.

    keep_out_m : radius of the sphere; 0: none
    points_m : name -> position (3,) of a hold or another point of a plan, target LVLH
    name : of the section
    """

    keep_out_m: float = 0.0
    corridor: Corridor | None = None
    points_m: Mapping[str, Vector] = field(default_factory=dict)
    name: str = field(default='', compare=False)

    @property
    def keep_out(self) -> str:
        """The keep-out zone in words."""
        beside = ', beside its corridor' if self.corridor is not None else ''
        return f'the keep-out sphere of {self.keep_out_m:g} m of `{self.name}`{beside}'

    def inside_m(self, position_m: Vector) -> float:
        """Return how far a point (3,) lies inside the sphere; < 0 outside of it."""
        return self.keep_out_m - math.hypot(*position_m)

    def violated(self, position_m: Vector) -> bool:
        """Whether a point (3,) lies in the sphere and not in the corridor."""
        if self.keep_out_m == 0.0 or self.inside_m(position_m) <= 0.0:
            return False
        return self.corridor is None or self.corridor.outside_m(position_m) > 0.0

    def depths_m(self, positions_m: Floats) -> Floats:
        """Return how deep points (n, 3) lie in the sphere and beside the corridor; 0.0 outside.

        Behind its tip, where the port is, the corridor goes on as wide as it is there. Half of the
        way to the other side of the sphere it ends: who comes from there has not come through it.
        """
        depths = np.maximum(self.keep_out_m - np.linalg.norm(positions_m, axis=1), 0.0)
        way = self.corridor
        if way is None:
            return depths
        along, across = way.along_and_across(positions_m)
        beside = across - (way.half_width_m or AT_PORT_M) - way.slope * np.maximum(along, 0.0)
        end_m = -0.5 * (self.keep_out_m + math.hypot(*way.tip_m))
        return np.where(along < end_m, depths, np.clip(beside, 0.0, depths))

    def deepest_m(self, states: Floats, dt_s: float) -> float:
        """Return how deep a path comes into the sphere beside the corridor; 0.0 if it never does.

        states : (n, 6) at ticks of dt_s; between them by the cubic through both
        """
        if self.keep_out_m == 0.0:
            return 0.0
        deepest = float(self.depths_m(states[:, :3]).max(initial=0.0))
        r, v = states[:, :3], states[:, 3:] * dt_s
        ranges, ways = np.linalg.norm(r, axis=1), np.linalg.norm(v, axis=1)
        moved = np.linalg.norm(np.diff(r, axis=0), axis=1) + ways[:-1] + ways[1:]
        near = np.flatnonzero(ranges[:-1] - self.keep_out_m <= moved)
        for part in range(1, PARTS if near.size else 1):
            t = part / PARTS
            s = 1.0 - t
            begin = s * s * ((1.0 + 2.0 * t) * r[near] + t * v[near])
            end = t * t * ((3.0 - 2.0 * t) * r[near + 1] - s * v[near + 1])
            deepest = max(deepest, float(self.depths_m(begin + end).max()))
        return deepest


def zones_of(scenario: Any) -> list[Zones]:
    """Return the zones of a scenario's sections; equal ones once. Empty: it has none."""
    found: list[Zones] = []
    for settings in scenario.sections:
        section = section_of(settings)
        made = section.zones(settings, scenario) if section.zones is not None else Zones()
        if made != Zones() and made not in found:
            found.append(replace(made, name=section.name))
    return found
