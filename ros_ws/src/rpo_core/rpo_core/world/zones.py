# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Zones about the target: section `zones` of a scenario, what is in them, how they are drawn.

The section says once where the keep-out sphere, the corridor and the port are. Sections that need
them take them from there (`filled`), and may state what differs for them. A section that has zones
of its own says so (`rpo_core.stage.Section`); pages, RViz and reports draw what `zones_of`
returns, and know no section by its name. `deepest_m` judges who enters one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Annotated, Any

import numpy as np

from rpo_core.files.validation import Checked, InputError, real, vector3
from rpo_core.kernels.arithmetic import Vector, norm, sin_cos
from rpo_core.kernels.arrays import Floats
from rpo_core.kernels.jit import kernel
from rpo_core.stage import section_of
from rpo_core.world.starts import MAX_POSITION_M

Point = tuple[float, ...]
SECTION = 'zones'

SHORTEST_AXIS = 1e-6
"""A shorter axis of a corridor has no direction that is sure."""

AT_PORT_M = 0.1
"""So near to its axis, a chaser is in a corridor whose tip has no width."""

PARTS = 8
"""Moments of a tick at which a path is judged, its end included."""

RIM_POINTS = 36
_EDGES = 8


def along_and_across(position_m: Any, port_m: Any, ahead: Any) -> tuple[Any, Any]:
    """Return how far [m] a point lies along an axis from a port, and its vector (3,) [m] across.

    position_m : x, y, z, each a number, or an array of many points
    ahead : (3,) unit vector
    """
    offset = [r - p for r, p in zip(position_m, port_m, strict=True)]
    along = offset[0] * ahead[0] + offset[1] * ahead[1] + offset[2] * ahead[2]
    x, y, z = (o - along * a for o, a in zip(offset, ahead, strict=True))
    return along, (x, y, z)


def beside_m(along_m: Any, across_m: Any, half_width_m: Any, slope: Any) -> Any:
    """Return how far a point lies outside the walls of a corridor, across its axis; < 0 inside.

    along_m, across_m : distances from the port along the axis, and from the axis
    half_width_m, slope : half of the width at the port, and what it gains per metre
    """
    return across_m - half_width_m - slope * along_m


beside_kernel = kernel(beside_m)
"""The same for numbers, compiled where kernels are."""


@dataclass(frozen=True, kw_only=True)
class Corridor(Checked):
    """The cone by which the chaser enters the keep-out sphere; its tip is the port.

    axis : (3,) from the port outward; half_angle_deg : of the cone
    from_m : range from the target within which the chaser must be inside; 0: no corridor
    """

    axis: Annotated[Vector, partial(vector3, unit='', bound=1e3)] = (0.0, 1.0, 0.0)
    half_angle_deg: Annotated[float, partial(real, unit='deg', above=0.0, most=60.0)] = 10.0
    from_m: Annotated[float, partial(real, unit='m', least=0.0, most=1e4)] = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if math.hypot(*self.axis) < SHORTEST_AXIS:  # a kernel here would be loaded at each import
            raise InputError(
                f'`axis` must be at least {SHORTEST_AXIS:g} long; got {list(self.axis)!r}'
            )

    @property
    def ahead(self) -> Vector:
        """Unit vector (3,) from the port outward."""
        x, y, z = self.axis
        size = norm(x, y, z)
        return x / size, y / size, z / size

    @property
    def along(self) -> str:
        """The axis of LVLH that it is along, like `+y`; '' if it is along none."""
        ahead = self.ahead
        names = [f'{"+" if a > 0.0 else "-"}{"xyz"[i]}' for i, a in enumerate(ahead) if a]
        return names[0] if len(names) == 1 else ''

    @property
    def slope(self) -> float:
        """Tangent of the half angle."""
        return tangent(self.half_angle_deg)

    def cone(self, port_m: Vector) -> Cone:
        """Return its shape, from the port to the range where it begins."""
        return Cone(port_m, self.ahead, self.slope, self.from_m - norm(*port_m))


NO_CORRIDOR = Corridor()


def tangent(angle_deg: float) -> float:
    """Return the tangent of an angle: the same bits on every machine."""
    sine, cosine = sin_cos(angle_deg * 0.017453292519943295)
    return sine / cosine


@dataclass(frozen=True, kw_only=True)
class Zones(Checked):
    """Section `zones`: where nobody may be, and the way in.

    keep_out_m : radius of the sphere about the target; 0: none. The corridor leads through it
    port_m : (3,) target LVLH, tip of the corridor
    """

    keep_out_m: Annotated[float, partial(real, unit='m', least=0.0, most=1e4)] = 0.0
    port_m: Annotated[Vector, partial(vector3, unit='m', bound=MAX_POSITION_M)] = (0.0, 0.0, 0.0)
    corridor: Corridor = NO_CORRIDOR

    def zone(self, points_m: Mapping[str, Point] | None = None) -> Zone:
        """Return what views draw; points_m : name -> point (3,) of a plan."""
        cone = self.corridor.cone(self.port_m) if self.corridor.from_m else None
        return Zone(self.keep_out_m, cone, points_m or {})


def filled(document: Any, known: Mapping[str, Any]) -> Any:
    """Return the mapping of a section, with what is known where it says nothing itself."""
    if not isinstance(document, Mapping):
        return document
    fields = dict(document)
    for key, value in known.items():
        if key not in document:
            fields[key] = value
        elif isinstance(value, Mapping):
            fields[key] = filled(document[key], value)
    return fields


def without(document: Mapping[str, Any], known: Mapping[str, Any]) -> dict[str, Any]:
    """Return the mapping of a section less what `filled` would give it."""
    return {
        key: without(value, known[key])
        if isinstance(value, Mapping) and isinstance(known.get(key), Mapping)
        else value
        for key, value in document.items()
        if key not in known or known[key] != value
    }


@dataclass(frozen=True)
class Cone:
    """The shape of a corridor: a cone about an axis, cut off where it has a width at its tip.

    tip_m : (3,) target LVLH, the port; ahead : (3,) unit vector from there outward
    slope : tangent of the half angle; length_m : along the axis
    half_width_m : at the tip
    square : whether its walls are four planes along the axes of LVLH, and it is drawn as the cone
        between them; the axis is then one of LVLH too
    """

    tip_m: Point
    ahead: Point
    slope: float
    length_m: float = field(compare=False)
    half_width_m: float = 0.0
    square: bool = False

    @property
    def end_m(self) -> Point:
        """Middle (3,) of the wide end."""
        pairs = zip(self.tip_m, self.ahead, strict=True)
        return tuple(tip + self.length_m * a for tip, a in pairs)

    @property
    def end_half_width_m(self) -> float:
        """Half of the width at the wide end."""
        return self.half_width_m + self.slope * self.length_m

    def outside_m(self, position_m: Point) -> float:
        """Return how far a point (3,) lies outside the walls, across the axis; < 0 inside."""
        along, across = self._along_and_across(np.array([position_m]))
        return float(beside_m(along[0], across[0], self.half_width_m, self.slope))

    def _along_and_across(self, positions_m: Floats) -> tuple[Floats, Floats]:
        """Return distances (n,) from the tip along the axis, and from the axis, of points (n, 3).

        Of a square corridor, the second is the larger of both axes.
        """
        along, (x, y, z) = along_and_across(positions_m.T, self.tip_m, self.ahead)
        if self.square:
            return along, np.maximum(np.maximum(abs(x), abs(y)), abs(z))
        return along, np.sqrt(x * x + y * y + z * z)

    def edges(self, right: int, up: int) -> list[tuple[Point, Point]]:
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

    def lines(self) -> list[list[Point]]:
        """Return lines in space: the rim of the wide end, and edges from the tip to it."""
        near, far = (
            self._rim(self.tip_m, self.half_width_m),
            self._rim(self.end_m, self.end_half_width_m),
        )
        edges = [[near[k], far[k]] for k in range(0, RIM_POINTS, RIM_POINTS // _EDGES)]
        return [[*far, far[0]], *edges]

    def _rim(self, middle_m: Point, radius_m: float) -> list[Point]:
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
class Zone:
    """What one section of a scenario has about the target, as it is drawn and judged.

    keep_out_m : radius of the sphere; 0: none
    points_m : name -> position (3,) of a hold or another point of a plan, target LVLH
    name : of the section
    """

    keep_out_m: float = 0.0
    corridor: Cone | None = None
    points_m: Mapping[str, Point] = field(default_factory=dict)
    name: str = field(default='', compare=False)

    @property
    def keep_out(self) -> str:
        """The keep-out zone in words."""
        beside = ', beside its corridor' if self.corridor is not None else ''
        return f'the keep-out sphere of {self.keep_out_m:g} m of `{self.name}`{beside}'

    def depths_m(self, positions_m: Floats) -> Floats:
        """Return how deep points (n, 3) lie in the sphere and beside the corridor; 0.0 outside.

        Behind its tip, where the port is, the corridor goes on as wide as it is there. Half of the
        way to the other side of the sphere it ends: who comes from there has not come through it.
        """
        depths = np.maximum(self.keep_out_m - np.linalg.norm(positions_m, axis=1), 0.0)
        way = self.corridor
        if way is None:
            return depths
        along, across = way._along_and_across(positions_m)
        wide_m = way.half_width_m or AT_PORT_M
        beside = beside_m(np.maximum(along, 0.0), across, wide_m, way.slope)
        end_m = -0.5 * (self.keep_out_m + math.hypot(*way.tip_m))
        return np.where(along < end_m, depths, np.clip(beside, 0.0, depths))

    def deepest_m(self, states: Floats, dt_s: float) -> float:
        """Return how deep a path comes into the sphere beside the corridor; 0.0 if it never does.

        states : (n, 6) at ticks of dt_s; between them by the cubic through both
        """
        if self.keep_out_m == 0.0:
            return 0.0
        r, v = states[:, :3], states[:, 3:] * dt_s
        ranges, ways = np.linalg.norm(r, axis=1), np.linalg.norm(v, axis=1)
        moved = np.linalg.norm(np.diff(r, axis=0), axis=1) + ways[:-1] + ways[1:]
        near = np.flatnonzero(ranges[:-1] - self.keep_out_m <= moved)
        if near.size:
            t = np.arange(1, PARTS)[:, None, None] / PARTS
            s = 1.0 - t
            begin = s * s * ((1.0 + 2.0 * t) * r[near] + t * v[near])
            end = t * t * ((3.0 - 2.0 * t) * r[near + 1] - s * v[near + 1])
            r = np.concatenate([r, (begin + end).reshape(-1, 3)])
        return float(self.depths_m(r).max(initial=0.0))


def zones_of(scenario: Any) -> list[Zone]:
    """Return the zones of a scenario and its sections; equal ones once. Empty: it has none.

    A section with the zones of the scenario adds its points to them.
    """
    zones: list[Zone] = []
    if scenario.zones is not None:
        zones.append(replace(scenario.zones.zone(), name=SECTION))
    for settings in scenario.sections:
        made = settings.zones(scenario) if hasattr(settings, 'zones') else Zone()
        if zones and zones[0].name == SECTION and replace(made, points_m={}) == zones[0]:
            zones[0] = replace(zones[0], points_m=made.points_m)
        elif made != Zone() and made not in zones:
            zones.append(replace(made, name=section_of(settings).name))
    return zones
