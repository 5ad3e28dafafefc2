# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `foxglove`: a WebSocket server that shows the run in the Foxglove and Lichtblick apps."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message
from visualization_msgs.msg import MarkerArray

from rpo_core.files.validation import InputError
from rpo_core.wire import interfaces
from rpo_mcap.format import rosbag2
from rpo_ros import conversions, names, qos
from rpo_ros.signals import message_class
from rpo_view.gate import HOST, Gate, hidden_address
from rpo_view.listening import Latest, Viewer

try:
    import foxglove
    from foxglove import messages
    from foxglove.channels import FrameTransformChannel
except ImportError:  # an optional layer
    foxglove = None

_APPS = ('https://app.foxglove.dev', 'file://')
"""Origins of the app in a browser, and of those on the desktop."""

_STATUS_PERIOD_S = 1.0

_SAMPLED = {
    **{
        name: message_class(interfaces.row_of(name).type)
        for name in (
            interfaces.RELATIVE_STATE,
            interfaces.CONTROL_FORCE,
            interfaces.DISTURBANCE_FORCE,
            interfaces.DECISION,
        )
    },
    names.MARKERS: MarkerArray,
}


class FoxgloveNode(Viewer):
    """Passes on the bytes of the messages, with the simulated time of the newest state."""

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('foxglove', overrides)
        values = self.values
        if foxglove is None:
            raise InputError(
                'foxglove-sdk is not installed: `make setup LAYERS=view`, or pip, installs it'
            )
        self._app_context = foxglove.Context()
        self._stamp_ns = 0
        self._status = b''
        self._newest = {
            name: Latest(self, name, kind=kind, raw=True) for name, kind in _SAMPLED.items()
        }
        self._channels = {name: self._channel(name, kind) for name, kind in _SAMPLED.items()}
        self._channels[interfaces.RUN_STATUS] = self._channel(
            interfaces.RUN_STATUS, DiagnosticStatus
        )
        self._transform = FrameTransformChannel(
            self.resolve_topic_name('chaser_transform'), context=self._app_context
        )
        hidden = hidden_address()
        self._server = foxglove.start_server(
            name='rpo', host=hidden, port=0, context=self._app_context
        )
        try:
            origins = (*_APPS, values['origin']) if values['origin'] else _APPS
            self._gate = Gate(values['port'], (hidden, self._server.port), origins)
        except InputError:
            self._server.stop()
            raise
        self.create_subscription(
            DiagnosticStatus, interfaces.RUN_STATUS, self._on_status, qos.LATCHED_QUEUE, raw=True
        )
        self.every(1.0 / values['rate_hz'], self._pass_on)
        self.every(_STATUS_PERIOD_S, self._send_status)
        self.get_logger().info(
            f'open ws://{HOST}:{self._gate.port} in the Foxglove or Lichtblick app'
        )

    def _channel(self, name: str, kind: type) -> Any:
        type_name = f'{kind.__module__.split(".", 1)[0]}/msg/{kind.__name__}'
        text = rosbag2.definition(type_name).text.encode()
        return foxglove.Channel(
            self.resolve_topic_name(name),
            message_encoding='cdr',
            schema=foxglove.Schema(name=type_name, encoding='ros2msg', data=text),
            context=self._app_context,
        )

    def _pass_on(self) -> None:
        for name, newest in self._newest.items():
            data = newest.take()
            if data is None:
                continue
            if name == interfaces.RELATIVE_STATE and not self._on_state(
                deserialize_message(data, Odometry)
            ):
                continue
            self._channels[name].log(data, log_time=self._stamp_ns)

    def _on_state(self, state: Odometry) -> bool:
        """Set the time, and send where the chaser is and points, as /tf does in ROS.

        Return whether it is a state of a run: the apps know no time before 1970.
        """
        stamp_ns = conversions.from_stamp(state.header.stamp)
        values = conversions.from_odometry(state)
        if stamp_ns < 0 or conversions.fault_of(state, values):
            return False
        if stamp_ns < self._stamp_ns:  # another run: clear the old one in the app
            self._server.clear_session()
        self._stamp_ns = stamp_ns
        x, y, z = values[:3]
        turn = conversions.attitude_of(state) or interfaces.ALIGNED
        transform = messages.FrameTransform(
            timestamp=messages.Timestamp(*divmod(stamp_ns, 1_000_000_000)),
            parent_frame_id=state.header.frame_id,
            child_frame_id=state.child_frame_id,
            translation=messages.Vector3(x=x, y=y, z=z),
            rotation=messages.Quaternion(x=turn[0], y=turn[1], z=turn[2], w=turn[3]),
        )
        self._transform.log(transform, log_time=stamp_ns)
        return True

    def _on_status(self, data: bytes) -> None:
        self._status = data
        self._send_status()

    def _send_status(self) -> None:
        """Send run_status again: the apps know no latched topics."""
        if self._status and self._stamp_ns:
            self._channels[interfaces.RUN_STATUS].log(self._status, log_time=self._stamp_ns)

    def close(self) -> None:
        """Disconnect the apps."""
        self._server.stop()
        self._gate.close()


main = FoxgloveNode.main
