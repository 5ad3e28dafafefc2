# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Zones about the target, as views draw them: keep-out sphere, corridor, port, points of a plan.

A section of a scenario that has zones says so (`rpo_core.stage.Section`); pages, RViz and reports
draw what `zones_of` returns, and know no section by its name. Nothing here shapes a flight.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from rpo_core.stage import section_of

Vector = tuple[float, ...]

RIM_POINTS = 36
_EDGES = 8


@dataclass(frozen=True)
class Corridor:
    """A cone about an axis, cut off at its tip where it has a width there.

    tip_m : (3,) target LVLH, the port; ahead : (3,) unit vector from there outward
    slope : tangent of the half angle; length_m : along the axis
    half_width_m : at the tip
    """

    tip_m: Vector
    ahead: Vector
    slope: float
    length_m: float
    half_width_m: float = 0.0

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
        away = [p - tip for p, tip in zip(position_m, self.tip_m, strict=True)]
        along = sum(a * b for a, b in zip(away, self.ahead, strict=True))
        across = math.hypot(*(w - along * a for w, a in zip(away, self.ahead, strict=True)))
        return across - along * self.slope - self.half_width_m

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

    def inside_m(self, position_m: Vector) -> float:
        """Return how far a point (3,) lies inside the sphere; < 0 outside of it."""
        return self.keep_out_m - math.hypot(*position_m)

    def violated(self, position_m: Vector) -> bool:
        """Whether a point (3,) lies in the sphere and not in the corridor."""
        if self.keep_out_m == 0.0 or self.inside_m(position_m) <= 0.0:
            return False
        return self.corridor is None or self.corridor.outside_m(position_m) > 0.0


def zones_of(scenario: Any) -> list[Zones]:
    """Return the zones of a scenario's sections; equal ones once. Empty: it has none."""
    found: list[Zones] = []
    for settings in scenario.sections:
        section = section_of(settings)
        made = section.zones(settings, scenario) if section.zones is not None else Zones()
        if made != Zones() and made not in found:
            found.append(replace(made, name=section.name))
    return found
