# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `visualizer`: the run for RViz: /tf, a pose, markers of the newest state, in target LVLH."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, PoseStamped, Quaternion, TransformStamped
from rclpy import time
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from rpo_bringup.views.listening import ListeningNode
from rpo_bringup.views.live import LiveFlight
from rpo_core.attitude.pointing import turned
from rpo_core.wire.interfaces import CHASER_FRAME, LVLH_FRAME, TARGET_FRAME
from rpo_core.world.zones import Zone
from rpo_log.show.style import COLOURS
from rpo_ros import qos

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # not among the ROS 2 wheels
    TFMessage = None

MARKERS, CHASER_POSE, TF = 'markers', 'chaser_pose', '/tf'

Vector = Sequence[float]

_DARK = 1
_ARROW = (0.25, 0.6, 0.8)
"""Diameters of shaft and head, length of the head [m]."""
_AXIS_M, _ARROW_M_PER_N = 3.0, 20.0
"""Length of the docking axis, and of the thrust arrow for a force."""
_MAX_POINTS = 100
"""Points of a plan have the numbers from this one times that of their zone."""
_MIN_FORCE_N = 1e-3
"""A smaller force is not drawn: RViz warns of an arrow without length."""


def markers(stamp: Time, live: LiveFlight) -> MarkerArray:
    """Return the whole scene; its first marker deletes the scene before."""
    at_m = live.position_m
    scene = [Marker(action=Marker.DELETEALL), *_target(live), *_chaser(live)]
    scene += [marker for i, zone in enumerate(live.zones_now) for marker in zone_markers(zone, i)]
    scene.append(_line('trail', 0, [*live.trail.points, at_m], 'muted', 0.12))
    if live.docking_axis is not None:
        scene.append(_arrow('docking_axis', at_m, live.docking_axis, _AXIS_M, 'optimum'))
    if live.force_n is not None and math.hypot(*live.force_n) >= _MIN_FORCE_N:
        scene.append(_arrow('thrust', at_m, live.force_n, _ARROW_M_PER_N, 'small_positive'))
    for marker in scene:
        marker.header.frame_id = LVLH_FRAME
        marker.header.stamp = stamp
    return MarkerArray(markers=scene)


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


def _text(ns: str, number: int, text: str, size_m: float, colour: str, at_m: Vector) -> Marker:
    kind, size = Marker.TEXT_VIEW_FACING, (0.0, 0.0, size_m)
    marker = _marker(ns, number, kind, size, _colour(colour), at_m)
    marker.text = text
    return marker


def _points(points: Iterable[Vector]) -> list[Point]:
    return [Point(x=float(x), y=float(y), z=float(z)) for x, y, z in points]


def _line(ns: str, number: int, points: Iterable[Vector], colour: str, width_m: float) -> Marker:
    marker = _marker(ns, number, Marker.LINE_STRIP, (width_m, 0.0, 0.0), _colour(colour))
    marker.points = _points(points)
    return marker


def _arrow(ns: str, at_m: Vector, along: Vector, length_m: float, colour: str) -> Marker:
    marker = _marker(ns, 0, Marker.ARROW, _ARROW, _colour(colour))
    tip_m = [p + length_m * a for p, a in zip(at_m, along, strict=True)]
    marker.points = _points((at_m, tip_m))
    return marker


def turn(orientation: Quaternion, quaternion: Vector) -> None:
    """Set the orientation of a message to x, y, z, w."""
    orientation.x, orientation.y, orientation.z, orientation.w = map(float, quaternion)


def _target(live: LiveFlight) -> list[Marker]:
    """Return a body with two panels along its z."""
    q = live.attitude[:4] if live.attitude is not None else (0.0, 0.0, 0.0, 1.0)
    third = turned((0.0, 0.0, 1.0), q)
    parts = [_marker('target', 0, Marker.CUBE, (1.6, 1.6, 1.6), _colour('ink'))]
    for number, away_m in ((1, 2.8), (2, -2.8)):
        at_m = [away_m * part for part in third]
        size_m = (0.1, 1.4, 3.6)
        parts.append(_marker('target', number, Marker.CUBE, size_m, _colour('x'), at_m))
    for marker in parts:
        turn(marker.pose.orientation, q)
    return parts


def _chaser(live: LiveFlight) -> list[Marker]:
    """Return a body, and its distance from the target."""
    x, y, z = live.position_m
    body = _marker('chaser', 0, Marker.CUBE, (1.2, 1.2, 1.2), _colour('y'), (x, y, z))
    if live.chaser_attitude is not None:
        turn(body.pose.orientation, live.chaser_attitude[:4])
    distance = f'{math.hypot(x, y, z):.1f} m'
    return [body, _text('chaser', 1, distance, 2.0, 'ink', (x + 2.5, y, z))]


def zone_markers(zone: Zone, number: int) -> list[Marker]:
    """Return sphere, corridor, port and the points of a plan with their names."""
    parts = []
    if zone.keep_out_m > 0.0:
        size_m = (2.0 * zone.keep_out_m,) * 3
        parts.append(_marker('keep_out', number, Marker.SPHERE, size_m, _colour('bad', 0.15)))
    if zone.corridor is not None:
        lines = zone.corridor.lines()
        ends = (end for line in lines for pair in pairwise(line) for end in pair)
        size_m, colour = (0.06, 0.0, 0.0), _colour('good', 0.6)
        wall = _marker('corridor', number, Marker.LINE_LIST, size_m, colour)
        wall.points = _points(ends)
        size_m, port_m = (0.4,) * 3, zone.corridor.tip_m
        parts += [wall, _marker('port', number, Marker.SPHERE, size_m, _colour('good'), port_m)]
    for k, (name, at_m) in enumerate(zone.points_m.items()):
        place, beside_m = _MAX_POINTS * number + k, at_m[0] + 2.0 + 2.0 * (k % 2)
        parts.append(_marker('holds', place, Marker.SPHERE, (0.8,) * 3, _colour('muted'), at_m))
        parts.append(_text('hold_names', place, name, 1.4, 'muted', (beside_m, *at_m[1:])))
    return parts


class VisualizerNode(ListeningNode):
    """Takes the newest state and force from time to time, so that it never slows a run down."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('visualizer', overrides)
        self._markers = self.create_publisher(MarkerArray, MARKERS, qos.LATCHED)
        self._pose = self.create_publisher(PoseStamped, CHASER_POSE, qos.LATCHED)
        self._tf = None
        if TFMessage is None:
            self.get_logger().warning(
                f'tf2_msgs is not installed: publishing {CHASER_POSE}, but not {TF}'
            )
        else:
            self._tf = self.create_publisher(TFMessage, TF, qos.TF)
        self.every(1.0 / self.values['rate_hz'], self._show)
        self.get_logger().info(f'showing {self.topic}')

    def _show(self) -> None:
        if not self.look():
            return
        live = self.live
        pose = PoseStamped()
        pose.header.frame_id = LVLH_FRAME
        pose.header.stamp = time.Time(nanoseconds=live.stamp_ns).to_msg()
        at = pose.pose.position
        at.x, at.y, at.z = live.position_m
        if live.chaser_attitude is not None:
            turn(pose.pose.orientation, live.chaser_attitude[:4])
        self._pose.publish(pose)
        if self._tf is not None:
            transforms = [transform_of(pose)]
            if (attitude := live.attitude) is not None:
                target = TransformStamped(header=pose.header, child_frame_id=TARGET_FRAME)
                turn(target.transform.rotation, attitude[:4])
                transforms.append(target)
            self._tf.publish(TFMessage(transforms=transforms))
        self._markers.publish(markers(pose.header.stamp, live))


def transform_of(pose: PoseStamped) -> TransformStamped:
    """Return the transform from the target's LVLH frame to the chaser."""
    transform = TransformStamped(header=pose.header, child_frame_id=CHASER_FRAME)
    shift, at = transform.transform.translation, pose.pose.position
    shift.x, shift.y, shift.z = at.x, at.y, at.z
    transform.transform.rotation = pose.pose.orientation
    return transform


main = VisualizerNode.main
