# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `visualizer`: the run for RViz: /tf, a pose, markers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Odometry
from visualization_msgs.msg import Marker, MarkerArray

from rpo_core.wire.interfaces import RELATIVE_STATE, TARGET_FRAME
from rpo_ros import conversions, names, qos
from rpo_view.listening import ListeningNode
from rpo_view.live import Trail
from rpo_view.scene import Look, markers, turn

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # not among the ROS 2 wheels
    TFMessage = None


class VisualizerNode(ListeningNode):
    """Takes the newest state and force from time to time, so that it never slows a run down."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('visualizer', overrides)
        values = self.values
        self._look = Look(
            values['arrow_m_per_n'], values['keep_out_radius_m'], values['corridor_half_angle_deg']
        )
        self.live.trail = Trail(values['trail_points'])
        self._shown: dict[tuple[str, int], Marker] = {}
        self._markers = self.create_publisher(MarkerArray, names.MARKERS, qos.LATCHED)
        self._pose = self.create_publisher(PoseStamped, names.CHASER_POSE, qos.LATCHED)
        self._tf = None
        if TFMessage is None:
            self.get_logger().warning(
                f'tf2_msgs is not installed: publishing {names.CHASER_POSE}, but not {names.TF}'
            )
        else:
            self._tf = self.create_publisher(TFMessage, names.TF, qos.TF)
        self.every(1.0 / values['rate_hz'], self._show)
        self.get_logger().info(f'showing {self.topic}')

    def _show(self) -> None:
        if not self.look():
            return
        run = self.live
        state = conversions.to_odometry(run.stamp_ns, run.signals[RELATIVE_STATE])
        if run.chaser_attitude is not None:
            turn(state.pose.pose.orientation, run.chaser_attitude[:4])
        self._pose.publish(PoseStamped(header=state.header, pose=state.pose.pose))
        if self._tf is not None:
            transforms = [transform_of(state)]
            if (attitude := run.attitude) is not None:
                target = conversions.to_odometry(run.stamp_ns, (0.0,) * 6)
                target.child_frame_id = TARGET_FRAME
                turn(target.pose.pose.orientation, attitude[:4])
                transforms.append(transform_of(target))
            self._tf.publish(TFMessage(transforms=transforms))
        trail, stamp = [*run.trail.points, run.position_m], state.header.stamp
        seen = trail, self._look, run.zones_now, run.attitude, run.chaser_attitude, run.docking_axis
        scene = markers(stamp, run.position_m, run.force_n, *seen)
        self._markers.publish(self._with_deletions(scene))

    def _with_deletions(self, scene: MarkerArray) -> MarkerArray:
        """Return a scene that deletes what it has no more: the zones of another scenario."""
        shown = {(marker.ns, marker.id): marker for marker in scene.markers}
        gone = [self._shown[key] for key in self._shown if key not in shown]
        for marker in gone:
            marker.action = Marker.DELETE
        self._shown = shown
        scene.markers = [*scene.markers, *gone]
        return scene


def transform_of(state: Odometry) -> TransformStamped:
    """Return the transform from the target's LVLH frame to the chaser, or to the target's body."""
    transform = TransformStamped(header=state.header, child_frame_id=state.child_frame_id)
    position, shift = state.pose.pose.position, transform.transform.translation
    shift.x, shift.y, shift.z = position.x, position.y, position.z
    transform.transform.rotation = state.pose.pose.orientation
    return transform


main = VisualizerNode.main
