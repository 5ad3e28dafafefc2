# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `visualizer`: the run for RViz: /tf, a pose, markers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import PoseStamped, TransformStamped
from rclpy.time import Time
from visualization_msgs.msg import MarkerArray

from rpo_bringup.views.listening import ListeningNode
from rpo_bringup.views.scene import markers, turn
from rpo_core.wire.interfaces import CHASER_FRAME, LVLH_FRAME, TARGET_FRAME
from rpo_ros import qos

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # not among the ROS 2 wheels
    TFMessage = None

MARKERS, CHASER_POSE, TF = 'markers', 'chaser_pose', '/tf'


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
        pose.header.stamp = Time(nanoseconds=live.stamp_ns).to_msg()
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
