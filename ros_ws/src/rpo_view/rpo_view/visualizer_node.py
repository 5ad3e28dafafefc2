# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `visualizer`: the run for RViz and Foxglove: /tf, a pose, markers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Odometry
from visualization_msgs.msg import MarkerArray

from rpo_ros import conversions, names, qos
from rpo_ros.parameters import declare
from rpo_ros.running import FlightNode
from rpo_view.latest import Latest, run_viewer
from rpo_view.parameters import VISUALIZER as PARAMETERS
from rpo_view.scene import Look, markers
from rpo_view.trail import Trail

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # not among the ROS 2 wheels
    TFMessage = None


class VisualizerNode(FlightNode):
    """Takes the newest state and force from time to time, so that it never slows a run down."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('visualizer', overrides)
        values = declare(self, PARAMETERS)
        self._look = Look(
            values['arrow_m_per_n'], values['keep_out_radius_m'], values['corridor_half_angle_deg']
        )
        self._trail = Trail(values['trail_points'])
        self._stamp_ns = 0
        self._force_n: tuple[float, ...] | None = None
        self._states = Latest(self, names.RELATIVE_STATE)
        self._forces = Latest(self, names.CONTROL_FORCE)
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
        self.get_logger().info(f'showing {self.resolve_topic_name(names.RELATIVE_STATE)}')

    def _show(self) -> None:
        force, state = self._forces.take(), self._states.take()
        if force is not None:
            force_n = conversions.from_wrench(force)
            if not conversions.fault_of(force, force_n):
                self._force_n = force_n
        if state is None:
            return
        values = conversions.from_odometry(state)
        if conversions.fault_of(state, values):
            return
        stamp_ns = conversions.from_stamp(state.header.stamp)
        if stamp_ns < self._stamp_ns:  # another run
            self._trail.clear()
        self._stamp_ns = stamp_ns
        self._trail.add(values[:3])
        self._publish(state, values[:3])

    def _publish(self, state: Odometry, position_m: tuple[float, ...]) -> None:
        self._pose.publish(PoseStamped(header=state.header, pose=state.pose.pose))
        if self._tf is not None:
            self._tf.publish(TFMessage(transforms=[transform_of(state)]))
        trail = [*self._trail.points, position_m]
        scene = markers(state.header.stamp, position_m, self._force_n, trail, self._look)
        self._markers.publish(scene)


def transform_of(state: Odometry) -> TransformStamped:
    """Return the transform from the target's LVLH frame to the chaser."""
    transform = TransformStamped(header=state.header, child_frame_id=state.child_frame_id)
    position, shift = state.pose.pose.position, transform.transform.translation
    shift.x, shift.y, shift.z = position.x, position.y, position.z
    transform.transform.rotation = state.pose.pose.orientation
    return transform


def main() -> int:
    """Entry point of `ros2 run rpo_view visualizer`."""
    return run_viewer(VisualizerNode)
