# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes of this package, one table for each."""

from __future__ import annotations

from dataclasses import replace

from rpo_ros.parameter_rows import AUTOSTART, SCENARIO
from rpo_ros.parameter_rows import ParameterRow as Row

FLIGHT_SOFTWARE = (replace(SCENARIO, example='tumbling_docking'), AUTOSTART)

MONITOR = (
    Row('table', 'default', 'shipped monitor table, or path of a monitor file',
        example='path/to/mine.yaml'),
    Row('react', True, 'false: only warn, for every fault', changeable=True),
    Row('controller_node', 'fuzzy_controller', 'controller node to deactivate', ros_name=True),
    Row('plant_node', 'plant', 'plant node to abort', ros_name=True),
)  # fmt: skip
