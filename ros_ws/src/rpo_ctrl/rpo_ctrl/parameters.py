# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes of this package, one table for each."""

from __future__ import annotations

from dataclasses import replace

from rpo_core.files import DEFAULT_CONTROLLER
from rpo_ros.parameter_rows import AUTOSTART, SCENARIO
from rpo_ros.parameter_rows import ParameterRow as Row

FUZZY_CONTROLLER = (
    Row('controller', DEFAULT_CONTROLLER, 'shipped controller, or path of a controller file; may '
        'change while the controller is inactive', changeable=True,
        example='path/to/mine.yaml'),
    AUTOSTART,
    Row('decision_rate_hz', 1.0, 'decisions published per simulated second; 0: none', 'Hz',
        most=1e4),
    SCENARIO,
)  # fmt: skip

ATTITUDE_CONTROLLER = (SCENARIO, AUTOSTART)

RIVAL_CONTROLLER = (
    replace(FUZZY_CONTROLLER[0], default='lqr', example='mpc'),
    *FUZZY_CONTROLLER[1:],
)
