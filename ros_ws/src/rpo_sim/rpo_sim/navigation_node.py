# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `navigation`: what the chaser knows of its relative state, with the scenario's errors.

It runs the stages that a scenario has between the true state and guidance. The controller then
listens to their output, `navigation_state`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rpo_core.stage import Place
from rpo_ros.running import run_node
from rpo_ros.stage_node import PlaceNode


class NavigationNode(PlaceNode):
    """Answers each true state with the navigation solution, which follows from it and its tick."""

    places = (Place.SENSOR, Place.ESTIMATOR)
    what = ('navigating', 'errors of navigation')

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('navigation', overrides)


def main() -> int:
    """Entry point of `ros2 run rpo_sim navigation`."""
    return run_node(NavigationNode)
