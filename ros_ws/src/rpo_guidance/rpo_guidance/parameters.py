# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes of this package."""

from __future__ import annotations

from dataclasses import replace

from rpo_ros.parameter_rows import AUTOSTART, SCENARIO
from rpo_ros.parameter_rows import ParameterRow as Row

GUIDANCE = (replace(SCENARIO, example='hold_points'), AUTOSTART)

OPERATOR = (
    Row('command', 'go', 'what is said to guidance', choices=('go', 'hold', 'retreat', 'abort'),
        wall=True, example='abort'),
    Row('phase', '', 'said in this phase of the plan only; empty: in any', wall=True),
    Row('patience_s', 300.0, 'longest wait for the phase and for a `go` to be followed, wall time',
        's', least=0.1, most=1e6, wall=True),
    Row('until_end', False, 'stay until the run ends, and print the phases of the plan',
        wall=True),
)  # fmt: skip
