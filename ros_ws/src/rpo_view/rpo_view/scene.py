# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The scene for RViz: markers of one state, all in target LVLH.

Each marker keeps its (ns, id), so that a viewer replaces the old one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Quaternion
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from rpo_attitude.turns import turned
from rpo_core.judge.zones import Cone, Zone
from rpo_core.wire.interfaces import LVLH_FRAME
from rpo_kernels.attitude_kernels import Attitude
from rpo_log.show.style import COLOURS

Vector = Sequence[float]

_DARK = 1
_ARROW = (0.25, 0.6, 0.8)
"""Diameters of shaft and head, length of the head [m]."""
_AXIS_M = 3.0
"""Length of the docking axis."""
_MOST_POINTS = 100
"""Points of a plan have the numbers from this one times that of their zone."""
_MIN_FORCE_N = 1e-3
"""A smaller force is not drawn: RViz warns of an arrow without length."""


@dataclass(frozen=True)
class Look:
    """The aids in the scene beside the two spacecraft; they are no limits of the flight.

    arrow_m_per_n : length of the thrust arrow for a force
    keep_out_radius_m : of the sphere around the target; 0: none
    corridor_half_angle_deg : of the cone around the axis of approach; 0: none
    """

    arrow_m_per_n: float = 20.0
    keep_out_radius_m: float = 5.0
    corridor_half_angle_deg: float = 15.0


def markers(
    stamp: Time,
    position_m: Vector,
    force_n: Vector | None,
    trail: Sequence[Vector],
    look: Look,
    zones: Sequence[Zone] = (),
    attitude: Attitude | None = None,
    chaser_attitude: Vector | None = None,
    docking_axis: Vector | None = None,
) -> MarkerArray:
    """Return the whole scene; the aids of `look` where the scenario has no zones of its own.

    position_m : (3,), force_n : (3,) commanded, trail : (n, 3), n >= 1; m, N, target LVLH
    attitude : of the target, where it has one; chaser_attitude : of the chaser
    docking_axis : (3,) of a chaser that has an attitude, target LVLH
    """
    around = zone_markers(zones) if zones else _aids(trail[0], look)
    found = [*_target(attitude), *_chaser(position_m, chaser_attitude), *around]
    found += _axis(position_m, docking_axis)
    found.append(_line('trail', 0, trail, 'muted', 0.12))
    found.append(_thrust(position_m, force_n or (0.0, 0.0, 0.0), look.arrow_m_per_n))
    for marker in found:
        marker.header.frame_id = LVLH_FRAME
        marker.header.stamp = stamp
    return MarkerArray(markers=found)


def _colour(name: str, alpha: float = 1.0) -> ColorRGBA:
    red, green, blue = bytes.fromhex(COLOURS[name][_DARK][1:])
    return ColorRGBA(r=red / 255.0, g=green / 255.0, b=blue / 255.0, a=alpha)


def _marker(
    ns: str, number: int, kind: int, size_m: Vector, colour: ColorRGBA, at_m: Vector = (0.0,) * 3
) -> Marker:
    marker = Marker(ns=ns, id=number, type=kind, action=Marker.ADD, color=colour)
    marker.pose.orientation.w = 1.0
    position, scale = marker.pose.position, marker.scale
    position.x, position.y, position.z = (float(value) for value in at_m)
    scale.x, scale.y, scale.z = (float(value) for value in size_m)
    return marker


def _points(points: Iterable[Vector]) -> list[Point]:
    return [Point(x=float(x), y=float(y), z=float(z)) for x, y, z in points]


def _line(ns: str, number: int, points: Iterable[Vector], colour: str, width_m: float) -> Marker:
    marker = _marker(ns, number, Marker.LINE_STRIP, (width_m, 0.0, 0.0), _colour(colour))
    marker.points = _points(points)
    if len(marker.points) < 2:  # a line of one point is an error to RViz
        marker.points = [*marker.points] * 2
    return marker


def _target(attitude: Attitude | None) -> list[Marker]:
    """Return a body with two panels along its z."""
    body, panel = _colour('ink'), _colour('x')
    q = attitude[:4] if attitude is not None else (0.0, 0.0, 0.0, 1.0)
    third = turned((0.0, 0.0, 1.0), q)
    found = [_marker('target', 0, Marker.CUBE, (1.6, 1.6, 1.6), body)]
    for number, away_m in ((1, 2.8), (2, -2.8)):
        at_m = [away_m * part for part in third]
        found.append(_marker('target', number, Marker.CUBE, (0.1, 1.4, 3.6), panel, at_m))
    for marker in found:
        turn(marker.pose.orientation, q)
    return found


def turn(orientation: Quaternion, quaternion: Vector) -> None:
    """Set the orientation of a message to x, y, z, w."""
    orientation.x, orientation.y, orientation.z, orientation.w = map(float, quaternion)


def _chaser(position_m: Vector, attitude: Vector | None) -> list[Marker]:
    label = _marker(
        'chaser', 1, Marker.TEXT_VIEW_FACING, (0.0, 0.0, 2.0), _colour('ink'),
        (position_m[0] + 2.5, position_m[1], position_m[2]),
    )  # fmt: skip
    label.text = f'{math.hypot(*position_m):.1f} m'
    body = _marker('chaser', 0, Marker.CUBE, (1.2, 1.2, 1.2), _colour('y'), position_m)
    if attitude is not None:
        turn(body.pose.orientation, attitude[:4])
    return [body, label]


def _axis(position_m: Vector, docking_axis: Vector | None) -> list[Marker]:
    """Return the docking axis of a chaser that has an attitude, an arrow."""
    if docking_axis is None:
        return []
    marker = _marker('docking_axis', 0, Marker.ARROW, _ARROW, _colour('optimum'))
    tip = [p + _AXIS_M * a for p, a in zip(position_m, docking_axis, strict=True)]
    marker.points = _points((position_m, tip))
    return [marker]


def _thrust(position_m: Vector, force_n: Vector, arrow_m_per_n: float) -> Marker:
    """Return the commanded force, drawn from the chaser; the plume points the other way."""
    marker = _marker('thrust', 0, Marker.ARROW, _ARROW, _colour('small_positive'))
    if math.hypot(*force_n) < _MIN_FORCE_N:
        marker.action = Marker.DELETE
        return marker
    tip = [p + arrow_m_per_n * f for p, f in zip(position_m, force_n, strict=True)]
    marker.points = _points((position_m, tip))
    return marker


def _aids(start_m: Vector, look: Look) -> list[Marker]:
    """Return the sphere, and a cone along the LVLH axis with the largest start coordinate."""
    axis = max(range(3), key=lambda i: abs(start_m[i]))
    ahead = tuple(math.copysign(float(i == axis), start_m[axis]) for i in range(3))
    slope = math.tan(math.radians(look.corridor_half_angle_deg))
    corridor = Cone((0.0, 0.0, 0.0), ahead, slope, abs(start_m[axis])) if slope > 0.0 else None
    around = zone_markers([Zone(look.keep_out_radius_m, corridor=corridor)])
    return [marker for marker in around if marker.ns != 'port']


def zone_markers(zones: Sequence[Zone]) -> list[Marker]:
    """Return spheres, corridors, ports and the points of a plan with their names."""
    found = []
    for i, zone in enumerate(zones):
        if zone.keep_out_m > 0.0:
            size_m = (2.0 * zone.keep_out_m,) * 3
            found.append(_marker('keep_out', i, Marker.SPHERE, size_m, _colour('bad', 0.15)))
        if zone.corridor is not None:
            wall = _marker('corridor', i, Marker.LINE_LIST, (0.06, 0.0, 0.0), _colour('good', 0.6))
            lines = zone.corridor.lines()
            wall.points = _points(end for line in lines for pair in pairwise(line) for end in pair)
            tip = _marker(
                'port', i, Marker.SPHERE, (0.4,) * 3, _colour('good'), zone.corridor.tip_m
            )
            found += [wall, tip]
        for k, (name, at_m) in enumerate(zone.points_m.items()):
            number = _MOST_POINTS * i + k
            point = _marker('holds', number, Marker.SPHERE, (0.8,) * 3, _colour('muted'), at_m)
            above = (at_m[0] + 2.0 + 2.0 * (k % 2), *at_m[1:])
            size = (0.0, 0.0, 1.4)
            label = _marker(
                'hold_names', number, Marker.TEXT_VIEW_FACING, size, _colour('muted'), above
            )
            label.text = name
            found += [point, label]
    return found
