# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Where the commands of this package begin; see `rpo_ros.entry_point`."""

from rpo_ros.entry_point import start


def visualizer() -> int:
    """Run `ros2 run rpo_view visualizer`."""
    return start('rpo_view.visualizer_node')


def web() -> int:
    """Run `ros2 run rpo_view web`."""
    return start('rpo_view.web_node')


def foxglove() -> int:
    """Run `ros2 run rpo_view foxglove`."""
    return start('rpo_view.foxglove_node')


def watch() -> int:
    """Run `ros2 run rpo_view watch`."""
    return start('rpo_view.watch_node')
