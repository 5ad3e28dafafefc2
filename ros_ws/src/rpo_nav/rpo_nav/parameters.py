# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the node of this package."""

from __future__ import annotations

from dataclasses import replace

from rpo_ros.parameter_rows import AUTOSTART, SCENARIO, ParameterRow

ALL, SENSORS, ESTIMATOR = 'all', 'sensors', 'estimator'

NAVIGATION = (
    replace(SCENARIO, example='path/to/mine.yaml'),
    ParameterRow('stages', ALL, "those that this node runs; the others are somebody else's",
                 choices=(ALL, SENSORS, ESTIMATOR)),
    AUTOSTART,
)  # fmt: skip
