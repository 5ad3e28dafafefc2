# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""The scene for RViz and Foxglove: markers of one state, all in target LVLH.

Each marker keeps its (ns, id), so that a viewer replaces the old one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from rpo_log.show.style import COLOURS
from rpo_ros.names import LVLH_FRAME

Vector = Sequence[float]

_DARK = 1
_RIM_POINTS = 36
_EDGES = 8
_ARROW = (0.25, 0.6, 0.8)
"""Diameters of shaft and head, length of the head [m]."""
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
    stamp: Time, position_m: Vector, force_n: Vector | None, trail: Sequence[Vector], look: Look
) -> MarkerArray:
    """Return the whole scene.

    position_m : (3,), force_n : (3,) commanded, trail : (n, 3), n >= 1; m, N, target LVLH
    """
    found = [*_target(), *_chaser(position_m), *_aids(trail[0], look)]
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


def _target() -> list[Marker]:
    """Return a body with two panels across the orbit."""
    body, panel = _colour('ink'), _colour('x')
    return [
        _marker('target', 0, Marker.CUBE, (1.6, 1.6, 1.6), body),
        _marker('target', 1, Marker.CUBE, (0.1, 1.4, 3.6), panel, (0.0, 0.0, 2.8)),
        _marker('target', 2, Marker.CUBE, (0.1, 1.4, 3.6), panel, (0.0, 0.0, -2.8)),
    ]


def _chaser(position_m: Vector) -> list[Marker]:
    label = _marker(
        'chaser', 1, Marker.TEXT_VIEW_FACING, (0.0, 0.0, 2.0), _colour('ink'),
        (position_m[0] + 2.5, position_m[1], position_m[2]),
    )  # fmt: skip
    label.text = f'{math.hypot(*position_m):.1f} m'
    body = _marker('chaser', 0, Marker.CUBE, (1.2, 1.2, 1.2), _colour('y'), position_m)
    return [body, label]


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
    found = []
    if look.keep_out_radius_m > 0.0:
        size_m = (2.0 * look.keep_out_radius_m,) * 3
        found.append(_marker('keep_out', 0, Marker.SPHERE, size_m, _colour('bad', 0.15)))
    if look.corridor_half_angle_deg > 0.0:
        corridor = _marker('corridor', 0, Marker.LINE_LIST, (0.06, 0.0, 0.0), _colour('good', 0.6))
        corridor.points = _points(cone(start_m, look.corridor_half_angle_deg))
        found.append(corridor)
    return found


def cone(start_m: Vector, half_angle_deg: float) -> list[list[float]]:
    """Return the ends of line pieces (2n, 3) [m] along a cone and around its wide end.

    The apex is in the target. Axis and length are those of the largest coordinate of `start_m`.
    """
    axis = max(range(3), key=lambda i: abs(start_m[i]))
    across, up = (i for i in range(3) if i != axis)
    radius_m = abs(start_m[axis]) * math.tan(math.radians(half_angle_deg))
    rim = []
    for k in range(_RIM_POINTS):
        point = [0.0, 0.0, 0.0]
        angle = 2.0 * math.pi * k / _RIM_POINTS
        point[axis] = float(start_m[axis])
        point[across], point[up] = radius_m * math.cos(angle), radius_m * math.sin(angle)
        rim.append(point)
    pieces = [end for k in range(_RIM_POINTS) for end in (rim[k - 1], rim[k])]
    for k in range(0, _RIM_POINTS, _RIM_POINTS // _EDGES):
        pieces += [[0.0, 0.0, 0.0], rim[k]]
    return pieces
