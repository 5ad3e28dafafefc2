# Copyright 2026 The RPO stack authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the nodes of this package, one table for each."""

from __future__ import annotations

from dataclasses import replace

from rpo_ros.parameter_rows import AUTOSTART, SCENARIO

ASSURANCE = (replace(SCENARIO, example='assured'), AUTOSTART)
