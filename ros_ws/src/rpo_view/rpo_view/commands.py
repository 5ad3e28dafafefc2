# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Where the commands of this package begin; see `rpo_ros.entry_point`."""

from rpo_ros.entry_point import start_node


def visualizer() -> int:
    """Run `ros2 run rpo_view visualizer`."""
    return start_node('rpo_view.visualizer_node', 'visualizer')


def web() -> int:
    """Run `ros2 run rpo_view web`."""
    return start_node('rpo_view.web_node', 'web')


def foxglove() -> int:
    """Run `ros2 run rpo_view foxglove`."""
    return start_node('rpo_view.foxglove_node', 'foxglove')


def watch() -> int:
    """Run `ros2 run rpo_view watch`."""
    return start_node('rpo_view.watch_node', 'watch')
