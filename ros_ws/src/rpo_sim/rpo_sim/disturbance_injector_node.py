# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Node `disturbance_injector`: answers each state with the scenario's disturbance at its time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rpo_core.stage import Place
from rpo_ros.running import run_node
from rpo_ros.stage_node import PlaceNode


class DisturbanceInjectorNode(PlaceNode):
    """Computes the disturbance from the stamp alone."""

    places = (Place.DISTURBANCE,)
    what = ('disturbing', 'disturbance')
    role = 'disturbance'

    def __init__(self, overrides: Mapping[str, Any] | None = None) -> None:
        super().__init__('disturbance_injector', overrides)


def main() -> int:
    """Entry point of `ros2 run rpo_sim disturbance_injector`."""
    return run_node(DisturbanceInjectorNode)
